"""A tripod: a plate as large as the mount's foot, with a nut in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirrorcam.cad.backs.back import Back, Carrier, Neck
from mirrorcam.cad.backs.blocks import ALONG_X, ALONG_Y
from mirrorcam.cad.backs.foot_plate import BEHIND_MM, back_of_plate, foot_plate
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import TripodBack
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import box

(NAME,) = TripodBack.parts
# The tripod's head: a plate that is kept clear, as a common ball head has it.
HEAD_MM = (50.0, 20.0)
# The plate reaches this far before the mount: the wall of the countersinks.
BEFORE_MM = 1.0


def plan_tripod(table: TripodBack, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out a plate under all of the mount's foot."""
    plate = foot_plate(table, mount, hardware)
    half, front = mount.half_width_mm, float(mount.slide[1]) + BEFORE_MM
    back = float(mount.slide[1]) - mount.section.depth_mm - BEHIND_MM
    outline = np.array([(half, back), (half, front), (-half, front), (-half, back)])
    low_z, y = plate.low_z_mm, float(plate.nut_at[1])
    side, high = HEAD_MM[0] / 2.0, HEAD_MM[1]
    head = box((-side, y - side, low_z - high), (side, y + side, low_z))
    # Tipped over the edge of the tripod's head, the plate bends across the nut's pocket.
    neck = Neck(
        "plate beside the nut",
        np.array([0.0, y, low_z + plate.thick_mm / 2.0]),
        ALONG_Y,
        ALONG_X,
        (2.0 * half - table.nut.pocket_mm, plate.thick_mm),
        front - back,
    )
    return replace(
        back_of_plate(table, NAME, "Tripod plate", plate, outline, hardware),
        carriers=(Carrier("tripod", (head,)),),
        necks=(neck,),
    )
