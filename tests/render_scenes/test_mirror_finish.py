"""Mirrors of unequal, rough and bent finish: as drawn by lot, in both renderers and in the ground truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, draw_finishes, radius_mm, uniform_finishes
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.reference.integrator import CLEARANCE_MM
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SurfaceFinish
from mirrorcam.render_scenes.truth.corners import CornerProjector
from mirrorcam.render_scenes.truth.light_rays import trace_via_mirror
from mirrorcam.render_scenes.truth.pixel_maps import board_maps, pixel_rays
from tests.nightly import a_few
from tests.render_scenes.corners import TARGET, tilted_board

BENT = MirrorFinish(
    reflectance=(0.9, 0.9, 0.9), sag_mm=0.2, sag_direction_deg=30.0, ripple_mm=0.003, ripple_direction_deg=70.0
)


@pytest.fixture(scope="module")
def pose(small_layout: Layout, small_board: Charuco) -> FloatArray:
    return plan_frames(small_layout, small_board, 1, np.random.default_rng(1)).poses[0]


def drawn(settings: RenderSettings, seed: int = 3) -> tuple[MirrorFinish, ...]:
    return draw_finishes(settings, 9, np.random.default_rng(seed))


def test_mirrors_are_drawn_each_its_own_and_the_same_again() -> None:
    asked = RenderSettings(
        finish=SurfaceFinish(
            tint=(1.0, 0.9, 0.8), reflectance_percent=2.0, sag_mm=0.05, ripple_mm=0.001, bend="cylinder"
        )
    )
    found = drawn(asked)
    assert found == drawn(asked)
    assert found != drawn(asked, seed=4)
    assert len({finish.reflectance for finish in found}) == 9
    assert len({finish.sag_mm for finish in found}) == 9
    assert all(finish.ripple_mm == 0.001 and finish.bend == "cylinder" and not finish.flat for finish in found)
    for finish in found:
        np.testing.assert_allclose(np.array(finish.reflectance) / finish.reflectance[0], [1.0, 0.9, 0.8])
    # Half of the sag, the same mirrors.
    half = drawn(asked.replaced(finish=asked.finish.replaced(sag_mm=0.025)))
    np.testing.assert_allclose([2.0 * finish.sag_mm for finish in half], [finish.sag_mm for finish in found])
    assert drawn(RenderSettings()) == ()


@pytest.mark.parametrize("bend", ["sphere", "cylinder"])
def test_slopes_are_those_of_the_shape(bend: str) -> None:
    finish = BENT.replaced(bend=bend)
    points = np.random.default_rng(0).uniform(-20.0, 20.0, (100, 2))
    _, slopes = finish.shape(25.0, points)
    for axis in range(2):
        step = np.eye(2)[axis] * 1e-4
        found = (finish.shape(25.0, points + step)[0] - finish.shape(25.0, points - step)[0]) / 2e-4
        np.testing.assert_allclose(slopes[:, axis], found, atol=1e-8)
    plain = finish.replaced(ripple_mm=0.0)
    along = 25.0 * np.array([np.cos(np.deg2rad(30.0)), np.sin(np.deg2rad(30.0))])
    across = along[::-1] * [-1.0, 1.0]
    middle, rim, aside = plain.shape(25.0, np.array([[0.0, 0.0], along, across]))[0]
    assert rim - middle == pytest.approx(0.2)
    assert aside - middle == pytest.approx(0.2 if bend == "sphere" else 0.0)


def test_mirrors_are_as_bright_as_drawn_by_both(small_layout: Layout, small_board: Charuco, pose: FloatArray) -> None:
    asked = RenderSettings(paper=1.0, ink=1.0, finish=SurfaceFinish(reflectance_percent=5.0, tint=(0.9, 0.8, 0.7)))
    finishes = drawn(asked)
    traced = BoardScene(small_layout.camera, small_layout.mirrors, small_board, asked, finishes=finishes)
    computed = FastScene(
        small_layout.camera, small_layout.mirrors, small_board, asked.replaced(renderer="fast"), finishes=finishes
    )
    traced.place_board(pose)
    computed.place_board(pose)
    pictures = traced.render(spp=4, seed=1), computed.render()[::2, ::2]
    seen = 0
    for index, finish in enumerate(finishes):
        x, y = small_layout.outline_px(index).mean(axis=0).astype(int)
        for picture in pictures:
            if picture[y, x] > 0.0:
                seen += 1
                assert picture[y, x] == pytest.approx(finish.luminance, rel=1e-4), index
    assert seen >= 14
    assert len({finish.luminance for finish in finishes}) == 9


def edge_width(picture: NDArray[np.float32]) -> float:
    """Mean change from a pixel to the next over the largest, which blur reduces."""
    return float(np.abs(np.diff(picture, axis=1)).max())


def test_a_rough_mirror_blurs_and_loses_no_light(small_layout: Layout, small_board: Charuco, pose: FloatArray) -> None:
    crop, found = (200, 100, 60, 30), []
    for roughness in (0.0, 0.004):
        asked = RenderSettings(finish=SurfaceFinish(roughness=roughness), sensor=SENSORS["ideal"])
        scene = BoardScene(
            small_layout.camera,
            small_layout.mirrors,
            small_board,
            asked,
            finishes=drawn(asked) or uniform_finishes(asked, 9),
        )
        scene.place_board(pose)
        found.append(scene.render(spp=256, seed=1, crop=crop))
    smooth, rough = found
    assert edge_width(rough) < 0.5 * edge_width(smooth)
    assert rough.mean() == pytest.approx(smooth.mean(), rel=0.01)


def test_a_set_tells_the_finish_in_its_truth_alone(tmp_path: Path, small_layout: Layout, small_board: Charuco) -> None:
    request = SetRequest(
        layout=small_layout,
        board=small_board,
        frames=1,
        base_frames=0,
        tolerances=Tolerances.none(),
        settings=RenderSettings(
            spp=4, maps=False, sensor=SENSORS["ideal"], finish=SurfaceFinish(reflectance_percent=3.0, sag_mm=0.02)
        ),
    )
    dataset = render_set(request, tmp_path)
    written = json.loads((tmp_path / "truth" / "finish.json").read_text(encoding="utf-8"))
    finishes = [MirrorFinish.model_validate(values) for values in written["mirrors"]]
    assert len({finish.sag_mm for finish in finishes}) == 9
    assert dataset.intact(tmp_path, "truth/finish.json")
    assert repr(finishes[0].sag_mm) not in (tmp_path / "dataset.json").read_text(encoding="utf-8")
    assert 20.0 < radius_mm(small_layout.mirrors[0]) < 60.0


def bent_layout(layout: Layout, surface: str) -> Layout:
    if surface == "first":
        return layout
    mirrors = tuple(
        Mirror.second_surface(
            mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=2.0, refractive_index=1.49
        )
        for mirror in layout.mirrors
    )
    return layout.replaced(mirrors=mirrors, kind="as-built", spec=None)


@pytest.mark.parametrize("surface", a_few(1, ["first", "second"]))
def test_bent_mirrors_are_traced_where_rays_of_their_exact_shape_go(small_layout: Layout, surface: str) -> None:
    """The mesh of the reference, its normals between vertices included, against float64: to 3 um on the board."""
    layout = bent_layout(small_layout, surface)
    pose = tilted_board(layout)
    finishes = (BENT, BENT.replaced(bend="cylinder", sag_mm=-0.1)) * 4 + (BENT,)
    scene = BoardScene(
        layout.camera, layout.mirrors, TARGET, RenderSettings(sensor=SENSORS["ideal"]), finishes=finishes
    )
    scene.place_board(pose)
    truth = board_maps(pixel_rays(layout, mirrors=True, step=3, finishes=finishes), TARGET, pose)
    flat = board_maps(pixel_rays(layout, mirrors=True, step=3), TARGET, pose)
    y, x = np.nonzero(np.isfinite(truth["board.x"]))
    places = 3.0 * np.stack([x, y])
    at, on_board = traced_to_board(scene, places, pose, (2.0, 0.0, 2.0) if surface == "second" else (0.5,))
    assert on_board.mean() > 0.97
    off, bend = (
        np.stack([(at[:, axis] - maps[name][y, x])[on_board] for axis, name in enumerate(("board.x", "board.y"))])
        for maps in (truth, flat)
    )
    assert np.percentile(np.abs(off), 99) < 0.003
    assert np.nanmedian(np.linalg.norm(bend, axis=0)) > 1.0  # what a plane would be wrong by


def traced_to_board(
    scene: BoardScene, px: Any, pose: FloatArray, lots: tuple[float, ...]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Origins (n, 2) on the board, mm, of light at pixels (2, n), by Mitsuba with given random numbers; and a mask."""
    import mitsuba as mi

    hit = scene.scene.ray_intersect(mi.Ray3f(scene.sensor.ray_through(*(mi.Float(axis + 0.5) for axis in px))))
    for lot in lots:
        sample, _ = hit.bsdf().sample(mi.BSDFContext(), hit, lot, mi.Point2f(0.5))
        direction = hit.to_world(sample.wo)
        hit = scene.scene.ray_intersect(mi.Ray3f(hit.p + CLEARANCE_MM * direction, direction))
    at = (np.array(hit.p, dtype=np.float64).T - pose[:3, 3]) @ pose[:3, :3]
    return at[:, :2], np.abs(at[:, 2]) < 1e-3


@pytest.mark.parametrize("surface", ["first", "second"])
def test_corners_by_bent_mirrors_are_told_exactly(small_layout: Layout, surface: str) -> None:
    """The ray of the solved pixel ends at the corner; that of a plane mirror's pixel does not."""
    layout = bent_layout(small_layout, surface)
    pose, finishes = tilted_board(layout), (BENT.replaced(sag_mm=0.02),) * 9
    px, visible = CornerProjector(layout, TARGET, finishes).via_mirrors(pose)
    assert visible.sum() > 300
    plane = CornerProjector(layout, TARGET).via_mirrors(pose)[0]
    assert 0.1 < np.linalg.norm(px[visible] - plane[visible], axis=-1).mean() < 5.0
    for index, mirror in enumerate(layout.mirrors):
        rays = layout.camera.unproject(px[index][visible[index]])
        unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        _, start, direction, _ = trace_via_mirror(mirror, unit, finishes[index])
        start, direction = (start - pose[:3, 3]) @ pose[:3, :3], direction @ pose[:3, :3]
        at = start[:, :2] - direction[:, :2] * (start[:, 2] / direction[:, 2])[:, None]
        np.testing.assert_allclose(at, TARGET.corners_in_board_mm[visible[index]][:, :2], atol=1e-6)


@pytest.mark.parametrize("surface", ["first", "second"])
def test_a_bend_of_nothing_is_a_plane(small_layout: Layout, surface: str) -> None:
    """Traced from surface to surface, an almost flat mirror agrees with the closed form."""
    layout = bent_layout(small_layout, surface)
    rays = pixel_rays(layout, mirrors=False, step=9).direction
    for mirror in layout.mirrors[::4]:
        flat, bent = (
            trace_via_mirror(mirror, rays),
            trace_via_mirror(mirror, rays, BENT.replaced(sag_mm=1e-12, ripple_mm=0.0)),
        )
        for one, other in zip(flat, bent, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-9)
        assert np.isfinite(flat[3]).sum() > 10
