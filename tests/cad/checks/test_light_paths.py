"""Light traced from the pupil, and obstacles in it or near it.

The camera's view at the steps with pictures: the full board, and later every mirror.

Light from the surroundings on a mirror, against closed forms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import manifold3d
import numpy as np
import pytest
from manifold3d import Manifold

from mirrorcam.cad.assembly.build_steps import STEPS, Step
from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.device_checks import ASSEMBLY, read_glb
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.light_paths import (
    MAX_GAP_MM,
    RAYS_PER_MIRROR,
    START_MM,
    SURFACE_MM,
    check_light,
    check_step_views,
    check_surrounding_light,
    light_of,
    light_of_rim,
    shade_of_mirrors,
)
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import mirror_prism
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

FAR = Manifold.cube((1.0, 1.0, 1.0)).translate((0.0, -500.0, -500.0))


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def block(centre: FloatArray, size: float) -> Manifold:
    return Manifold.cube((size, size, size), True).translate(tuple(centre))


def sheets_of(layout: Layout) -> list[Manifold | None]:
    return [
        Manifold.hull_points(np.vstack([mirror_prism(mirror).base, mirror_prism(mirror).top]))
        for mirror in layout.mirrors
    ]


def checked(layout: Layout, part: Manifold = FAR, camera: Manifold | None = None) -> dict[str, Metric]:
    return check_light(layout, HARDWARE, {"part": part}, sheets_of(layout), camera)


def directions_of(segments: FloatArray) -> FloatArray:
    away = segments[:, 1] - segments[:, 0]
    return np.asarray(away / np.linalg.norm(away, axis=1, keepdims=True))


def test_light_of_first_surface_mirrors_obeys_the_law_of_reflection(default_layout: Layout) -> None:
    for index, mirror in enumerate(default_layout.mirrors):
        light = light_of(default_layout, index, HARDWARE)
        to_pupil, to_scene = light.rays
        np.testing.assert_allclose(to_pupil[:, 1], 0.0)
        np.testing.assert_allclose(to_scene[:, 1] @ default_layout.view_from_rig[2], 500.0)
        assert light.grid_count >= 0.9 * RAYS_PER_MIRROR
        # From the mirror image of the pupil, the ray to the scene is straight.
        seen = to_scene - mirror.virtual_centre_in_rig_mm
        straight = np.cross(seen[:, 0], seen[:, 1]) / np.linalg.norm(seen[:, 1], axis=1)[:, None]
        np.testing.assert_allclose(straight, 0.0, atol=1e-9)
        on_plane = to_scene[:, 0] - SURFACE_MM * directions_of(to_scene)
        np.testing.assert_allclose(on_plane @ mirror.normal_in_rig, -mirror.distance_mm, atol=1e-9)
        # The edge of the light is the edge of the mirror: their hulls have the outline's corners.
        outline = mirror.outline_in_rig_mm
        nearest = np.linalg.norm(outline[:, None] - on_plane[None, light.grid_count :], axis=2).min(axis=1)
        np.testing.assert_allclose(nearest, 0.0, atol=1e-6)


def test_light_of_second_surface_mirrors_enters_and_leaves_through_the_front(
    make_parabola: Callable[..., Layout],
) -> None:
    """Angles of incidence and exit are equal, and entry and exit are 2 t tan a' apart, sin a = n sin a'."""
    layout = make_parabola(2, 2, surface="second", thickness_mm=2.0, gap_mm=4.0)
    for index, mirror in enumerate(layout.mirrors):
        to_pupil, to_scene = light_of(layout, index, HARDWARE).rays
        normal = mirror.normal_in_rig
        met, left = (segments[:, 0] - SURFACE_MM * directions_of(segments) for segments in (to_pupil, to_scene))
        for points in (met, left):
            np.testing.assert_allclose(points @ normal + mirror.distance_mm, mirror.thickness_mm, atol=1e-9)
        cosine = directions_of(to_pupil) @ normal
        np.testing.assert_allclose(directions_of(to_scene) @ normal, cosine, atol=1e-9)
        inside = np.arcsin(np.sqrt(1.0 - cosine**2) / mirror.refractive_index)
        np.testing.assert_allclose(np.linalg.norm(left - met, axis=1), 4.0 * np.tan(inside), atol=1e-6)


def test_light_through_the_rim_of_the_pupil_starts_there_and_is_reflected(default_layout: Layout) -> None:
    mirror = default_layout.mirrors[4]
    radius_mm = default_layout.camera.pupil.radius_mm
    to_pupil, to_scene = light_of_rim(default_layout, 4, HARDWARE)
    from_middle = np.linalg.norm(to_pupil[:, 1], axis=1).reshape(-1, 9)
    np.testing.assert_allclose(from_middle[:, 0], 0.0)
    np.testing.assert_allclose(from_middle[:, 1:], radius_mm)
    np.testing.assert_allclose(to_pupil[:, 1, 2], 0.0)
    np.testing.assert_allclose(directions_of(to_scene), -directions_of(to_pupil) @ mirror.reflection, atol=1e-9)


@pytest.mark.parametrize("share", [0.6, 1.4])
def test_a_block_in_the_light_is_found(default_layout: Layout, share: float) -> None:
    """Between pupil and mirror (0.6 of the distance), and between mirror and scene (1.4)."""
    mirror = default_layout.mirrors[4]
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    point = middle * min(share, 1.0) + (mirror.reflection @ middle) * max(share - 1.0, 0.0)
    checks = checked(default_layout, block(point, 3.0))
    assert failed(checks) == {"device.rays_blocked", "device.rim_light_stopped", "part.light_gap_mm"}
    assert 0 < checks["device.rays_blocked"].value < 600
    assert checks["part.light_gap_mm"].value == 0.0
    assert failed(checked(default_layout)) == set()


def test_the_gap_of_a_speck_to_the_light_is_its_distance_from_the_nearest_ray(fold_90_layout: Layout) -> None:
    """Specks between pupil and mirrors: rays are up to 1.5 steps apart, and the hull fills the gaps."""
    rays = np.concatenate([light_of(fold_90_layout, index, HARDWARE).rays[0] for index in range(9)])
    starts, along = rays[:, 0], rays[:, 1] - rays[:, 0]
    generator = np.random.default_rng(0)
    for _ in range(8):
        point = generator.uniform((-40.0, -40.0, 20.0), (40.0, 20.0, 60.0))
        share = np.clip(((point - starts) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
        nearest = float(np.linalg.norm(point - starts - share[:, None] * along, axis=1).min())
        gap = checked(fold_90_layout, block(point, 0.01))["part.light_gap_mm"].value
        assert max(min(nearest, MAX_GAP_MM) - 1.5, 0.0) <= gap <= nearest


def test_a_plate_behind_a_mirror_is_as_near_as_its_gap(make_flat_pair: Callable[..., Layout]) -> None:
    """A plate parallel to the mirrors, 0.15 mm behind their reflecting plane, is too near; 0.25 mm is not."""
    layout = make_flat_pair(gap_mm=8.0)
    for gap, near in ((0.15, True), (0.25, False)):
        # The plane is y = z - 80: a plate rotated about x by 45 deg is parallel to it.
        plate = Manifold.cube((100.0, 60.0, 5.0)).translate((-50.0, -30.0, gap)).rotate((45.0, 0.0, 0.0))
        checks = checked(layout, plate.translate((0.0, 0.0, 80.0)))
        assert checks["part.light_gap_mm"].value == pytest.approx(gap, abs=2e-3)
        assert failed(checks) == ({"part.light_gap_mm"} if near else set())


def test_the_camera_may_hold_the_pupil_but_not_stand_in_the_view(default_layout: Layout) -> None:
    assert failed(checked(default_layout, camera=block(np.zeros(3), 30.0))) == set()
    middle = default_layout.mirrors[4].outline_in_rig_mm.mean(axis=0)
    in_view = block(middle + 200.0 * default_layout.view_from_rig[2], 30.0)
    assert failed(checked(default_layout, camera=in_view)) == {"device.rays_blocked"}


def test_sheets_shade_each_other_only_where_one_stands_before_another(default_layout: Layout) -> None:
    def shade(layout: Layout) -> float:
        lights = [light_of(layout, index, HARDWARE) for index in range(len(layout.mirrors))]
        return shade_of_mirrors(lights, sheets_of(layout))

    assert shade(default_layout) == 0.0
    # A mirror on the same rays, but nearer to the pupil, blocks the light from its neighbour.
    mirrors = list(default_layout.mirrors)
    centre, outline = mirrors[1].virtual_centre_in_rig_mm, mirrors[1].outline_in_rig_mm
    mirrors[1] = mirrors[1].replaced(virtual_centre_in_rig_mm=0.95 * centre, outline_in_rig_mm=0.95 * outline)
    shaded = default_layout.replaced(mirrors=tuple(mirrors))
    assert 0.02 < shade(shaded) < 0.25
    assert failed(checked(shaded)) == {"device.shade_of_sheets"}


def test_a_mirror_that_shows_nothing_is_found(make_flat_pair: Callable[..., Layout]) -> None:
    """Light at 45 deg travels 2 x 1.6 mm along a plate of 3 mm (n = 1.49), and exits outside a mirror of 2.5 mm."""
    layout = make_flat_pair(gap_mm=8.0, height_mm=2.5)
    narrow = tuple(mirror.replaced(surface="second", thickness_mm=3.0) for mirror in layout.mirrors)
    checks = checked(layout.replaced(mirrors=narrow))
    assert checks["device.mirrors_without_light"].value == 2.0
    assert "device.mirrors_without_light" in failed(checks)


BASE, FRAMES = "device.base_pictures_hidden", "device.frames_pictures_hidden"
Built = tuple[Layout, Path, dict[str, Metric]]
Solids = dict[str, manifold3d.Manifold]


@pytest.fixture(scope="module")
def solids(built_default: Built) -> Solids:
    return {name: solid_of(mesh) for name, mesh in read_glb(built_default[1] / ASSEMBLY).items()}


def hidden(device: Device, solids: Solids, steps: tuple[Step, ...] = STEPS) -> dict[str, float]:
    checks = check_step_views(device.layout, purchased_items(device), solids, steps)
    assert all(check.limit == 0.0 for check in checks.values())
    return {name: check.value for name, check in checks.items()}


def test_the_guide_takes_its_pictures_when_the_view_is_free(device: Device, solids: Solids) -> None:
    assert hidden(device, solids) == {BASE: 0.0, FRAMES: 0.0}


def test_the_bare_mount_hides_the_board(device: Device, solids: Solids) -> None:
    """The order of a former guide: at its last step the holder was removed, and the clip remained on the mount."""
    kept = [replace(step, pictures="") for step in STEPS if step.name not in ("mirrors", "holder", "calibrate")]
    share = hidden(device, solids, (*kept, Step("calibrate", pictures="base")))[BASE]
    assert share == pytest.approx(0.363, abs=0.03)


def test_a_piece_before_a_mirror_and_a_missing_mirror_hide_its_part_of_the_frame(
    device: Device, solids: Solids
) -> None:
    name, mirror = device.layout.mirror_names[4], device.layout.mirrors[4]
    missing = {key: solid for key, solid in solids.items() if key != f"mirror_{name}"}
    without = hidden(device, missing)[FRAMES]
    assert 0.03 < without < 0.2
    between = mirror.outline_in_rig_mm.mean(axis=0) / 2.0
    block = manifold3d.Manifold.cube((2.0, 2.0, 2.0), center=True).translate(tuple(between))
    stray = hidden(device, solids | {"mount_2": block})
    assert 0.0 < stray[FRAMES] < without
    assert stray[BASE] == 0.0


@pytest.fixture
def layout() -> Layout:
    """One mirror normal to the rig's z, at z = 50 mm, that faces -z."""
    outline = np.array([(-5.0, -5.0, 50.0), (5.0, -5.0, 50.0), (5.0, 5.0, 50.0), (-5.0, 5.0, 50.0)])
    mirror = Mirror(virtual_centre_in_rig_mm=np.array([0.0, 0.0, 100.0]), outline_in_rig_mm=outline)
    return Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror,))


def share(layout: Layout, solid: Manifold) -> float:
    (check,) = check_surrounding_light(layout, {"solid": solid}).values()
    assert check.limit is None
    return check.value


def test_a_bare_mirror_has_all_of_it_and_a_half_shaded_one_half(layout: Layout) -> None:
    behind = Manifold.cube((300.0, 300.0, 5.0), center=True).translate((0.0, 0.0, 60.0))
    assert share(layout, behind) == 1.0
    beside = Manifold.cube((300.0, 600.0, 600.0)).translate((0.01, -300.0, -400.0))
    assert share(layout, beside + behind) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("height", [10.0, 30.0])
def test_a_hood_leaves_the_square_of_the_sine_of_its_opening(layout: Layout, height: float) -> None:
    """A tube of radius 20 mm: the middle of a Lambertian mirror receives sin^2 of half its opening angle."""
    outer, inner = (Manifold.cylinder(height, r, circular_segments=360) for r in (22.0, 20.0))
    tube = (outer - inner).translate((0.0, 0.0, 50.0 - height))
    half = np.arctan2(20.0, height - START_MM)
    assert share(layout, tube) == pytest.approx(np.sin(half) ** 2, abs=0.01)
