"""No carrier: the device stands on a desk by itself, on a plate under the mount's foot, with a nut for a tripod."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirrorcam.cad.backs.back import Back, Neck, Stand
from mirrorcam.cad.backs.blocks import ALONG_X, ALONG_Y
from mirrorcam.cad.backs.foot_plate import BEHIND_MM, back_of_plate, foot_plate
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import DeskBack
from mirrorcam.cad.plan.dimension import length
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.values import FloatArray

(NAME,) = DeskBack.parts


def plan_desk(table: DeskBack, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out a plate so large that the device does not fall over when tipped by `tip_deg` and `spare_deg` more."""
    plate = foot_plate(table, mount, hardware)
    outline = _outline(table, mount, load, plate.low_z_mm)
    left, back = outline.min(axis=0)
    corner = np.array([left, back, plate.low_z_mm])
    chamfer = length(corner, corner + table.corner_mm * ALONG_X, "x 45°", before=f"{len(outline) // 2}x ")
    return replace(
        back_of_plate(table, NAME, "Desk foot", plate, outline, hardware, (chamfer,)),
        necks=(_before_mount(float(mount.slide[1]), outline, plate.low_z_mm + plate.thick_mm / 2.0, plate.thick_mm),),
        stand=Stand(outline, plate.low_z_mm, table.tip_deg),
    )


def _before_mount(slide_y: float, outline: FloatArray, z: float, thick: float) -> Neck:
    """The plate's section at the front of the mount, which bends where the device leans on the plate's front edge."""
    width, arm = float(np.ptp(outline[:, 0])), float(outline[:, 1].max()) - slide_y
    return Neck("plate before the mount", np.array([0.0, slide_y, z]), ALONG_Y, ALONG_X, (width, thick), arm)


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
