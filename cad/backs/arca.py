"""A clamp of the kind of Arca-Swiss: a dovetail across the device, which prints standing on its end."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.backs.back import ON_ITS_SIDE, RGB, Back, BackPart, Neck
from mirrorcam.cad.backs.blocks import ALONG_X, BlocksPlan, head_cuts
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.foot import foot_stack
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import ArcaBack
from mirrorcam.cad.plan.dimension import length
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import along_x
from mirrorcam.core.values import InputError

(NAME,) = ArcaBack.parts


def plan_arca(table: ArcaBack, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out the dovetail; raises InputError where its slope is higher than all of it."""
    half, foot_z = mount.half_width_mm, mount.foot_z_mm
    wide, neck = table.width_mm / 2.0 - table.fit_mm, table.neck_mm / 2.0
    heads = mount.foot - table.grip_mm * ABOVE
    # Under the middle of the screws.
    y, low = float(heads[:, 1].mean()), foot_z - table.height_mm
    edge = low + table.lip_mm
    over = edge + wide - neck
    if not edge < over < foot_z:
        raise InputError(
            f"dovetail's slope ends {over - low:.1f} mm over its lower face, expected less than its height, "
            f"{table.height_mm:g} mm, and more than its lip, {table.lip_mm:g} mm"
        )
    tail = np.array([(-wide, low), (wide, low), (wide, edge), (neck, over), (-neck, over), (-wide, edge)])
    stem = np.array([(-neck, edge), (neck, edge), (neck, foot_z), (-neck, foot_z)])
    pieces = tuple(along_x(outline + np.array([y, 0.0]), -half, half) for outline in (tail, stem))
    lip = np.array([[half, y - wide, low], [half, y + wide, low]])
    plan = BlocksPlan(
        NAME,
        pieces,
        tuple(head_cuts(heads, table.grip_mm, ALONG_X, hardware)),
        (
            length(lip[0], lip[1], "dovetail"),
            length(np.array([half, y - neck, over]), np.array([half, y + neck, over])),
            length(lip[1], np.array([half, y + wide, edge])),
            length(lip[1], np.array([half, y + neck, over]), "", ABOVE),
        ),
    )
    return Back(
        table=table,
        parts=(BackPart(NAME, "Dovetail", plan, ON_ITS_SIDE, np.array([0.0, 0.0, -45.0]), RGB),),
        foot=foot_stack(table.grip_mm, hardware),
        foot_heads=heads,
        necks=(Neck("over the slope", np.array([0.0, y, over]), ABOVE, ALONG_X, (2.0 * half, 2.0 * neck)),),
    )
