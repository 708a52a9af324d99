"""An aluminium profile of 20 mm: a plate on its slot, held by two T-nuts beside the mount."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.backs.back import AS_IT_STANDS, RGB, Back, BackPart, Carrier, Neck
from mirrorcam.cad.backs.blocks import ALONG_X, ALONG_Y, BlocksPlan, countersunk_hole
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.foot import foot_stack
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import ProfileBack
from mirrorcam.cad.plan.fasteners import COUNTERSUNK, OUTSIDE_MM, Bore, along, thread_of
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.cad.plan.prisms import box

(NAME,) = ProfileBack.parts
T_NUT = "M5 T-slot"
# From the mount to a screw's axis, and on to the end of the plate; the plate stands out so far before and behind.
BESIDE_MM, BEYOND_MM, OVER_MM = 9.0, 8.0, 3.0
SHOWN_MM = 120.0
# Deep below the face, the heads' holes leave a wall between each other.
FLARE_MM = 0.6


def plan_profile(table: ProfileBack, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out the plate over a profile along x, its slot under the hind screws of the mount's foot."""
    foot_z, m5 = mount.foot_z_mm, thread_of("M5")
    low_z, front = foot_z - table.plate_mm, float(mount.slide[1])
    heads = mount.foot - table.grip_mm * ABOVE
    y, x = float(heads[:, 1].min()), mount.half_width_mm + BESIDE_MM
    end, back = x + BEYOND_MM, front - mount.section.depth_mm
    sink = table.plate_mm - table.grip_mm
    cuts = [cut for head in heads for cut in countersunk_hole(head, table.grip_mm, sink, "M3", FLARE_MM)]
    grip = table.plate_mm - table.sunk_mm
    explode, items = np.array([0.0, 0.0, -45.0]), []
    for side in (-x, x):
        top = np.array([side, y, foot_z])
        cuts.append(Bore(top + OUTSIDE_MM * ABOVE, -ABOVE, m5.clearance_mm / 2.0, table.plate_mm + 1.0))
        cuts.append(
            Bore(
                top + OUTSIDE_MM * ABOVE,
                -ABOVE,
                m5.head_mm / 2.0 + 2.0 * hardware.fit.free_mm,
                table.sunk_mm + OUTSIDE_MM,
            )
        )
        head = top - table.sunk_mm * ABOVE
        items.append(BoughtItem("screw", "M5", table.screw_mm, along(head, ABOVE), explode + 30.0 * ABOVE, (NAME,)))
        nut = np.array([side, y, low_z - table.lip_mm])
        way = -30.0 * ABOVE
        items.append(BoughtItem("nut", T_NUT, table.nut_mm, along(nut, ABOVE), explode + way, (NAME,), way[None]))
    plan = BlocksPlan(NAME, (box((-end, back - OVER_MM, low_z), (end, front + OVER_MM, foot_z)),), tuple(cuts))
    half = table.profile_mm / 2.0
    profile = box((-SHOWN_MM, y - half, low_z - table.profile_mm), (SHOWN_MM, y + half, low_z))
    depth = front - back + 2.0 * OVER_MM
    # Both sides of the mount bear together.
    neck = Neck(
        "plate beside the mount",
        np.array([0.0, y, low_z + grip / 2.0]),
        ALONG_X,
        ALONG_Y,
        (2.0 * depth, table.plate_mm),
    )
    return Back(
        table=table,
        parts=(BackPart(NAME, "Profile plate", plan, AS_IT_STANDS, explode, RGB),),
        foot=foot_stack(table.grip_mm, hardware),
        foot_heads=heads,
        foot_size=f"M3{COUNTERSUNK}",
        items=tuple(items),
        carriers=(Carrier("profile", (profile,)),),
        necks=(neck,),
    )
