"""The drawings of the mirror holder and of carriers beside their sizes: their holes, and a table of their seats."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.guide.hole_callouts import DEPTH, INSERT, NUT, PRESSED
from mirrorcam.cad.holder.carriers import CarrierPlan
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.plan.dimension import DrawingTable, Hole
from mirrorcam.cad.plan.seats import newell_normal
from mirrorcam.core.values import FloatArray


def holder_holes(plan: HolderPlan) -> tuple[Hole, ...]:
    """The holes that the mount is screwed to, in the flat back."""
    rotation, origin = plan.rig_from_mount[:3, :3], plan.rig_from_mount[:3, 3]
    screw = plan.screw
    if screw.kind == "insert":
        diameter, text = screw.insert_hole_mm, f"{PRESSED} {DEPTH}{plan.hole_depth_mm:.4g} {INSERT} (far side)"
    else:
        diameter, text = screw.clearance_hole_mm, f"{DEPTH}{plan.hole_depth_mm:.4g} for M3, slot {NUT} (far side)"
    return tuple(
        Hole(origin + rotation[:, :2] @ hole, rotation[:, 2], diameter, text) for hole in plan.holes_in_mount_mm
    )


def seat_names(plan: HolderPlan) -> list[tuple[str, FloatArray]]:
    """Name of every seat's mirror, and the middle (3,) of its corners in rig."""
    return [(name, core.top.mean(axis=0)) for name, core in zip(plan.mirror_names, plan.cores, strict=True)]


def seat_table(plan: HolderPlan | CarrierPlan, bed_from_rig: FloatArray) -> DrawingTable:
    """Table of seat planes from the flat back: the middle of the seat, tilt and direction of tilt of its normal.

    `bed_from_rig` is a rotation (3, 3).
    """
    if isinstance(plan, CarrierPlan):
        seats = [(plan.name.rpartition("_")[2], plan.body.top, plan.pads[0].top)]
        back, origin = plan.rig_from_back, "its screws"
    else:
        names = (name for name, _ in seat_names(plan))
        seats = [
            (name, core.top, pads[0].top)
            for name, core, pads in zip(names, plan.cores, plan.pads_of_mirrors, strict=True)
        ]
        back, origin = plan.rig_from_mount, "the mount holes"
    rows = []
    for name, top, pad in seats:
        normal = newell_normal(top)
        on_pads = top + ((pad[0] - top[0]) @ normal) * normal
        corners = (on_pads - back[:3, 3]) @ bed_from_rig.T
        x, y, z = corners.mean(axis=0)
        normal = newell_normal(corners)
        normal = normal * np.sign(normal[2])
        tilt = np.degrees(np.arccos(min(float(normal[2]), 1.0)))
        towards = np.degrees(np.arctan2(normal[1], normal[0])) % 360.0
        rows.append((name, f"{x:.2f}", f"{y:.2f}", f"{z:.2f}", f"{tilt:.3f}", f"{towards:.2f}"))
    return DrawingTable(
        title="Seats (the planes of the pads that carry the mirrors)" if len(rows) > 1 else "Seat (plane of the pads)",
        head=("id", "x", "y", "z", "tilt °", "towards °"),
        rows=tuple(rows),
        notes=(
            f"x, y from the middle of {origin}, z from the flat back, mm,",
            "as in the view from above; tilt of the seat's normal from upright,",
            "towards: its direction, counter-clockwise from x",
        ),
    )
