"""Walls against stray light: between its mirrors the camera sees the holder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manifold3d import Manifold

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.part_checks import polygons
from mirrorcam.cad.holder.holder_body import HolderPlan, body_of
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.stray_light import MAX_STRAY_LIGHT, STEP_PX, rays_past_mirrors, stray_light, viewing_rays
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import keep_outs, mirror_prism
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.parabolas import parabola
from tests.nightly import a_few


def without_walls(plan: HolderPlan) -> HolderPlan:
    down = -0.1 * plan.rig_from_mount[:3, 2]
    walls = replace(plan.walls, outer_crest=plan.walls.outer_foot + down, inner_crest=plan.walls.inner_foot + down)
    return replace(plan, walls=walls)


@pytest.fixture(scope="module")
def plan(device: Device) -> HolderPlan:
    return device.holder


def mirror_solids(layout: Layout) -> list[Manifold]:
    return [Manifold.hull_points(np.vstack([volume.base, volume.top])) for volume in map(mirror_prism, layout.mirrors)]


@pytest.mark.slow
def test_walls_hide_the_surroundings_from_the_camera(default_layout: Layout, plan: HolderPlan) -> None:
    assert len(rays_past_mirrors(default_layout)) > 100
    assert (
        stray_light(default_layout, body_of(PlanarCsg(), plan), mirror_solids(default_layout)) < 0.1 * MAX_STRAY_LIGHT
    )
    # With larger gaps between mirrors, too much of the picture would show the surroundings without walls.
    free = parabola(3, 3)
    walled = plan_holder(free, HARDWARE)
    assert stray_light(free, body_of(PlanarCsg(), walled), mirror_solids(free)) < 0.2 * MAX_STRAY_LIGHT
    assert stray_light(free, body_of(PlanarCsg(), without_walls(walled)), mirror_solids(free)) > MAX_STRAY_LIGHT


def test_without_a_holder_all_light_between_mirrors_is_stray(default_layout: Layout) -> None:
    far = Manifold.cube((1.0, 1.0, 1.0)).translate((0.0, 0.0, -10.0))
    between, all_rays = len(rays_past_mirrors(default_layout)), len(viewing_rays(default_layout.camera))
    assert stray_light(default_layout, far, []) == pytest.approx(between / all_rays)
    assert all_rays == (default_layout.camera.width_px // STEP_PX) * (default_layout.camera.height_px // STEP_PX)


def test_walls_are_in_no_light_and_on_no_mirrors_path(default_layout: Layout, plan: HolderPlan) -> None:
    wall = PlanarCsg().solid(plan.walls)
    for mirror, group in zip(default_layout.mirrors, keep_outs(default_layout, HARDWARE), strict=True):
        for volume in group:
            hull = np.vstack([volume.base, volume.top])
            assert (wall ^ Manifold.hull_points(hull)).is_empty()
        blank = mirror_prism(mirror)
        way = np.vstack([blank.base, blank.top + 20.0 * mirror.normal_in_rig])
        assert (wall ^ Manifold.hull_points(way)).is_empty()


def test_walls_are_as_thick_as_the_table_says(plan: HolderPlan) -> None:
    outer, inner = (loop @ plan.rig_from_mount[:3, :2] for loop in (plan.walls.outer_crest, plan.walls.inner_crest))
    along = np.roll(outer, -1, axis=0) - outer
    across = np.abs(along[:, 0] * (inner - outer)[:, 1] - along[:, 1] * (inner - outer)[:, 0])
    np.testing.assert_allclose(across / np.linalg.norm(along, axis=1), HARDWARE.holder.shade_mm, atol=1e-9)
    assert PlanarCsg().solid(plan.walls).volume() > 1000.0


@pytest.mark.parametrize(("reach_mm", "slit"), a_few(1, [(HARDWARE.holder.shade_out_mm, False), (1.0, True)]))
def test_walls_leave_no_slit_beside_the_slab(default_layout: Layout, reach_mm: float, slit: bool) -> None:
    """Offsets of 0.25 mm outwards and back close gaps narrower than 0.5 mm; notches are a few mm2."""
    hardware = HARDWARE.replaced(holder=HARDWARE.holder.replaced(shade_out_mm=reach_mm))
    plan = plan_holder(default_layout, hardware)
    lying = body_of(PlanarCsg(), plan).transform(np.linalg.inv(plan.rig_from_mount)[:3])
    section = polygons(lying.slice(-HARDWARE.holder.floor_mm - 1.0))
    closed = section.buffer(0.25, join_style="mitre").buffer(-0.25, join_style="mitre").difference(section).area
    assert closed > 20.0 if slit else closed < 5.0


def test_a_hood_rises_above_the_mirrors_wherever_light_permits(default_layout: Layout, plan: HolderPlan) -> None:
    hood_mm = 25.0
    hardware = HARDWARE.replaced(holder=HARDWARE.holder.replaced(hood_mm=hood_mm))
    hooded = plan_holder(default_layout, hardware)

    def heights(points: np.ndarray) -> np.ndarray:
        return np.asarray((hooded.rig_from_mount[:3, 3] - points) @ hooded.rig_from_mount[:3, 2])

    highest = max(float(heights(mirror_prism(mirror).top).max()) for mirror in default_layout.mirrors)
    crest = heights(hooded.walls.outer_crest)
    assert crest.max() == pytest.approx(highest + hood_mm)
    assert (crest >= heights(plan.walls.outer_crest) - 1e-9).all()
    assert 0.2 < np.mean(crest > highest + 0.5 * hood_mm) < 0.9
    test_walls_are_in_no_light_and_on_no_mirrors_path(default_layout, hooded)
