"""The motion between two models of a rig: found exactly, also with a scale, and not moved by one bad view."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_motion import (
    best_motion,
    by_motion,
    view_weights,
    without_motion,
)
from mirrorcam.optics.geometry.transforms import rigid, transform

FOCAL_PX = 600.0
CENTRES = np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0], [0.0, 60.0, 0.0], [60.0, 60.0, 5.0]])


def project(points: FloatArray, centres: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels and derivatives by the points of pinholes that look along z."""
    x, y, z = (points - centres).T
    slopes = np.zeros((len(points), 2, 3))
    slopes[:, 0, 0] = slopes[:, 1, 1] = FOCAL_PX / z
    slopes[:, 0, 2], slopes[:, 1, 2] = -FOCAL_PX * x / z**2, -FOCAL_PX * y / z**2
    return FOCAL_PX * np.column_stack([x / z, y / z]), slopes


def rig_points() -> tuple[np.ndarray, FloatArray]:
    """Views (n,) and points (n, 3)."""
    random = np.random.default_rng(3)
    view = np.repeat(np.arange(4), 40)
    return view, random.uniform([-80.0, -80.0, 300.0], [140.0, 140.0, 500.0], (160, 3))


@pytest.mark.parametrize(("scale", "scaled"), [(1.0, False), (1.0, True), (1.3, True)])
def test_a_motion_is_found(scale: float, scaled: bool) -> None:
    view, points = rig_points()
    b_from_a = rigid(scale * Rotation.from_rotvec([0.05, -0.1, 0.2]).as_matrix(), [20.0, -10.0, 30.0])
    a_from_b = np.asarray(np.linalg.inv(b_from_a), dtype=np.float64)
    shown, _ = project(points, CENTRES[view])

    def project_in_b(points_in_b: FloatArray) -> tuple[FloatArray, FloatArray]:
        pixels, slopes = project(transform(a_from_b, points_in_b), CENTRES[view])
        return pixels, slopes @ a_from_b[:3, :3]

    found, weights = best_motion(shown, view, points, project_in_b, np.eye(4), scaled=scaled)
    np.testing.assert_allclose(found, b_from_a, atol=1e-8)
    assert weights.min() > 0.99


def test_one_bad_view_hardly_moves_it() -> None:
    view, points = rig_points()
    shown, _ = project(points, CENTRES[view])
    shown += np.random.default_rng(0).normal(0.0, 0.01, shown.shape)
    shown[view == 2] += [3.0, -2.0]
    found, weights = best_motion(shown, view, points, lambda at: project(at, CENTRES[view]), np.eye(4))
    np.testing.assert_allclose(found, np.eye(4), atol=0.01)
    assert weights[view == 2].max() < 1e-4 < 0.1 < weights[view != 2].min()


def test_points_that_b_does_not_show_are_left_out() -> None:
    view, points = rig_points()
    shown, _ = project(points, CENTRES[view])

    def partly(points_in_b: FloatArray) -> tuple[FloatArray, FloatArray]:
        pixels, slopes = project(points_in_b, CENTRES[view])
        pixels[::5] = np.nan
        return pixels, slopes

    start = rigid(np.eye(3), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(best_motion(shown, view, points, partly, start)[0], np.eye(4), atol=1e-7)


def test_columns_are_the_derivatives_by_the_motion() -> None:
    view, points = rig_points()
    middle, lever = points.mean(axis=0), 250.0
    _, slopes = project(points, CENTRES[view])
    columns = by_motion(slopes, points, lever, scaled=True)
    for k in range(7):
        step = 1e-4
        shown = []
        for sign in (1.0, -1.0):
            d = sign * step * np.eye(7)[k]
            turn = np.exp(d[6] / lever) * Rotation.from_rotvec(d[:3] / lever).as_matrix()
            shown.append(project((points - middle) @ turn.T + middle + d[3:6], CENTRES[view])[0])
        np.testing.assert_allclose(columns[:, :, k], (shown[0] - shown[1]) / (2.0 * step), atol=1e-6)


def test_what_a_motion_can_do_is_nothing_without_it() -> None:
    view, points = rig_points()
    columns = by_motion(project(points, CENTRES[view])[1], points, 250.0)
    weights = np.random.default_rng(1).uniform(0.5, 1.0, len(points))
    mixed = columns @ np.random.default_rng(2).normal(size=(6, 3))
    np.testing.assert_allclose(without_motion(mixed, columns, weights), 0.0, atol=1e-9)


def test_weights_of_equal_views_are_one() -> None:
    view = np.repeat(np.arange(3), 5)
    np.testing.assert_allclose(view_weights(np.zeros((15, 2)), view), 1.0)
