"""A stand or an arm for monitors (VESA MIS-D): a bracket with four M4 nuts in the front of its plate."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.backs.back import BACK_DOWN, RGB, Back, BackPart, Carrier
from mirrorcam.cad.backs.blocks import ALONG_X, ALONG_Y
from mirrorcam.cad.backs.bracket import plan_bracket, plate_neck
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.foot import foot_stack
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import VesaBack
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, Bore, Hexagon, along, thread_of
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.seats import Frustum

(NAME,) = VesaBack.parts
EXPLODE = np.array([0.0, -60.0, -45.0])
# From a screw to the plate's edge, from the shelf to the upper screws, and the ribs from the middle.
EDGE_MM, UNDER_MM, RIB_X_MM = 8.0, 14.0, 26.0


def plan_vesa(table: VesaBack, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out the bracket; its plate is open in the middle."""
    m4, at, thick = thread_of("M4"), table.square_mm / 2.0, table.plate_mm
    spots = [(x, z) for x in (-at, at) for z in (-at, at)]
    deep = m4.nut_height_mm + NUT_FIT_MM
    cuts: list[Frustum | Bore | Hexagon] = []
    for x, z in spots:
        mouth = np.array([x, thick + OUTSIDE_MM, z])
        cuts.append(Bore(mouth, -ALONG_Y, m4.clearance_mm / 2.0, thick + 2.0 * OUTSIDE_MM))
        cuts.append(Hexagon(mouth, -ALONG_Y, None, m4.nut_flats_mm + NUT_FIT_MM, deep + OUTSIDE_MM))
    window, low, high = RIB_X_MM - 6.0, -at + 4.0, at - 12.0
    cuts.append(box((-window, -1.0, low), (window, thick + 1.0, high)))
    corner, upper = np.array([-window, thick, low]), np.array([-window, thick, high])
    ends = (
        (corner, corner + 2.0 * window * ALONG_X),
        (corner, upper),
        (upper, np.array([-window, thick, at + UNDER_MM])),
    )
    half = at + EDGE_MM
    bracket = plan_bracket(
        NAME, at + UNDER_MM, (half, half, thick), RIB_X_MM, tuple(cuts), table.grip_mm, mount, hardware, ends
    )
    middle, items = bracket.middle, []
    for x, z in spots:
        place = middle + np.array([x, -table.arm_mm, z])
        items.append(
            BoughtItem("screw", "M4", table.screw_mm, along(place, -ALONG_Y), EXPLODE - 30.0 * ALONG_Y, (NAME,))
        )
        seat, way = middle + np.array([x, thick - deep, z]), 25.0 * ALONG_Y
        frame = along(seat, -ALONG_Y)
        items.append(BoughtItem("nut", "M4", m4.nut_height_mm, frame, EXPLODE + way, (NAME,), way[None]))
    arm = box(
        (-half, float(middle[1]) - table.arm_mm, float(middle[2]) - half),
        (half, float(middle[1]), float(middle[2]) + half),
    )
    return Back(
        table=table,
        parts=(BackPart(NAME, "VESA bracket", bracket.plan, BACK_DOWN, EXPLODE, RGB),),
        foot=foot_stack(table.grip_mm, hardware),
        foot_heads=bracket.heads,
        items=tuple(items),
        carriers=(Carrier("arm", (arm,)),),
        necks=(bracket.neck, plate_neck(bracket, 2.0 * half, thick, at + 5.0)),
    )
