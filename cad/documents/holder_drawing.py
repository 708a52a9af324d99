"""The drawing of the mirror holder beside its size: its holes, and a table of its seats."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.documents.hole_callouts import DEPTH
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.plan.dimension import DrawingTable, Hole
from mirrorcam.cad.plan.seats import newell_normal
from mirrorcam.optics.base.values import FloatArray


def holder_holes(plan: HolderPlan) -> tuple[Hole, ...]:
    """The holes that the mount is screwed to, in the flat back."""
    rotation, origin = plan.rig_from_mount[:3, :3], plan.rig_from_mount[:3, 3]
    screw = plan.screw
    if screw.kind == "insert":
        diameter, text = screw.insert_hole_mm, f"{DEPTH}{plan.hole_depth_mm:.4g} insert M3 (far side)"
    else:
        diameter, text = screw.clearance_hole_mm, f"{DEPTH}{plan.hole_depth_mm:.4g} slot for nut M3 (far side)"
    return tuple(
        Hole(origin + rotation[:, :2] @ hole, rotation[:, 2], diameter, text) for hole in plan.holes_in_mount_mm
    )


def seat_names(plan: HolderPlan) -> list[tuple[str, FloatArray]]:
    """Name of every seat's mirror, and the middle (3,) of its corners in rig."""
    return [(name, core.top.mean(axis=0)) for name, core in zip(plan.mirror_names, plan.cores, strict=True)]


def seat_table(plan: HolderPlan) -> DrawingTable:
    """Table of seat planes from the flat back: the middle of the seat, tilt and direction of tilt of its normal."""
    bed_from_mount = np.diag([1.0, -1.0, -1.0])
    rotation = bed_from_mount @ plan.rig_from_mount[:3, :3].T
    rows = []
    for (name, _), core, pads in zip(seat_names(plan), plan.cores, plan.pads_of_mirrors, strict=True):
        normal = newell_normal(core.top)
        on_pads = core.top + ((pads[0].top[0] - core.top[0]) @ normal) * normal
        corners = (on_pads - plan.rig_from_mount[:3, 3]) @ rotation.T
        x, y, z = corners.mean(axis=0)
        normal = newell_normal(corners)
        normal = normal * np.sign(normal[2])
        tilt = np.degrees(np.arccos(min(float(normal[2]), 1.0)))
        towards = np.degrees(np.arctan2(normal[1], normal[0])) % 360.0
        rows.append((name, f"{x:.2f}", f"{y:.2f}", f"{z:.2f}", f"{tilt:.3f}", f"{towards:.2f}"))
    return DrawingTable(
        title="Seats (the planes of the pads that carry the mirrors)",
        head=("id", "x", "y", "z", "tilt °", "towards °"),
        rows=tuple(rows),
        notes=(
            "x, y from the middle of the mount holes, z from the flat back, mm,",
            "as in the view from above; tilt of the seat's normal from upright,",
            "towards: its direction, counter-clockwise from x",
        ),
    )
