"""Screw holes of the holder: ends that print in solid material, slots square to the edge."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from build123d import GeomType
from shapely import Polygon, get_coordinates

from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.holder.holder_solid import make_holder
from mirrorcam.cad.holder.screw_holes import slot_way, tip_mm
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform


def on_back(plan: HolderPlan, loop: FloatArray) -> Polygon:
    """A loop (n, 3) as seen straight from the back."""
    return Polygon(loop @ plan.rig_from_mount[:3, :2])


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_blind_holes_end_in_cones_that_print(default_layout: Layout, kind: Literal["insert", "nut"]) -> None:
    """Round the end of a hole there is material, and it closes steeper than the printer must be able to do."""
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind=kind))
    plan = plan_holder(default_layout, hardware)
    part = make_holder(plan)
    into = -plan.rig_from_mount[:3, 2]
    cones = [face for face in part.faces() if face.geom_type == GeomType.CONE]
    assert len(cones) == 4
    for cone in cones:
        assert cone.semi_angle is not None
        assert 0.0 < cone.semi_angle < hardware.printer.overhang_deg
    for hole in transform(plan.rig_from_mount, np.column_stack([plan.holes_in_mount_mm, np.zeros(4)])):
        end = hole + (plan.hole_depth_mm + tip_mm(hardware.screw)) * into
        assert not part.is_inside(tuple(end - 0.05 * into))
        for over in (0.05, hardware.printer.wall_mm - 0.05):
            assert part.is_inside(tuple(end + over * into))


def test_slots_leave_square_to_the_edge(default_layout: Layout) -> None:
    """No tip of a wall stands over a slot: each leaves a side of the part's outline at a right angle, the nearest."""
    square = Polygon([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
    np.testing.assert_allclose(slot_way(square, np.array([3.0, 5.0])), [-1.0, 0.0])
    np.testing.assert_allclose(slot_way(square, np.array([5.0, 8.0])), [0.0, 1.0])
    plan = plan_holder(default_layout, HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind="nut")))
    corners = get_coordinates(on_back(plan, plan.slab.top).convex_hull)
    sides = np.diff(corners, axis=0) / np.linalg.norm(np.diff(corners, axis=0), axis=1)[:, None]
    ways = plan.slot_ways @ plan.rig_from_mount[:3, :2]
    assert len(ways) == 4
    np.testing.assert_allclose(np.abs(ways @ sides.T).min(axis=1), 0.0, atol=1e-9)
