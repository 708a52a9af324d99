"""Fasteners as plain numbers: threads and their standard sizes, lengths and walls, the holes for them, their frames."""

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
    """A thread: the screw's diameter, its pitch, head and clearance hole, and the hexagon nut across flats; mm."""

    diameter_mm: float
    pitch_mm: float
    head_mm: float
    head_height_mm: float
    clearance_mm: float
    nut_flats_mm: float
    nut_height_mm: float


# Heads of ISO 4762, holes of ISO 273 (normal), nuts of ISO 4032; the last of ASME B18.3 and B18.2.2.
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
"""End of the size of a screw with a countersunk head of 90 deg (ISO 10642), whose length counts from its top."""

SUNK_HEAD = 2.24
"""Diameter of such a head over the thread's, where its cone would end in a sharp edge."""


def thread_of(size: str) -> Thread:
    """The thread of a size, which begins with its name: "M3", "M3 countersunk", "1/4-20 UNC".

    Raises ValueError for a size of no thread in the table.
    """
    for name, thread in THREADS.items():
        if size == name or size.startswith(f"{name} "):
            return thread
    raise ValueError(f"{size=} names no thread, expected one of {', '.join(THREADS)}")


def diameter_mm(size: str) -> float:
    """The diameter of a size: its thread's, or the number that it begins with, "3" for a pin.

    Raises ValueError for a size that names neither.
    """
    number = re.match(r"\d+(\.\d+)?$", size)
    return float(number.group()) if number else thread_of(size).diameter_mm


# A nut drops into a pocket this much wider and deeper than itself.
NUT_FIT_MM = 0.2
# Holes begin this far outside the material, so that no skin is left over their mouths.
OUTSIDE_MM = 0.01
# Roofs of holes are a little steeper than a printer must be able to do; those that cut webs at 45 deg much more, since
# a web's end recedes along it. Slicers also take the top of a roof for a ceiling in a thin skin oblique to the bed,
# seen at 42 deg.
ROOF_DEG = 42.0
ROOF_IN_SKINS_DEG = 36.0
ROOF_IN_WEBS_DEG = 30.0


@dataclass(frozen=True)
class Bore:
    """A round hole from the middle of its mouth (3,) along an axis (3,), in rig, mm.

    One that lies when printed has `up` (3,), across the axis: its ceiling is then a roof, `roof_deg` from upright.
    `travel_mm` makes it a slot, as long as that between the middles of its ends, along up x axis; a `flat` one ends
    level with its ends, so that a screw's head rests on both of its sides, and its ceiling bridges.
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
        """Height of the roof's ridge over the middle, where two tangents of the ends meet."""
        steep = np.deg2rad(self.roof_deg)
        if self.flat:
            return self.radius_mm
        return float((self.radius_mm + self.travel_mm / 2.0 * np.cos(steep)) / np.sin(steep))


@dataclass(frozen=True)
class Countersink:
    """A cone from the middle of its mouth (3,) along an axis (3,), in rig, mm, to its smaller end.

    The space of a countersunk head: it prints without support with its mouth on the bed. `travel_mm` makes it the
    groove of such a slot as a `Bore`'s, along `up` (3,) x axis.
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
    """A pocket for a nut, in rig: the middle of its mouth (3,), its axis (3,), and `up` (3,), opposite to a corner.

    Its two upper sides are a roof, `ROOF_DEG` from upright; the others hold the nut. One that prints upright has no
    `up`: all six sides hold, two corners lie along x.
    """

    mouth: FloatArray
    axis: FloatArray
    up: FloatArray | None
    flats_mm: float
    depth_mm: float

    @property
    def corner_mm(self) -> float:
        """Distance of the corners from the middle."""
        return self.flats_mm / np.sqrt(3.0)

    @property
    def ridge_mm(self) -> float:
        """Height of the roof's ridge over the middle, of a pocket that has one."""
        return float(self.corner_mm * (0.5 + np.sqrt(0.75) / np.tan(np.deg2rad(ROOF_DEG))))


@dataclass(frozen=True)
class Stack:
    """A screw through `grip_mm` of material into a wall of `wall_mm`, which holds an insert or a nut.

    Its head lies on a washer of `washer_mm`, where that is not 0. `begins_mm` deep in the wall there is the thread, of
    which `engaged_mm` holds: the insert sits at the face that the screw enters, the nut in the far face.
    """

    grip_mm: float
    wall_mm: float
    length_mm: float
    begins_mm: float
    engaged_mm: float
    washer_mm: float = 0.0


def head_space_mm(hardware: Hardware) -> float:
    """Radius of the space of a screw's head, with its washer, and of the driver."""
    screw = hardware.screw
    return max(screw.head_mm, screw.washer_mm) / 2.0 + hardware.fit.free_mm


def washer_under_mm(grip_mm: float, screw: Fastening) -> float:
    """Thickness of the washer under a head on so much plastic, which alone would be dented; 0 for none."""
    return screw.washer_height_mm if grip_mm <= screw.washer_under_mm else 0.0


def stack(grip_mm: float, hardware: Hardware) -> Stack:
    """The screw for a grip, and the wall that it needs; raises InputError where no screw on the list holds."""
    screw = hardware.screw
    if screw.kind == "insert":
        thread_mm = (0.0, screw.insert_mm)
        return stack_into(
            grip_mm, thread_mm, screw.insert_depth_mm, screw.insert_depth_mm + hardware.printer.wall_mm, screw
        )
    # The tip is flush with the far face, the nut just below it; under the nut there is as much as two walls.
    washer = washer_under_mm(grip_mm, screw)
    least = washer + grip_mm + 2.0 * hardware.printer.wall_mm + screw.nut_height_mm + NUT_FIT_MM
    fits = [length for length in screw.lengths_mm if length >= least]
    if not fits:
        raise InputError(f"M3 screws through {grip_mm:g} mm must be {least:.1f} mm long, longer than any on the list")
    wall = min(fits) - grip_mm - washer
    return Stack(grip_mm, wall, min(fits), wall - screw.nut_height_mm - NUT_FIT_MM, screw.nut_height_mm, washer)


def stack_into(
    grip_mm: float, thread_mm: tuple[float, float], deepest_mm: float, wall_mm: float, screw: Fastening
) -> Stack:
    """The longest screw that does not bottom out in a given hole, whose thread lies `thread_mm` (from, to) deep.

    Raises InputError where no screw on the list holds there.
    """
    begins, ends = thread_mm
    washer = washer_under_mm(grip_mm, screw)
    needed = screw.engaged_mm if screw.kind == "insert" else screw.nut_height_mm
    fits = [length for length in screw.lengths_mm if length <= washer + grip_mm + deepest_mm - NUT_FIT_MM]
    engaged = min(max(fits, default=0.0) - washer - grip_mm, ends) - begins
    if engaged < needed - 1e-9:
        raise InputError(
            f"M3 screws through {grip_mm:g} mm hold by {max(engaged, 0.0):.1f} mm of thread {begins:g} to {ends:g} mm "
            f"deep, expected at least {needed:g} mm"
        )
    return Stack(grip_mm, wall_mm, max(fits), begins, engaged, washer)


def thread(
    mouth: FloatArray, axis: FloatArray, up: FloatArray, held: Stack, wall_mm: float, screw: Fastening
) -> tuple[Bore | Hexagon, ...]:
    """The cuts in a wall, as thick as its stack or thicker, for a screw that enters at a mouth (3,) along an axis.

    In a thicker wall the nut's pocket is deeper, so that the nut sits where the screw ends.
    """
    start = mouth - OUTSIDE_MM * axis
    if screw.kind == "insert":
        return (Bore(start, axis, screw.insert_hole_mm / 2.0, screw.insert_depth_mm + OUTSIDE_MM, up),)
    depth = wall_mm - held.begins_mm + OUTSIDE_MM
    return (
        Bore(start, axis, screw.clearance_hole_mm / 2.0, wall_mm + 2.0 * OUTSIDE_MM, up),
        Hexagon(mouth + held.begins_mm * axis, axis, up, screw.nut_flats_mm + NUT_FIT_MM, depth),
    )


ACROSS = np.array([1.0, 0.0, 0.0])
# What has left a part is this far from it: half a nut, and as much as shows.
CLEAR_MM = 12.0


def along(origin: FloatArray, z_axis: FloatArray, across: FloatArray = ACROSS) -> FloatArray:
    """A frame (4, 4) at a point (3,) with z along a direction (3,) and x as near to another (3,) as it can be."""
    x_axis = across - (z_axis @ across) * z_axis
    x_axis = x_axis / np.linalg.norm(x_axis)
    return rigid(np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis]), origin)


def beyond(corners: FloatArray, place: FloatArray, way: FloatArray) -> FloatArray:
    """The move (3,) along a unit vector (3,) by which a place (3,) leaves the hull of corners (n, 3)."""
    return float(((corners - place) @ way).max() + CLEAR_MM) * way
