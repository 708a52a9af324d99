"""Light fields, refocused pictures and depths decoded from a preview, against the scene of the preview."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.preview.mirror_views import mirror_views
from mirrorcam.render_scenes.preview.preview_frame import preview_frame, sensor_light, view_from_board
from mirrorcam.render_scenes.preview.products import PreviewProducts, preview_products
from mirrorcam.render_scenes.preview.traced_scene import traced_board
from mirrorcam.render_scenes.sets.sensor_model import photograph
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, ToneCurve
from mirrorcam.render_scenes.tabletop.tabletop_set import default_depths_mm


@pytest.fixture(scope="module")
def seen(fold_90_layout: Layout) -> PreviewProducts:
    return preview_products(preview_frame(fold_90_layout, "tabletop", 640))


def test_depth_is_measured_in_views_that_show_the_same_scene(seen: PreviewProducts) -> None:
    assert seen.light_field.samples.shape[:2] == (3, 3)
    shown = np.isfinite(seen.true_depth_mm)
    assert shown.mean() > 0.8
    near, far = seen.search_range_mm
    assert near < np.nanmin(seen.true_depth_mm) + 60.0
    assert np.nanmax(seen.true_depth_mm[shown]) < far
    error = np.abs(seen.depth.depth_mm - seen.true_depth_mm)[shown & seen.depth.valid]
    sure = error[seen.depth.confidence[shown & seen.depth.valid] > 0.8]
    assert np.median(error) == pytest.approx(seen.median_error_mm)
    assert seen.median_error_mm < 4.0
    # Depths of small sigma are correct.
    assert np.percentile(sure, 90.0) < 10.0
    assert len(sure) > 0.3 * len(error)


def test_the_depth_of_the_reference_view_is_that_of_its_rays(seen: PreviewProducts) -> None:
    views = seen.light_field
    grid = views.pixel_grid()
    t, s = np.unravel_index(np.abs(views.positions_mm).sum(axis=2).argmin(), views.positions_mm.shape[:2])
    # Points of pixels at their true depths project to the frame where it shows them.
    px = grid[20:-20:7, 20:-20:7].reshape(-1, 2)
    checked = 0
    for place in px:
        depth = seen.true_depth_mm[int(place[1]), int(place[0])]
        if not np.isfinite(depth):
            continue
        point = views.plane_points_in_rig(depth, place, (int(t), int(s)))
        on_sensor = seen.frame.layout.project(point, seen.frame.layout.central_index)
        column, row = np.rint(on_sensor).astype(int)
        around = seen.frame.light.depth_mm[row - 1 : row + 2, column - 1 : column + 2]
        if np.ptp(around) < 2.0:
            assert depth == pytest.approx(around[1, 1], abs=2.0)
            checked += 1
    assert checked > 50


def test_a_picture_is_sharp_where_it_is_focused(seen: PreviewProducts) -> None:
    # The page and the tin stand at the second of three depths.
    near, middle, far = default_depths_mm(seen.frame.layout)
    page = np.abs(seen.true_depth_mm - middle) < 12.0

    def detail(depth: float) -> float:
        grey = seen.refocused(depth).mean(axis=2).astype(np.float32)
        return float(np.abs(cv2.Laplacian(grey, cv2.CV_32F))[page].mean())

    assert page.sum() > 300
    assert detail(middle) > 1.5 * max(detail(near), detail(1.2 * far))
    with pytest.raises(InputError, match=r"^focus at -500 mm, expected a depth beyond the views"):
        seen.refocused(-500.0)


def test_pictures_suit_screens(seen: PreviewProducts) -> None:
    views = seen.light_field
    assert seen.refocused(400.0).shape == (views.height_px, views.width_px, 3)
    assert seen.views_picture().shape[0] >= 3 * views.height_px
    depth = seen.depth_picture()
    assert depth.dtype == np.uint8
    assert (depth[~seen.depth.valid] == 64).all()
    # Nearer is redder, and less certain is darker.
    sure = seen.depth.confidence > 0.9
    _, middle, far = default_depths_mm(seen.frame.layout)
    nearest, farthest = (np.abs(seen.depth.depth_mm - z) < 15.0 for z in (middle, 1.2 * far))
    assert depth[sure & nearest].mean(axis=0)[0] > depth[sure & farthest].mean(axis=0)[0] + 30
    confidence = seen.depth.confidence
    unsure = seen.depth.valid & (confidence <= np.quantile(confidence[seen.depth.valid], 0.01))
    brightness = [depth[part].max(axis=1).mean() for part in (unsure, sure)]
    assert brightness[0] < 0.8 * brightness[1]


@pytest.mark.parametrize("curve", ["linear", "srgb"])
def test_views_of_an_even_board_are_even_up_to_their_borders(curve: ToneCurve, fold_90_layout: Layout) -> None:
    wide = fold_90_layout.replaced(camera=fold_90_layout.camera.replaced(aperture_mm=4.0, focus_mm=500.0))
    sensor = SENSORS["ideal"].replaced(tone_curve=curve)
    frame = preview_frame(wide, "board", sensor=sensor)
    board = Checkerboard(cols=8, rows=7, square_mm=60.0)
    even = traced_board(board, view_from_board(frame.layout, board), RenderSettings(paper=0.3, ink=0.3))
    camera = frame.layout.camera
    light = sensor_light(camera, mirror_views(frame.layout, camera.pupil, 1.0), even)
    picture = photograph(light.radiance, 1, camera, sensor.replaced(lens_blur_px=0.0), np.random.default_rng(0))
    found = preview_products(replace(frame, picture=picture)).light_field
    partial = (found.weights < 0.8) & (found.weights > 0.4)
    assert partial.sum() > 1000
    whole = found.samples[found.weights == 1.0].mean()
    assert found.samples[partial].mean() == pytest.approx(whole, rel=0.02)


def test_there_is_no_depth_around_a_small_board(fold_90_layout: Layout) -> None:
    board = Checkerboard(cols=7, rows=6, square_mm=8.0)
    seen = preview_products(preview_frame(fold_90_layout, "board", board=board))
    assert np.isinf(seen.true_depth_mm).mean() > 0.3
    # 72 x 64 mm at the middle depth, slightly turned.
    shown = (
        np.isfinite(seen.true_depth_mm).sum()
        / (seen.light_field.focal_px / seen.light_field.reference_distance_mm) ** 2
    )
    assert shown == pytest.approx(72.0 * 64.0, rel=0.15)
    assert seen.median_error_mm < 2.0


def test_a_single_view_has_no_depth(fold_90_layout: Layout) -> None:
    one = fold_90_layout.replaced(
        rows=1, cols=1, mirrors=fold_90_layout.mirrors[4:5], spec=None, metrics={}, verdict={}
    )
    with pytest.raises(InputError, match=r"^light field has one view"):
        preview_products(preview_frame(one, "tabletop", 320))
