"""A tripod: a plate as large as the mount's foot, with a nut in it."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.backs.back import AS_IT_STANDS, Back, BackPart, Carrier, Neck
from mirrorcam.cad.backs.blocks import ALONG_X, BlocksPlan, countersunk_hole, tripod_cuts, tripod_depth_mm, tripod_nut
from mirrorcam.cad.backs.desk import BEHIND_MM, RGB
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.foot import foot_screws, foot_stack, foot_z_mm
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import TripodBack
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.threads import COUNTERSUNK

NAME = "adapter_tripod"
# The tripod's head: a plate that is kept clear, as a common ball head has it.
HEAD_MM = (50.0, 20.0)


def plan_tripod(table: TripodBack, clip: ClipPlan, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out a plate under all of the mount's foot."""
    foot_z, foot = foot_z_mm(clip, hardware), foot_stack(table.grip_mm, hardware)
    thick = max(tripod_depth_mm(table.nut), table.grip_mm + hardware.fit.free_mm)
    half, front = mount.half_width_mm, float(mount.slide[1])
    back = front - mount.section.depth_mm - BEHIND_MM
    heads = foot_screws(clip, hardware) - table.grip_mm * ABOVE
    top = np.array([0.0, float(heads[:, 1].min()), foot_z])
    cuts = [
        *(cut for head in heads for cut in countersunk_hole(head, table.grip_mm, thick - table.grip_mm, "M3")),
        *tripod_cuts(top, thick, table.nut),
    ]
    explode, low_z = np.array([0.0, 0.0, -45.0]), foot_z - thick
    plan = BlocksPlan(NAME, (box((-half, back, low_z), (half, front, foot_z)),), tuple(cuts))
    side, high = HEAD_MM[0] / 2.0, HEAD_MM[1]
    head = box((-side, top[1] - side, low_z - high), (side, top[1] + side, low_z))
    at = np.array([0.0, top[1], low_z + thick / 2.0])
    return Back(
        table=table,
        parts=(BackPart(NAME, "Tripod plate", plan, AS_IT_STANDS, explode, RGB),),
        foot=foot,
        foot_heads=heads,
        foot_size=f"M3{COUNTERSUNK}",
        items=(tripod_nut(top, thick, table.nut, NAME, explode),),
        carriers=(Carrier("tripod", (head,)),),
        # Tipped over the edge of the tripod's head, the plate bends across the nut's pocket.
        necks=(
            Neck(
                "plate beside the nut",
                at,
                np.array([0.0, 1.0, 0.0]),
                ALONG_X,
                (2.0 * half - table.nut.pocket_mm, thick),
                front - back,
            ),
        ),
    )
