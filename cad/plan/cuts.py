"""Plan how a part larger than the printer's bed is split: cuts that leave no thin walls, pieces, joints and pins.

Each joint has two steel pins, in teardrop holes on both sides of the cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any

import numpy as np

from mirrorcam.cad.plan.fasteners import ROOF_DEG
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

if TYPE_CHECKING:
    from build123d import Part

FAR_MM = 1e4
# Two faces form a wall if they are parallel to within 15 deg; the edge of a wedge is not a wall.
PARALLEL = float(np.cos(np.radians(15.0)))
# A triangle counts as level within the rounding of its corners.
LEVEL_MM = 1e-6
# A cut very near a corner or an edge would leave slivers below the precision of a mesh. Cuts are shifted, in steps of
# STEP_MM, to be at least CLEAR_MM away.
CLEAR_MM = 0.005
STEP_MM = 0.01
# The boxes of the outer pieces extend this far beyond the part.
PAST_PART_MM = 1.0

Span = tuple[float, float]
Cuts = tuple[tuple[float, ...], tuple[float, ...]]
"""Coordinates of cuts normal to x, and of cuts normal to y."""

Cell = tuple[int, int]
"""Indices of a piece along the bed's x and y, from 0."""


@dataclass(frozen=True)
class PiecePlan:
    """A piece of a part: `make(whole)`, where `whole` is the uncut part's plan, inside a box along the bed's axes.

    The box extends from `low_mm` to `high_mm` (3,). Fragments smaller than a cube of side `crumb_mm` do not print and
    are omitted. `rig_from_bed` (4, 4) is the pose of the uncut part's bed. `rig_from_pins` (n, 4, 4) are the frames of
    the pins' holes: origin in the cut, z into the piece, y up on the bed. `hole_mm` is their diameter and depth.
    """

    whole: Any
    make: Callable[[Any], Part]
    rig_from_bed: FloatArray
    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]
    rig_from_pins: FloatArray
    hole_mm: tuple[float, float]
    crumb_mm: float


@dataclass(frozen=True)
class Joint:
    """A cut between two adjacent pieces, at the coordinate `cut_mm` along an axis of the bed, 0 (x) or 1 (y).

    `span_mm` is the range for its pins along the bed's other axis, clear of the pins of crossing cuts.
    """

    cells: tuple[Cell, Cell]
    axis: int
    cut_mm: float
    span_mm: Span


def cells_between(cuts_mm: Cuts, low_mm: FloatArray, high_mm: FloatArray) -> dict[Cell, tuple[Span, Span]]:
    """Spans along the bed's x and y of each piece of a part with bounds (3,); pieces are ordered along x and then y."""
    spans = [
        list(pairwise([float(low_mm[axis]) - PAST_PART_MM, *cuts_mm[axis], float(high_mm[axis]) + PAST_PART_MM]))
        for axis in (0, 1)
    ]
    return {(i, j): (spans[0][i], spans[1][j]) for i, j in product(range(len(spans[0])), range(len(spans[1])))}


def joints_between(cells: dict[Cell, tuple[Span, Span]], pin_mm: float) -> list[Joint]:
    """The cuts between adjacent pieces; their pins are at least `pin_mm` from a crossing cut."""
    joints = []
    for cell, spans in cells.items():
        for axis, other in ((0, 1), (1, 0)):
            if (next_cell := _next(cell, axis)) not in cells:
                continue
            first, last = spans[other]
            span = (
                first + pin_mm if cell[other] > 0 else -FAR_MM,
                last - pin_mm if _next(cell, other) in cells else FAR_MM,
            )
            joints.append(Joint((cell, next_cell), axis, spans[axis][1], span))
    return joints


def _next(cell: Cell, axis: int) -> Cell:
    return (cell[0] + 1, cell[1]) if axis == 0 else (cell[0], cell[1] + 1)


def avoid_corners(triangles_mm: FloatArray, axis: int, cuts_mm: tuple[float, ...], wall_mm: float) -> tuple[float, ...]:
    """Coordinates of cuts normal to an axis, shifted away from the corners of a mesh.

    Parameters
    ----------
    triangles_mm : (n, 3, 3)
        Triangles of the part on the bed, counter-clockwise seen from outside.
    axis : int
        Axis of the bed that is normal to the cuts: 0 or 1.
    cuts_mm : tuple of float
        Requested coordinates along that axis.
    wall_mm : float
        Thinnest wall that prints.

    Returns
    -------
    tuple of float
        Each cut, shifted by as little as necessary and at most `MAX_SHIFT_MM`, to the side that leaves less thin wall.
    """
    count = round(MAX_SHIFT_MM / STEP_MM)
    corners = np.unique(triangles_mm[:, :, axis])
    shifted = []
    for cut in cuts_mm:
        candidates = np.asarray(cut + STEP_MM * np.arange(-count, count + 1), dtype=np.float64)
        touching = np.abs(corners[:, None] - candidates).min(axis=0) < CLEAR_MM
        # Areas are compared to a tenth of a square millimetre, since an inclined face is nearer at one end.
        thin = np.round(thin_wall_mm2(triangles_mm, axis, candidates, wall_mm), 1)
        best = min(range(len(candidates)), key=lambda k: (touching[k], thin[k], abs(k - count)))
        shifted.append(float(candidates[best]))
    return tuple(shifted)


def thin_wall_mm2(triangles_mm: FloatArray, axis: int, cuts_mm: FloatArray, wall_mm: float) -> FloatArray:
    """Area of the walls thinner than `wall_mm` that cuts normal to an axis leave.

    A wall is between the cut and a face that is parallel to it, to within 15 deg, and faces away from it.

    Parameters
    ----------
    triangles_mm : (n, 3, 3)
        Triangles of the part, counter-clockwise seen from outside.
    axis : int
        Axis normal to the cuts: 0 or 1.
    cuts_mm : (m,)
        Coordinates of single cuts along that axis.
    wall_mm : float
        Thinnest wall that prints.

    Returns
    -------
    (m,)
        Area in mm^2 next to each cut.
    """
    first, second, third = np.moveaxis(triangles_mm, 1, 0)
    normals = np.cross(second - first, third - first)
    areas = np.linalg.norm(normals, axis=1) / 2.0
    total = np.zeros(len(cuts_mm))
    for side in (-1.0, 1.0):
        facing = side * normals[:, axis] > 2.0 * PARALLEL * areas
        corners = side * triangles_mm[facing, :, axis]
        fractions = (_fraction_below(corners, side * cuts_mm + margin) for margin in (wall_mm, 0.0))
        total += np.subtract(*fractions) @ areas[facing]
    return total


def _fraction_below(corners_mm: FloatArray, levels_mm: FloatArray) -> FloatArray:
    """Fractions (m, n) of triangles' areas below levels (m,); the triangles' corners are at heights (n, 3)."""
    low, middle, high = np.sort(corners_mm, axis=1).T[:, None, :]
    level = levels_mm[:, None]
    clipped = np.clip(level, low, high)
    rising = (clipped - low) ** 2 / np.maximum((middle - low) * (high - low), 1e-12)
    falling = 1.0 - (high - clipped) ** 2 / np.maximum((high - middle) * (high - low), 1e-12)
    return np.where(high - low < LEVEL_MM, level > low, np.where(clipped < middle, rising, falling))


# Largest shift of a cut from its requested coordinate (see `avoid_corners`).
MAX_SHIFT_MM = 0.09


def bed_lengths_mm(lengths_mm: tuple[float, float], hardware: Hardware) -> tuple[float, float]:
    """Lengths of the bed along a part's x and y: the part's longer side lies along the bed's longer side."""
    short, long = sorted(hardware.printer.bed_mm[:2])
    return (long, short) if lengths_mm[0] >= lengths_mm[1] else (short, long)


def rotated_onto_bed(part: PartPlan, length_mm: float, bed_mm: float, hardware: Hardware) -> PartPlan:
    """The part, rotated by a quarter turn if its length along x fits only the bed's y."""
    if bed_mm == hardware.printer.bed_mm[0] or length_mm <= hardware.printer.bed_mm[0]:
        return part
    quarter = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    return replace(part, print_from_rig=quarter @ part.print_from_rig)


def require_height(name: str, height_mm: float, hardware: Hardware) -> None:
    """Raise InputError if a part is taller than the printer's bed allows: vertical cuts do not reduce the height."""
    if height_mm > hardware.printer.bed_mm[2]:
        raise InputError(
            f"{name} is {height_mm:.1f} mm high, expected at most {hardware.printer.bed_mm[2]:g} mm (printer bed)"
        )


def cut_slack_mm(length_mm: float, count: int, bed_mm: float) -> float:
    """Largest independent shift of each cut into `count` equal pieces at which all pieces still fit the bed."""
    spare = max(0.0, bed_mm - length_mm / count - MAX_SHIFT_MM)
    return spare if count == 2 else spare / 2.0


# Minimum distance between two pins, in diameters: closer pins let the pieces rotate.
PIN_SPACING = 4.0


def clearance_around_pin_mm(hardware: Hardware) -> float:
    """Minimum distance from a pin's axis to the part's surface: the roof of its hole is higher than its radius."""
    radius = hardware.holder.pin_mm[0] / 2.0 + hardware.fit.press_mm
    return radius / float(np.sin(np.radians(ROOF_DEG))) + hardware.printer.wall_mm


def depth_for_pin_mm(hardware: Hardware) -> float:
    """Depth of solid material that a pin needs on either side of a cut: its hole and the thinnest wall behind it."""
    return hole_depth_mm(hardware) + hardware.printer.wall_mm


def hole_depth_mm(hardware: Hardware) -> float:
    """Depth of a pin's hole in either piece, with clearance at its end."""
    return hardware.holder.pin_mm[1] / 2.0 + hardware.fit.slide_mm


def hole_mm(hardware: Hardware) -> float:
    """Diameter of a pin's hole."""
    return hardware.holder.pin_mm[0] + 2.0 * hardware.fit.press_mm


def farthest_pair(points_mm: FloatArray) -> tuple[FloatArray, float]:
    """The two points (2, 2) of (n, 2) that are farthest apart, and their distance; 0 mm if there are no points."""
    distances = np.linalg.norm(points_mm[:, None] - points_mm[None, :], axis=-1)
    if not distances.size:
        return np.zeros((2, 2)), 0.0
    first, second = np.unravel_index(int(np.argmax(distances)), distances.shape)
    return points_mm[[first, second]], float(distances.max())


def hole_frame(start_mm: FloatArray, axis: int, side: float) -> FloatArray:
    """Frame (4, 4) on the bed of a hole that starts at a point (3,) in a cut: z into the piece along an axis, y up."""
    inwards, upwards = side * np.eye(3)[axis], np.array([0.0, 0.0, 1.0])
    return rigid(np.column_stack([np.cross(upwards, inwards), upwards, inwards]), start_mm)
