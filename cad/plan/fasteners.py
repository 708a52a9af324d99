"""Fasteners as plain numbers: screw lengths and engagement, the holes for them, and their frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.hardware import Fastening, Hardware
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

# Clearance of a nut's pocket in width and depth, so that the nut drops in.
NUT_FIT_MM = 0.2
# Largest depth of an insert's hole beyond the given one.
MAX_DEEPER_MM = 4.0
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
    upright. `travel_mm` makes it a slot along up x axis, with that distance between the centres of its ends.
    `ceiling_mm` gives a slot a level ceiling of at most that width, printed as a bridge, so that a screw's head rests
    on both sides of the slot.
    """

    mouth: FloatArray
    axis: FloatArray
    radius_mm: float
    depth_mm: float
    up: FloatArray | None = None
    travel_mm: float = 0.0
    roof_deg: float = ROOF_DEG
    ceiling_mm: float = 0.0

    @property
    def roof_mm(self) -> float:
        """Height over the centre of the roof's ridge, where the tangents of both ends meet, or of its ceiling."""
        angle = np.deg2rad(self.roof_deg)
        half_mm = (self.travel_mm - self.ceiling_mm) / 2.0
        return max(self.radius_mm, float((self.radius_mm + half_mm * np.cos(angle)) / np.sin(angle)))


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
    `lengths_mm` are the lengths of the shortest screw that engages enough and of the longest that does not bottom out
    or stand out.
    """

    grip_mm: float
    wall_mm: float
    length_mm: float
    begins_mm: float
    engaged_mm: float
    lengths_mm: tuple[float, float]
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
            f"{screw.thread} screws through {grip_mm:g} mm must be at least {needed:.1f} mm long, but lengths_mm under "
            f"[screw] ends at {max(screw.lengths_mm):g}: add one"
        )
    wall, length = min(lengths) - grip_mm - washer, min(lengths)
    begins, engaged = wall - screw.nut_height_mm - NUT_FIT_MM, screw.nut_height_mm
    return Stack(grip_mm, wall, length, begins, engaged, (length - NUT_FIT_MM, length), washer)


def stack_into(
    grip_mm: float, thread_mm: tuple[float, float], max_depth_mm: float, wall_mm: float, screw: Fastening
) -> Stack:
    """The longest screw that does not bottom out at `max_depth_mm` in a hole threaded at depths `thread_mm` (from, to).

    Raises InputError if no screw on the list engages.
    """
    start, end = thread_mm
    washer = washer_under_mm(grip_mm, screw)
    through = washer + grip_mm
    needed = screw.engaged_mm if screw.kind == "insert" else screw.nut_height_mm
    fitting = through + start + needed, through + max_depth_mm - NUT_FIT_MM
    lengths = [length for length in screw.lengths_mm if length <= fitting[1] + 1e-9]
    engaged = min(max(lengths, default=0.0) - through, end) - start
    if engaged < needed - 1e-9:
        raise InputError(
            f"{screw.thread} screws through {grip_mm:g} mm engage {max(engaged, 0.0):.1f} mm of the thread {start:g} "
            f"to {end:g} mm deep, expected at least {needed:g} mm: add a length of {fitting[0]:.1f} to "
            f"{fitting[1]:.1f} mm to lengths_mm under [screw], now "
            f"{', '.join(f'{length:g}' for length in screw.lengths_mm)}"
        )
    return Stack(grip_mm, wall_mm, max(lengths), start, engaged, fitting, washer)


def with_holes_for_screws(hardware: Hardware) -> Hardware:
    """The hardware with the holes of inserts so deep that screws of its lengths engage in them.

    A screw may pass its insert, so that a few lengths suffice. Holes are at most `MAX_DEEPER_MM` deeper than given;
    lengths that need more are left to be refused where they are used.
    """
    screw = hardware.screw
    if screw.kind != "insert":
        return hardware
    grips = (hardware.mount.grip_mm, hardware.mount.slide_skin_mm, *hardware.back.grips_mm)
    depth = screw.insert_depth_mm
    for grip in grips:
        through = grip + washer_under_mm(grip, screw)
        past = [length - through + NUT_FIT_MM for length in screw.lengths_mm if length - through >= screw.engaged_mm]
        depth = max(depth, min(past, default=0.0))
    if depth > screw.insert_depth_mm + MAX_DEEPER_MM:
        return hardware
    return hardware.replaced(screw=screw.replaced(insert_depth_mm=round(depth, 3)))


def thread(
    mouth: FloatArray, axis: FloatArray, up: FloatArray | None, fastened: Stack, wall_mm: float, screw: Fastening
) -> tuple[Bore | Hexagon, ...]:
    """The holes in a wall for a screw that enters at a mouth (3,) along an axis (3,); `up` (3,) as in `Bore`.

    The wall is at least as thick as in the screw's `Stack`. In a thicker wall the nut's pocket is deeper, so that the
    nut is at the screw's end.
    """
    start = mouth - OUTSIDE_MM * axis
    if screw.kind == "insert":
        return (Bore(start, axis, screw.insert_hole_mm / 2.0, screw.insert_depth_mm + OUTSIDE_MM, up),)
    depth = wall_mm - fastened.begins_mm + OUTSIDE_MM
    through = wall_mm + 2.0 * OUTSIDE_MM
    return (
        Bore(start, axis, screw.clearance_hole_mm / 2.0, through, up, roof_deg=ROOF_IN_SKINS_DEG),
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
