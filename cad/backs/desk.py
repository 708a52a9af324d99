"""No carrier: the device stands on a desk by itself, on a plate under the mount's foot, with a nut for a tripod."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.backs.back import AS_IT_STANDS, Back, BackPart, Neck, Stand
from mirrorcam.cad.backs.blocks import ALONG_X, BlocksPlan, countersunk_hole, tripod_cuts, tripod_depth_mm, tripod_nut
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.foot import foot_screws, foot_stack, foot_z_mm
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import DeskBack
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import COUNTERSUNK
from mirrorcam.optics.base.values import FloatArray

NAME = "adapter_desk"
# How far the plate reaches behind the mount: the wall of the nut's pocket.
BEHIND_MM = 2.0
RGB = (0.35, 0.60, 0.42)


def plan_desk(table: DeskBack, clip: ClipPlan, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out a plate so large that the device does not fall over when tipped by `tip_deg` and `spare_deg` more."""
    foot_z = foot_z_mm(clip, hardware)
    foot = foot_stack(table.grip_mm, hardware)
    thick = max(tripod_depth_mm(table.nut), table.grip_mm + hardware.fit.free_mm)
    low_z = foot_z - thick
    outline = _outline(table, mount, load, low_z)
    base = np.column_stack([outline, np.full(len(outline), low_z)])
    heads = foot_screws(clip, hardware) - table.grip_mm * ABOVE
    # Between the hind screws, where all of the mount's foot is over the nut.
    top = np.array([0.0, float(heads[:, 1].min()), foot_z])
    cuts = [
        *(cut for head in heads for cut in countersunk_hole(head, table.grip_mm, thick - table.grip_mm, "M3")),
        *tripod_cuts(top, thick, table.nut),
    ]
    explode = np.array([0.0, 0.0, -45.0])
    plan = BlocksPlan(NAME, (Frustum(base, base + thick * ABOVE),), tuple(cuts))
    return Back(
        table=table,
        parts=(BackPart(NAME, "Desk foot", plan, AS_IT_STANDS, explode, RGB),),
        foot=foot,
        foot_heads=heads,
        foot_size=f"M3{COUNTERSUNK}",
        items=(tripod_nut(top, thick, table.nut, NAME, explode),),
        necks=(_before_mount(clip.slide_y_mm, outline, foot_z - thick / 2.0, thick),),
        stand=Stand(outline, low_z, table.tip_deg),
    )


def _before_mount(slide_y: float, outline: FloatArray, z: float, thick: float) -> Neck:
    """The plate's section at the front of the mount, which bends where the device leans on the plate's front edge."""
    width, arm = float(np.ptp(outline[:, 0])), float(outline[:, 1].max()) - slide_y
    return Neck(
        "plate before the mount", np.array([0.0, slide_y, z]), np.array([0.0, 1.0, 0.0]), ALONG_X, (width, thick), arm
    )


def _outline(table: DeskBack, mount: MountPlan, load: Load, low_z: float) -> FloatArray:
    """The plate's outline (n, 2; x and y): under all of the mount's foot, and as far about the load as it may tip."""
    reach = float((load.at[2] - low_z) * np.tan(np.radians(table.tip_deg + table.spare_deg)))
    # Over a corner that is cut off it falls no sooner than over a side.
    cut = table.corner_mm
    half = max(mount.half_width_mm, abs(float(load.at[0])) + reach)
    back = min(float(mount.slide[1]) - mount.section.depth_mm - BEHIND_MM, float(load.at[1]) - reach)
    front = max(float(mount.slide[1]), float(load.at[1]) + reach)
    corners = []
    for (x, y), first in (((half, front), 0), ((-half, front), 1), ((-half, back), 0), ((half, back), 1)):
        ends = [(x, y - np.sign(y - (front + back) / 2.0) * cut), (x - np.sign(x) * cut, y)]
        corners += ends if first == 0 else ends[::-1]
    return np.array(corners)
