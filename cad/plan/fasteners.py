"""Fasteners as plain numbers: threads, screw lengths and engagement, the holes for them, and their frames."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.hardware import Fastening, Hardware
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid


@dataclass(frozen=True)
class Thread:
    """A thread in mm: the screw's diameter, pitch, head and clearance hole, and its hexagon nut."""

    diameter_mm: float
    pitch_mm: float
    head_mm: float
    head_height_mm: float
    clearance_mm: float
    nut_flats_mm: float
    nut_height_mm: float


# Heads from ISO 4762, holes from ISO 273 (normal), nuts from ISO 4032; the last row from ASME B18.3 and B18.2.2.
THREADS = {
    "M1.6": Thread(1.6, 0.35, 3.0, 1.6, 1.8, 3.2, 1.3),
    "M2": Thread(2.0, 0.4, 3.8, 2.0, 2.4, 4.0, 1.6),
    "M2.5": Thread(2.5, 0.45, 4.5, 2.5, 2.9, 5.0, 2.0),
    "M3": Thread(3.0, 0.5, 5.5, 3.0, 3.4, 5.5, 2.4),
    "M4": Thread(4.0, 0.7, 7.0, 4.0, 4.5, 7.0, 3.2),
    "M5": Thread(5.0, 0.8, 8.5, 5.0, 5.5, 8.0, 4.7),
    "M6": Thread(6.0, 1.0, 10.0, 6.0, 6.6, 10.0, 5.2),
    "M8": Thread(8.0, 1.25, 13.0, 8.0, 9.0, 13.0, 6.8),
    "1/4-20 UNC": Thread(6.35, 1.27, 9.53, 6.35, 6.6, 11.11, 5.56),
}

COUNTERSUNK = " countersunk"
"""Suffix of the size of a screw with a countersunk head of 90 deg (ISO 10642), whose length includes the head."""

SUNK_HEAD = 2.24
"""Theoretical sharp diameter of a countersunk head over the thread's diameter."""


def thread_of(size: str) -> Thread:
    """The thread of a size that starts with its name: "M3", "M3 countersunk", "1/4-20 UNC".

    Raises ValueError if the table has no thread of that name.
    """
    for name, thread in THREADS.items():
        if size == name or size.startswith(f"{name} "):
            return thread
    raise ValueError(f"{size=} does not name a thread, expected one of {', '.join(THREADS)}")


def diameter_mm(size: str) -> float:
    """The diameter of a size: its thread's, or the size itself if it is a number, such as "3" for a pin.

    Raises ValueError for any other size.
    """
    number = re.match(r"\d+(\.\d+)?$", size)
    return float(number.group()) if number else thread_of(size).diameter_mm


# Clearance of a nut's pocket in width and depth, so that the nut drops in.
NUT_FIT_MM = 0.2
# Holes start this far outside the material, so that no skin covers their mouths.
OUTSIDE_MM = 0.01
# Roofs of holes are slightly steeper than the overhang limit, and much steeper where they cut webs at 45 deg, since a
# web's end recedes along the roof. In a thin skin oblique to the bed, slicers treat the top of a roof of 42 deg as a
# ceiling, so skins get steeper roofs too.
ROOF_DEG = 42.0
ROOF_IN_SKINS_DEG = 36.0
ROOF_IN_WEBS_DEG = 30.0


@dataclass(frozen=True)
class Bore:
    """A round hole from the centre of its mouth (3,) along an axis (3,), in the rig frame, mm.

    A bore that is horizontal on the bed has `up` (3,), normal to the axis: its ceiling is then a roof, `roof_deg` from
    upright. `travel_mm` makes it a slot along up x axis, with that distance between the centres of its ends. A `flat`
    slot has a level ceiling, printed as a bridge, so that a screw's head rests on both sides of the slot.
    """

    mouth: FloatArray
    axis: FloatArray
    radius_mm: float
    depth_mm: float
    up: FloatArray | None = None
    travel_mm: float = 0.0
    roof_deg: float = ROOF_DEG
    flat: bool = False

    @property
    def roof_mm(self) -> float:
        """Height of the roof's ridge, where the tangents of both ends meet, over the centre."""
        angle = np.deg2rad(self.roof_deg)
        if self.flat:
            return self.radius_mm
        return float((self.radius_mm + self.travel_mm / 2.0 * np.cos(angle)) / np.sin(angle))


@dataclass(frozen=True)
class Countersink:
    """A cone for a countersunk head, from the centre of its mouth (3,) along an axis (3,), in the rig frame, mm.

    It prints without support with its mouth on the bed. `travel_mm` makes it the countersink of a slot like a `Bore`'s,
    along `up` (3,) x axis.
    """

    mouth: FloatArray
    axis: FloatArray
    radius_mm: float
    end_radius_mm: float
    depth_mm: float
    up: FloatArray | None = None
    travel_mm: float = 0.0


@dataclass(frozen=True)
class Hexagon:
    """A pocket for a nut: centre of its mouth (3,), axis (3,), and `up` (3,) towards a corner, all in the rig frame.

    Its two upper sides form a roof, `ROOF_DEG` from upright; the other four hold the nut. A pocket whose axis is
    vertical on the bed has no `up`: all six sides hold the nut, and two corners lie along x.
    """

    mouth: FloatArray
    axis: FloatArray
    up: FloatArray | None
    flats_mm: float
    depth_mm: float

    @property
    def corner_mm(self) -> float:
        """Distance of the corners from the centre."""
        return self.flats_mm / np.sqrt(3.0)

    @property
    def ridge_mm(self) -> float:
        """Height of the roof's ridge over the centre, if the pocket has a roof."""
        return float(self.corner_mm * (0.5 + np.sqrt(0.75) / np.tan(np.deg2rad(ROOF_DEG))))


@dataclass(frozen=True)
class Stack:
    """A screw through `grip_mm` of material into a wall of `wall_mm`, which holds an insert or a nut.

    `washer_mm` is the thickness of the washer under its head, 0 for none. The thread starts `begins_mm` below the face
    that the screw enters: an insert sits at that face, a nut in the far one. `engaged_mm` is the length of engagement.
    """

    grip_mm: float
    wall_mm: float
    length_mm: float
    begins_mm: float
    engaged_mm: float
    washer_mm: float = 0.0


def head_space_mm(hardware: Hardware) -> float:
    """Radius of the space for a screw's head or washer, and for the screwdriver."""
    screw = hardware.screw
    return max(screw.head_mm, screw.washer_mm) / 2.0 + hardware.fit.free_mm


def washer_under_mm(grip_mm: float, screw: Fastening) -> float:
    """Thickness of the washer under a head on `grip_mm` of plastic; 0 if the plastic bears the head without one."""
    return screw.washer_height_mm if grip_mm <= screw.washer_under_mm else 0.0


def stack(grip_mm: float, hardware: Hardware) -> Stack:
    """The screw for a grip, and the wall that it needs; raises InputError if no screw on the list engages."""
    screw = hardware.screw
    if screw.kind == "insert":
        thread_mm = (0.0, screw.insert_mm)
        return stack_into(
            grip_mm, thread_mm, screw.insert_depth_mm, screw.insert_depth_mm + hardware.printer.wall_mm, screw
        )
    # The tip is flush with the far face and the nut just below it, with the thickness of two walls under the nut.
    washer = washer_under_mm(grip_mm, screw)
    needed = washer + grip_mm + 2.0 * hardware.printer.wall_mm + screw.nut_height_mm + NUT_FIT_MM
    lengths = [length for length in screw.lengths_mm if length >= needed]
    if not lengths:
        raise InputError(
            f"M3 screws through {grip_mm:g} mm must be {needed:.1f} mm long, expected one in lengths_mm under [screw]"
        )
    wall = min(lengths) - grip_mm - washer
    return Stack(grip_mm, wall, min(lengths), wall - screw.nut_height_mm - NUT_FIT_MM, screw.nut_height_mm, washer)


def stack_into(
    grip_mm: float, thread_mm: tuple[float, float], max_depth_mm: float, wall_mm: float, screw: Fastening
) -> Stack:
    """The longest screw that does not bottom out at `max_depth_mm` in a hole threaded at depths `thread_mm` (from, to).

    Raises InputError if no screw on the list engages.
    """
    start, end = thread_mm
    washer = washer_under_mm(grip_mm, screw)
    needed = screw.engaged_mm if screw.kind == "insert" else screw.nut_height_mm
    lengths = [length for length in screw.lengths_mm if length <= washer + grip_mm + max_depth_mm - NUT_FIT_MM]
    engaged = min(max(lengths, default=0.0) - washer - grip_mm, end) - start
    if engaged < needed - 1e-9:
        raise InputError(
            f"M3 screws through {grip_mm:g} mm engage {max(engaged, 0.0):.1f} mm of the thread {start:g} to {end:g} mm "
            f"deep, expected at least {needed:g} mm: add to lengths_mm under [screw], now "
            f"{', '.join(f'{length:g}' for length in screw.lengths_mm)}"
        )
    return Stack(grip_mm, wall_mm, max(lengths), start, engaged, washer)


def thread(
    mouth: FloatArray, axis: FloatArray, up: FloatArray, fastened: Stack, wall_mm: float, screw: Fastening
) -> tuple[Bore | Hexagon, ...]:
    """The holes in a wall for a screw that enters at a mouth (3,) along an axis (3,).

    The wall is at least as thick as in the screw's `Stack`. In a thicker wall the nut's pocket is deeper, so that the
    nut is at the screw's end.
    """
    start = mouth - OUTSIDE_MM * axis
    if screw.kind == "insert":
        return (Bore(start, axis, screw.insert_hole_mm / 2.0, screw.insert_depth_mm + OUTSIDE_MM, up),)
    depth = wall_mm - fastened.begins_mm + OUTSIDE_MM
    return (
        Bore(start, axis, screw.clearance_hole_mm / 2.0, wall_mm + 2.0 * OUTSIDE_MM, up),
        Hexagon(mouth + fastened.begins_mm * axis, axis, up, screw.nut_flats_mm + NUT_FIT_MM, depth),
    )


X_AXIS = np.array([1.0, 0.0, 0.0])
# Distance of an item from its part at the end of its `exit_move`: half a nut, and a visible gap.
EXIT_GAP_MM = 12.0


def frame_along(origin: FloatArray, z_axis: FloatArray, x_hint: FloatArray = X_AXIS) -> FloatArray:
    """A frame (4, 4) at a point (3,): z along a direction (3,), x as near to another direction (3,) as possible."""
    x_axis = x_hint - (z_axis @ x_hint) * z_axis
    x_axis = x_axis / np.linalg.norm(x_axis)
    return rigid(np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis]), origin)


def exit_move(corners: FloatArray, point: FloatArray, direction: FloatArray) -> FloatArray:
    """The move (3,) along a unit vector (3,) that takes a point (3,) out of the hull of corners (n, 3)."""
    return float(((corners - point) @ direction).max() + EXIT_GAP_MM) * direction
