"""Light across the borders of mirrors in rendered frames, against the unvignetted part of the pupil by rays."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.detection.border_light import BoardFrame, BorderLight, border_light, borders
from mirrorcam.optics.calibration.pupil_estimate import fit_pupil
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.settings import RenderSettings, SensorModel
from tests.optics.calibration.test_pupil_estimate import traced
from tests.optics.synthetic import posed

BOARD = Charuco(cols=24, rows=17, square_mm=14.0, marker_mm=10.0)
PUPIL = Pupil(1.8, 500.0)
NEAR, FAR = 300.0, 440.0
FRAMES = 12


@pytest.fixture(scope="module")
def halved(fold_90_layout: Layout) -> Layout:
    """The default device with a camera of half as many pixels along each side."""
    camera = fold_90_layout.camera
    size = {"width_px": camera.width_px // 2, "height_px": camera.height_px // 2}
    numbers = {name: getattr(camera, name) / 2.0 for name in ("fx_px", "fy_px")}
    middle = {name: (getattr(camera, name) + 0.5) / 2.0 - 0.5 for name in ("cx_px", "cy_px")}
    return fold_90_layout.replaced(camera=camera.replaced(**size, **numbers, **middle).with_pupil(PUPIL))


@pytest.fixture(scope="module")
def frames(halved: Layout) -> list[BoardFrame]:
    sensor = SensorModel(aperture_mm=PUPIL.aperture_mm, focus_mm=PUPIL.focus_mm)
    scene = FastScene(halved.camera, halved.mirrors, BOARD, RenderSettings(renderer="fast", sensor=sensor))
    random = np.random.default_rng(1)
    found = []
    for depth in np.linspace(NEAR, FAR, FRAMES):
        place = np.array([random.uniform(-15.0, 15.0), depth, 80.0 + random.uniform(-15.0, 15.0)])
        pose = posed(BOARD, place, random.uniform(-15.0, 15.0, 3), direct=False)
        scene.place_board(pose)
        rendered = scene.render()
        height, width = halved.camera.height_px, halved.camera.width_px
        light = 255.0 * rendered.reshape(height, 2, width, 2).mean(axis=(1, 3))
        found.append(BoardFrame(np.clip(light + random.normal(0.0, 1.0, light.shape), 0, 255).astype(np.uint8), pose))
    return found


@pytest.fixture(scope="module")
def lights(halved: Layout, frames: list[BoardFrame]) -> list[BorderLight]:
    return border_light(halved, frames, BOARD)


def test_light_falls_as_the_unvignetted_pupil_also_where_two_mirrors_mix(
    halved: Layout, lights: list[BorderLight]
) -> None:
    shown = [each for each in lights if np.isfinite(each.light).mean() > 0.6]
    assert len(shown) >= 12
    assert any(each.border.neighbour is not None for each in shown)
    off = []
    for each in shown:
        middle = each.light.shape[0] // 2
        normalized = each.border.normalized(halved)[middle]
        near = np.isfinite(normalized).all(axis=1) & (np.abs(each.border.out_px) < 20.0)
        share = traced(halved.mirrors[each.border.mirror], normalized[near], PUPIL)
        profile = np.nanmedian(each.light[middle - 3 : middle + 4], axis=0)
        off.append(profile[near] / np.nanmedian(profile[each.border.out_px < -20.0]) - share)
    errors = np.concatenate(off)
    assert np.nanmedian(np.abs(errors)) < 0.02
    assert abs(np.nanmean(errors)) < 0.02


def test_the_pupil_is_found_from_rendered_frames(halved: Layout, lights: list[BorderLight]) -> None:
    seen = fit_pupil(halved, lights)
    assert seen is not None
    assert seen.aperture_mm == pytest.approx(PUPIL.aperture_mm, abs=3.0 * seen.aperture_sigma_mm)
    assert seen.inverse_focus == pytest.approx(1.0 / PUPIL.focus_mm, abs=3.0 * seen.inverse_focus_sigma)


def test_points_off_the_sensor_are_unknown_and_short_borders_are_skipped(fold_90_layout: Layout) -> None:
    right = max(float(fold_90_layout.outline_px(index)[:, 0].max()) for index in range(9))
    camera = fold_90_layout.camera.replaced(width_px=int(right) + 10).with_pupil(PINHOLE)
    found = borders(fold_90_layout.replaced(camera=camera))
    size = np.array([camera.width_px, camera.height_px])
    for border in found:
        inside = np.asarray(np.isfinite(border.pixels).all(axis=2))
        assert inside[:, len(border.out_px) // 2].all()
        assert ((border.pixels[inside] >= 0.0) & (border.pixels[inside] <= size - 1.0)).all()
    assert any(np.isnan(border.pixels).any() for border in found)
    assert len(found) <= sum(len(mirror.outline_in_rig_mm) for mirror in fold_90_layout.mirrors)


@pytest.mark.filterwarnings("error")
def test_views_without_a_board_or_without_light_have_no_light(halved: Layout, frames: list[BoardFrame]) -> None:
    black = [BoardFrame(np.zeros_like(frame.picture), frame.rig_from_board) for frame in frames]
    for light in border_light(halved, black, BOARD):
        decoded = light.from_srgb().light
        np.testing.assert_allclose(decoded[np.isfinite(decoded)], 0.0, atol=1e-9)
    away = [BoardFrame(frame.picture, np.diag([1.0, -1.0, -1.0, 1.0]) @ frame.rig_from_board) for frame in frames]
    for light in border_light(halved, away, BOARD):
        assert np.isnan(light.from_srgb().light).all()
        assert np.isinf(light.from_srgb().sigma).all()
