"""Parts of backs made of convex blocks and holes, and the holes that most of them have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.plan.back_table import TripodNut
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, Bore, Countersink, Hexagon
from mirrorcam.cad.plan.hole_dimensions import holes
from mirrorcam.cad.plan.item_frames import along
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import SUNK_HEAD, thread_of
from mirrorcam.optics.base.values import FloatArray

STEEP = np.radians(44.0)
TRIPOD = "1/4-20 UNC"
ALONG_X, ALONG_Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class BlocksPlan:
    """A part in rig, mm: convex pieces, and what is cut from them; `lengths` are dimensions of its drawing."""

    name: str
    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Countersink | Hexagon, ...]
    lengths: tuple[Length, ...] = ()

    @property
    def corners(self) -> FloatArray:
        """The corners (n, 3) of all pieces."""
        return corners_of(self.pieces)

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The lengths that others depend on, and the holes."""
        return (*self.lengths, *holes(self.cuts))


def countersunk_hole(head: FloatArray, grip_mm: float, sink_mm: float, size: str) -> tuple[Bore, Countersink]:
    """A hole along z for a countersunk screw, the top of its head at a point (3,), `sink_mm` over a part's lower face.

    It prints without support as the part stands: the cone leans 45 deg.
    """
    thread = thread_of(size)
    half, wide = thread.clearance_mm / 2.0, SUNK_HEAD * thread.diameter_mm / 2.0
    below = sink_mm + OUTSIDE_MM
    # A little steeper than the head, whose facets as printed must not lean more than 45 deg.
    cone = Countersink(head - below * ABOVE, ABOVE, wide + below, half, (wide + below - half) / np.tan(STEEP))
    return Bore(head, ABOVE, half, grip_mm + OUTSIDE_MM), cone


def tripod_depth_mm(nut: TripodNut) -> float:
    """Least thickness of a part with the nut of a tripod, which lies flush in its upper face."""
    return nut.floor_mm + thread_of(TRIPOD).nut_height_mm + NUT_FIT_MM


def tripod_cuts(top: FloatArray, thick_mm: float, nut: TripodNut) -> tuple[Bore, Hexagon]:
    """The pocket of a tripod's nut about a point (3,) of a part's upper face, and the hole under it.

    The nut goes in from above, and is held there by the mount's foot; the tripod presses the floor under it.
    """
    thread = thread_of(TRIPOD)
    mouth = top + OUTSIDE_MM * ABOVE
    return (
        Bore(mouth, -ABOVE, thread.clearance_mm / 2.0, thick_mm + 2.0 * OUTSIDE_MM),
        Hexagon(mouth, -ABOVE, None, thread.nut_flats_mm + NUT_FIT_MM, thick_mm - nut.floor_mm + OUTSIDE_MM),
    )


def tripod_nut(top: FloatArray, thick_mm: float, nut: TripodNut, part: str, explode_mm: FloatArray) -> BoughtItem:
    """The nut in the pocket of `tripod_cuts`, in a part of a name; it leaves by the part's upper face."""
    thread = thread_of(TRIPOD)
    way = 25.0 * ABOVE
    seat = top - (thick_mm - nut.floor_mm - thread.nut_height_mm) * ABOVE
    return BoughtItem("nut", TRIPOD, thread.nut_height_mm, along(seat, ABOVE), explode_mm + way, (part,), way[None])
