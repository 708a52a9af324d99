"""The solid of the holder, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from build123d import GeomType
from manifold3d import Manifold
from shapely import Polygon, union_all

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.back import BLUNT_RADIUS_MM, slot_width_mm, tip_mm
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.holder.holder_solid import check_gaps, make_holder, solid_of
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.rims import GROUND_MM
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout


def test_a_frustums_solid_has_its_volume() -> None:
    base = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 2.0, 0.0], [0.0, 2.0, 0.0]])
    top = base + np.array([0.5, 0.25, 4.0])
    assert solid_of(Frustum(base, top)).volume == pytest.approx(24.0)
    pyramid = solid_of(Frustum(base, np.array([[7.0, 7.0, 4.0]])))
    assert pyramid.volume == pytest.approx(8.0)
    assert pyramid.is_valid


def without_walls(plan: HolderPlan) -> HolderPlan:
    """The plan with the crests of its walls inside the flange."""
    down = -0.1 * plan.rig_from_mount[:3, 2]
    walls = replace(plan.walls, outer_crest=plan.walls.outer_foot + down, inner_crest=plan.walls.inner_foot + down)
    return replace(plan, walls=walls)


def on_back(plan: HolderPlan, loop: FloatArray) -> Polygon:
    """A loop (n, 3) projected along the back's normal."""
    return Polygon(loop @ plan.rig_from_mount[:3, :2])


def height(plan: HolderPlan, point: FloatArray) -> float:
    """Height of a point (3,) above the back."""
    return float((plan.rig_from_mount[:3, 3] - point) @ plan.rig_from_mount[:3, 2])


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_two_mirrors_in_one_plane_give_a_plate_of_known_volume(
    make_flat_pair: Callable[..., Layout], kind: Literal["insert", "nut"]
) -> None:
    """All seats coplanar: a plate with rims on a flange, minus its grooves and holes."""
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind=kind))
    layout = make_flat_pair(gap_mm=8.0, width_mm=40.0, height_mm=30.0, thickness_mm=2.0)
    plan = without_walls(plan_holder(layout, hardware))
    margin, dimensions, screw = hardware.fit.free_mm + hardware.holder.rim_mm, hardware.holder, hardware.screw
    # A rim's ground is slightly wider than its rim, and all of it is on the plate.
    margin += GROUND_MM
    tip = tip_mm(screw)
    depth = plan.hole_depth_mm + tip + dimensions.groove_depth_mm + hardware.printer.floor_mm
    plate = on_back(plan, plan.slab.top)
    assert plate.area == pytest.approx((2 * 40.0 + 8.0 + 2 * margin) * (30.0 + 2 * margin) - 4 * margin**2 / 2)
    assert height(plan, plan.slab.top[0]) == pytest.approx(depth)
    assert union_all([on_back(plan, solid.top) for solid in plan.rims[1::2]]).difference(plate).area < 1e-9
    expected = plate.area * depth + (on_back(plan, plan.flange.top).area - plate.area) * dimensions.floor_mm
    rim_mm = dimensions.bond_mm + dimensions.rim_height_of_sheet * 2.0
    expected += sum(on_back(plan, rim.top).area for rim in plan.rims[::2]) * rim_mm
    expected += sum(on_back(plan, pad.top).area for pad in plan.pads) * dimensions.bond_mm
    expected -= (
        sum(on_back(plan, groove.base).intersection(plate).area for groove in plan.grooves) * dimensions.groove_depth_mm
    )
    part = make_holder(plan)
    if kind == "insert":
        wide, blunt = screw.insert_hole_mm / 2.0, BLUNT_RADIUS_MM
        expected -= 4 * math.pi * wide**2 * screw.insert_depth_mm
        expected -= 4 * math.pi * tip * (wide**2 + wide * blunt + blunt**2) / 3.0
        assert part.volume == pytest.approx(expected, rel=1e-9)
    else:
        half, (begin, end) = slot_width_mm(hardware) / 2.0, plan.thread_mm
        slot = half * (2.0 * (end - begin) + half)
        assert part.volume < expected - 4 * slot * screw.nut_flats_mm
    assert len(plan.grooves) == 12
    assert len(part.solids()) == 1
    assert part.is_valid


def test_the_back_is_one_flat_face(device: Device) -> None:
    plan = device.holder
    part = make_holder(plan)
    away = plan.rig_from_mount[:3, 2]
    flat = part.faces().filter_by(GeomType.PLANE)
    backs = [face for face in flat if np.array(tuple(face.normal_at())) @ away > 1.0 - 1e-12]
    outermost = max(backs, key=lambda face: float(np.array(tuple(face.center())) @ away))
    assert len(outermost.inner_wires()) == 4
    drilled = part.faces().filter_by(GeomType.CYLINDER)
    assert len(drilled) == 4
    assert all(face.radius == pytest.approx(HARDWARE.screw.insert_hole_mm / 2) for face in drilled)
    # Nothing protrudes from it: the part is flat on the bed.
    corners = np.array([tuple(vertex) for vertex in part.vertices()]) @ away
    assert corners.max() == pytest.approx(float(np.array(tuple(outermost.center())) @ away))


@pytest.mark.slow
def test_grooves_cut_nothing_out_of_the_walls(fold_90_layout: Layout) -> None:
    """A groove passes through its rim; a slot in the wall behind the rim would have a ceiling, which needs support."""
    plan = plan_holder(fold_90_layout, HARDWARE)
    wall, solid = PlanarCsg().solid(plan.walls), make_holder(plan).solid()
    assert solid is not None
    bites = [
        np.asarray(bite.to_mesh64().vert_properties)[:, :3].mean(axis=0)
        for groove in plan.grooves
        for bite in (wall ^ Manifold.hull_points(np.vstack([groove.base, groove.top]))).decompose()
        if bite.volume() > 1e-3
    ]
    assert len(bites) >= 4
    assert all(solid.is_inside(tuple(middle)) for middle in bites)


def test_sheets_that_nearly_touch_are_refused(make_flat_pair: Callable[..., Layout]) -> None:
    check_gaps(make_flat_pair(gap_mm=0.31), HARDWARE)
    with pytest.raises(
        InputError, match=r"mirrors 0-0 and 0-1 are 0\.25 mm apart as cut from sheet, expected at least 0\.30"
    ):
        check_gaps(make_flat_pair(gap_mm=0.25), HARDWARE)


def test_a_holder_that_the_light_cuts_apart_is_refused(make_flat_pair: Callable[..., Layout]) -> None:
    body = plan_holder(make_flat_pair(gap_mm=30.0), HARDWARE)
    origin, turn = body.rig_from_mount[:3, 3], body.rig_from_mount[:3, :3]
    square = np.array([[-5.0, -60.0, 1.0], [5.0, -60.0, 1.0], [5.0, 60.0, 1.0], [-5.0, 60.0, 1.0]])
    slot = Frustum(square @ turn.T + origin, (square - [0.0, 0.0, 60.0]) @ turn.T + origin)
    parted = replace(body, keep_outs=(*body.keep_outs, (slot,)))
    with pytest.raises(InputError, match="falls apart into 2 pieces where the light passes"):
        make_holder(parted)
