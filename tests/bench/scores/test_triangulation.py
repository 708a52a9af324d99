"""Points triangulated by a calibration: true ones by a true one, and scaled by one that is too large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.bench.scores.calibration_score import Triangulation, triangulate
from mirrorcam.bench.scores.gauge import gauges, score_points
from mirrorcam.bench.scores.matched_views import matched_views
from mirrorcam.optics.camera_files.camera_rig import CameraRig
from tests.optics.camera_files.rigs import DISTANCE_MM, device, moved, true_rig, with_random_poses


def found(rig: CameraRig) -> Triangulation | None:
    views = matched_views(rig, device().truth, device().nominal)
    points = score_points(device().truth, [view.view for view in views], DISTANCE_MM)
    return triangulate(gauges(views, points, scaled=False)[0], device().truth)


def test_a_true_calibration_triangulates_true_points() -> None:
    result = found(true_rig(device().truth))
    assert result is not None
    np.testing.assert_allclose(result.triangulated, result.true, atol=1e-8)
    assert result.scale_error == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("factor", [0.99, 1.02])
def test_a_rig_that_is_too_large_makes_a_scene_that_is(factor: float) -> None:
    result = found(moved(true_rig(device().truth), np.diag([factor, factor, factor, 1.0])))
    assert result is not None
    assert result.scale_error == pytest.approx(factor - 1.0, abs=1e-9)
    sizes = [np.linalg.norm(points - points.mean(axis=0)) for points in (result.triangulated, result.true)]
    assert sizes[0] / sizes[1] == pytest.approx(factor, rel=1e-9)


def test_the_scale_of_a_scene_that_is_turned_is_its_own() -> None:
    random = np.random.default_rng(0)
    true = random.normal(size=(30, 3))
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert Triangulation(true, 1.03 * true @ turn.T + 5.0).scale_error == pytest.approx(0.03)


def test_errors_are_in_mm_of_the_true_rig() -> None:
    result = found(with_random_poses(true_rig(device().truth), 1.0))
    assert result is not None
    assert 0.001 < np.linalg.norm(result.error_mm, axis=1).mean() < 2.0


def test_one_view_triangulates_nothing() -> None:
    rig = true_rig(device().truth)
    assert found(replace(rig, cameras=rig.cameras[:1])) is None
