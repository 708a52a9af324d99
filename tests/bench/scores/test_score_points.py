"""Points where views show them, and slopes of projections."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.bench.scores.gauge import project_with_gradient, score_points, visible_in_all
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import VOLUME_FACTORS
from tests.optics.camera_files.rigs import DISTANCE_MM, device


def test_points_are_where_the_true_device_shows_them() -> None:
    truth = device().truth
    points = score_points(truth, [1, 4], DISTANCE_MM)
    assert set(points.view.tolist()) == {1, 4}
    for view in (1, 4):
        at = points.view == view
        np.testing.assert_allclose(truth.project(points.points_in_rig[at], view), points.pixels[at], atol=1e-9)
        centre = truth.mirrors[view].apparent.virtual_centre_in_rig_mm
        far = np.linalg.norm(points.points_in_rig[at] - centre, axis=1) / DISTANCE_MM
        assert set(np.round(far, 9).tolist()) == set(VOLUME_FACTORS)
        np.testing.assert_allclose(far[points.at_distance[at]], 1.0)
        low, high = truth.outline_px(view).min(axis=0), truth.outline_px(view).max(axis=0)
        assert (points.pixels[at] > low).all()
        assert (points.pixels[at] < high).all()
        assert at.sum() > 3 * 30


def test_slopes_are_the_derivatives_of_the_camera() -> None:
    camera = device().truth.camera
    points = np.random.default_rng(0).uniform([-50.0, -50.0, 300.0], [50.0, 50.0, 500.0], (20, 3))
    pixels, slopes = project_with_gradient(camera.project, points)
    expected, by_point, _ = camera.project_with_jacobians(points)
    np.testing.assert_allclose(pixels, expected, atol=1e-9)
    np.testing.assert_allclose(slopes, by_point, rtol=1e-6, atol=1e-7)


def test_points_that_all_show_are_in_every_outline() -> None:
    truth = device().truth
    points = score_points(truth, range(6), DISTANCE_MM).points_in_rig
    shown = visible_in_all(truth, range(6), points)
    assert 4 < shown.sum() < len(shown)
    assert shown.sum() < visible_in_all(truth, [0, 1], points).sum()


def test_a_mirror_beyond_the_sensor_is_refused() -> None:
    truth = device().truth
    narrow = truth.replaced(camera=truth.camera.replaced(width_px=300))
    score_points(narrow, [0, 3], DISTANCE_MM)
    with pytest.raises(InputError, match="mirror 0-2 shows nothing 450 mm away"):
        score_points(narrow, [0, 2], DISTANCE_MM)
