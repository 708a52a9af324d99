"""Adapter parts built from convex blocks minus holes, and the holes that most of them have."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.plan.back_table import TripodNut
from mirrorcam.cad.plan.dimension import Hole, Length, holes
from mirrorcam.cad.plan.fasteners import (
    NUT_FIT_MM,
    OUTSIDE_MM,
    ROOF_DEG,
    Bore,
    Countersink,
    Hexagon,
    frame_along,
    head_space_mm,
)
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import SUNK_HEAD, thread_of
from mirrorcam.core.values import FloatArray

# The facets of a printed cone overhang slightly more than the cone, and slicers round by a degree or two: at 44 deg,
# slicers added support to three of nine plates.
CONE_RAD = np.radians(ROOF_DEG)
# Radial clearance of a countersink, for the facets of its mesh: less than the tolerance of the clash check.
HEAD_FIT_MM = 0.05
# A countersink widens at most this far below the head, so that walls remain between holes 9.5 mm apart and at edges.
FLARE_MM = 0.3
# Slots that are vertical in the print orientation have round ends, and need no self-supporting roofs.
NO_ROOF_DEG = 89.0
# Number of corners of a faceted disc.
CORNERS = 96
TRIPOD = "1/4-20 UNC"
ALONG_X, ALONG_Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class Disc:
    """A disc about an axis along y, from the centre (3,) of its first face towards +y, in the rig frame, mm."""

    face_centre: FloatArray
    radius_mm: float
    thickness_mm: float


@dataclass(frozen=True)
class BlocksPlan:
    """A part in the rig frame, mm: convex pieces and discs, minus cuts; `lengths` are for its drawing."""

    name: str
    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Countersink | Hexagon, ...]
    lengths: tuple[Length, ...] = ()
    discs: tuple[Disc, ...] = ()

    @property
    def corners(self) -> FloatArray:
        """The corners (n, 3) of all pieces."""
        return corners_of(self.hulls)

    @property
    def hulls(self) -> tuple[Frustum, ...]:
        """The pieces, with faceted discs."""
        return (*self.pieces, *(faceted(disc) for disc in self.discs))

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The lengths, the diameters of the discs, and the holes."""
        rounds = (Hole(disc.face_centre, ALONG_Y, round(2.0 * disc.radius_mm, 3)) for disc in self.discs)
        return (*self.lengths, *rounds, *holes(self.cuts))


def countersunk_hole(
    head: FloatArray, grip_mm: float, sink_mm: float, size: str, flare_mm: float = FLARE_MM
) -> tuple[Bore | Countersink, ...]:
    """A hole along z for a countersunk screw, with the head's top at a point (3,), `sink_mm` above a part's lower face.

    It prints without support in the part's upright position, with a cone of `ROOF_DEG` that widens up to `flare_mm`
    below the head.
    """
    thread = thread_of(size)
    half, head_radius = thread.clearance_mm / 2.0, SUNK_HEAD * thread.diameter_mm / 2.0 + HEAD_FIT_MM
    flare = min(sink_mm, flare_mm) + OUTSIDE_MM
    # Slightly steeper than the head's cone, so that the head rests on its rim.
    mouth = head_radius + flare * np.tan(CONE_RAD)
    cone = Countersink(head - flare * ABOVE, ABOVE, mouth, half, (mouth - half) / np.tan(CONE_RAD))
    bore = Bore(head, ABOVE, half, grip_mm + OUTSIDE_MM)
    if sink_mm <= flare_mm:
        return bore, cone
    return (
        bore,
        cone,
        Bore(head - (sink_mm + OUTSIDE_MM) * ABOVE, ABOVE, mouth, sink_mm - flare + 2 * OUTSIDE_MM),
    )


def countersunk_slot(top: FloatArray, size: str, deep_mm: float, travel_mm: float) -> tuple[Bore, Countersink]:
    """A slot along y and its countersink, for a countersunk screw that is flush with the part's upper face.

    Its centre is a point (3,) of that face. The part is printed on that face.
    """
    thread = thread_of(size)
    half, head_radius = thread.clearance_mm / 2.0, SUNK_HEAD * thread.diameter_mm / 2.0 + HEAD_FIT_MM
    mouth, mouth_radius = top + OUTSIDE_MM * ABOVE, head_radius + OUTSIDE_MM * np.tan(CONE_RAD)
    return (
        Bore(mouth, -ABOVE, half, deep_mm + 2.0 * OUTSIDE_MM, ALONG_X, travel_mm, NO_ROOF_DEG, travel_mm + 2.0 * half),
        Countersink(mouth, -ABOVE, mouth_radius, half, (mouth_radius - half) / np.tan(CONE_RAD), ALONG_X, travel_mm),
    )


def head_cuts(heads: FloatArray, grip_mm: float, up: FloatArray | None, hardware: Hardware) -> Iterator[Bore]:
    """Holes along z for screws whose heads rest at points (n, 3), and the space for heads and screwdriver below.

    `up` (3,) points up on the bed if the holes are printed horizontally, and is None if they are vertical.
    """
    clearance = hardware.screw.clearance_hole_mm / 2.0
    for head in heads:
        yield Bore(head - OUTSIDE_MM * ABOVE, ABOVE, clearance, grip_mm + 2.0 * OUTSIDE_MM, up)
        yield Bore(head, -ABOVE, head_space_mm(hardware), 99.0, up)


def faceted(disc: Disc) -> Frustum:
    """An inscribed prism of a disc."""
    angles = 2.0 * np.pi / CORNERS * np.arange(CORNERS)
    base = disc.face_centre + disc.radius_mm * np.column_stack([np.cos(angles), np.zeros(CORNERS), np.sin(angles)])
    return Frustum(base, base + disc.thickness_mm * ALONG_Y)


def ring(centre: FloatArray, radii_mm: tuple[float, float], thickness_mm: float) -> tuple[Frustum, ...]:
    """A ring between two radii about an axis along y, as inscribed convex sectors."""
    angles = 2.0 * np.pi / CORNERS * np.arange(CORNERS + 1)
    inner, outer = radii_mm
    sectors = []
    for start, end in pairwise(angles):
        # Chords of the inner circle would be inside it, so their corners are moved outwards.
        inner_corner = inner / np.cos(np.pi / CORNERS)
        loop = [(inner_corner, start), (outer, start), (outer, end), (inner_corner, end)]
        base = np.array([centre + np.array([r * np.cos(t), 0.0, r * np.sin(t)]) for r, t in loop])
        sectors.append(Frustum(base, base + np.array([0.0, thickness_mm, 0.0])))
    return tuple(sectors)


def tripod_depth_mm(nut: TripodNut) -> float:
    """Minimum thickness of a part with a tripod's nut flush in its upper face."""
    return nut.floor_mm + thread_of(TRIPOD).nut_height_mm + NUT_FIT_MM


def tripod_cuts(top: FloatArray, thickness_mm: float, nut: TripodNut) -> tuple[Bore, Hexagon]:
    """The pocket of a tripod's nut about a point (3,) of a part's upper face, and the hole under it.

    The nut drops in from above, and the mount's foot retains it. The tripod clamps the floor under it.
    """
    thread = thread_of(TRIPOD)
    mouth = top + OUTSIDE_MM * ABOVE
    return (
        Bore(mouth, -ABOVE, thread.clearance_mm / 2.0, thickness_mm + 2.0 * OUTSIDE_MM),
        Hexagon(mouth, -ABOVE, None, thread.nut_flats_mm + NUT_FIT_MM, thickness_mm - nut.floor_mm + OUTSIDE_MM),
    )


def tripod_nut(
    top: FloatArray, thickness_mm: float, nut: TripodNut, part: str, explode_mm: FloatArray
) -> PurchasedItem:
    """The nut in the pocket of `tripod_cuts`, in the named part; it leaves through the part's upper face."""
    thread = thread_of(TRIPOD)
    exit_mm = 25.0 * ABOVE
    frame = frame_along(top - (thickness_mm - nut.floor_mm - thread.nut_height_mm) * ABOVE, ABOVE)
    return PurchasedItem("nut", TRIPOD, thread.nut_height_mm, frame, explode_mm + exit_mm, (part,), exit_mm[None])
