"""A plate under the mount's foot with a nut for a tripod's screw: alone on a tripod, or larger, as a stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.backs.back import AS_IT_STANDS, RGB, Back, BackPart
from mirrorcam.cad.backs.blocks import BlocksPlan, countersunk_hole, tripod_cuts, tripod_depth_mm, tripod_nut
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.foot import foot_stack
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import DeskBack, TripodBack
from mirrorcam.cad.plan.dimension import Length
from mirrorcam.cad.plan.fasteners import COUNTERSUNK
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray

BEHIND_MM = 2.0
"""How far a plate reaches behind the mount: the wall of the nut's pocket."""

EXPLODE = np.array([0.0, 0.0, -45.0])


@dataclass(frozen=True)
class FootPlate:
    """Where a plate under the mount's foot is, in rig, mm.

    Its faces are at `low_z_mm` and `thick_mm` higher, the heads of its screws rest at points (4, 3), and its nut is
    about a point (3,) of the upper face: between the hind screws, where all of the mount's foot is over the nut.
    """

    low_z_mm: float
    thick_mm: float
    heads: FloatArray
    nut_at: FloatArray


def foot_plate(table: DeskBack | TripodBack, mount: MountPlan, hardware: Hardware) -> FootPlate:
    """A plate thick enough for the nut, and for the countersunk heads of the foot's screws."""
    foot_z = mount.foot_z_mm
    thick = max(tripod_depth_mm(table.nut), table.grip_mm + hardware.fit.free_mm)
    heads = mount.foot - table.grip_mm * ABOVE
    return FootPlate(foot_z - thick, thick, heads, np.array([0.0, float(heads[:, 1].min()), foot_z]))


def back_of_plate(
    table: DeskBack | TripodBack,
    name: str,
    title: str,
    plate: FootPlate,
    outline: FloatArray,
    hardware: Hardware,
    lengths: tuple[Length, ...] = (),
) -> Back:
    """The back of one plate with an outline (n, 2; x and y), without its necks and what it stands on."""
    base = np.column_stack([outline, np.full(len(outline), plate.low_z_mm)])
    sink = plate.thick_mm - table.grip_mm
    cuts = (
        *(cut for head in plate.heads for cut in countersunk_hole(head, table.grip_mm, sink, "M3")),
        *tripod_cuts(plate.nut_at, plate.thick_mm, table.nut),
    )
    plan = BlocksPlan(name, (Frustum(base, base + plate.thick_mm * ABOVE),), cuts, lengths)
    return Back(
        table=table,
        parts=(BackPart(name, title, plan, AS_IT_STANDS, EXPLODE, RGB),),
        foot=foot_stack(table.grip_mm, hardware),
        foot_heads=plate.heads,
        foot_size=f"M3{COUNTERSUNK}",
        items=(tripod_nut(plate.nut_at, plate.thick_mm, table.nut, name, EXPLODE),),
    )
