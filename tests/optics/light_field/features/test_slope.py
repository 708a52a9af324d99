"""The law of slopes against the exact pinholes of `Views`, and its errors against drawn ones."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.slope import ViewGeometry, fit_slope, fit_two_slopes, moderated_variance
from mirrorcam.optics.light_field.light_field import Views
from tests.optics.light_field.features.scenes import uneven_views


def even(count: int) -> FloatArray:
    """Return the precision of points that are located equally well along u and v."""
    return np.tile(np.eye(2), (count, 1, 1))


def points(count: int) -> FloatArray:
    random = np.random.default_rng(3)
    return np.stack([*random.uniform(-60, 60, (2, count)), random.uniform(250, 2000, count)], axis=1)


def seen_by(views: Views, at: FloatArray) -> FloatArray:
    return views.project_in_view(at).reshape(-1, len(at), 2)


def level(views: Views) -> Views:
    """Return the views without steps along z."""
    return uneven_views(positions_mm=views.positions_mm * [1.0, 1.0, 0.0])


def astigmatic_pixels(geometry: ViewGeometry, directions: FloatArray, slopes_mm: FloatArray) -> FloatArray:
    """Return the pixels of points of slopes W (n, 2, 2) in views without steps along z, computed explicitly."""
    moved = np.einsum("nij,vj->vni", slopes_mm, geometry.lateral_mm)
    return geometry.focal_px[:, None, None] * (directions - moved) + geometry.centre_px[:, None]


def test_predictions_match_the_views() -> None:
    views, at = uneven_views(), points(40)
    geometry = ViewGeometry.of(views)
    assert geometry.reference == 4
    expected = seen_by(views, at)
    for view in range(9):
        found = geometry.predict(view, at[:, :2] / at[:, 2:], 1.0 / at[:, 2])
        assert np.allclose(found, expected[view], rtol=0, atol=1e-9)


def test_a_fit_of_exact_pixels_is_the_point() -> None:
    views, at = uneven_views(), points(40)
    used = np.random.default_rng(0).random((9, 40)) < 0.6
    used[[0, 4]] = True
    found = fit_slope(ViewGeometry.of(views), seen_by(views, at), used, np.full(40, 1 / 450.0), even(40))
    assert np.allclose(1.0 / found.inverse_distance, at[:, 2], rtol=1e-9)
    assert np.allclose(found.directions, at[:, :2] / at[:, 2:], rtol=0, atol=1e-12)
    assert found.distances_px.max() < 1e-8
    assert (found.dof == 2 * used.sum(axis=0) - 3).all()


def test_distances_are_in_pixels_of_the_view() -> None:
    views, at = uneven_views(), points(1)
    seen = np.repeat(seen_by(views, at), 9, axis=1)
    used = ~np.eye(9, dtype=bool)
    seen[np.arange(9), np.arange(9)] += [0.3, -0.4]
    found = fit_slope(ViewGeometry.of(views), seen, used, np.full(9, 1 / at[0, 2]), even(9))
    assert np.allclose(np.diag(found.distances_px), 0.5, atol=1e-9)


def test_unseen_points_have_no_distance_and_one_view_gives_no_slope() -> None:
    views, at = uneven_views(), points(2)
    seen, used = seen_by(views, at), np.ones((9, 2), dtype=bool)
    seen[2, 0] = np.nan
    used[2, 0] = False
    used[[0, 1, 2, 3, 5, 6, 7, 8], 1] = False
    found = fit_slope(ViewGeometry.of(views), seen, used, np.full(2, 1 / 450.0), even(2))
    assert np.isnan(found.distances_px[2, 0])
    assert 1.0 / found.inverse_distance[0] == pytest.approx(at[0, 2])
    assert np.isnan(found.inverse_distance[1])


def test_the_information_matches_drawn_errors() -> None:
    views, count = uneven_views(), 4000
    at = np.repeat(points(1), count, axis=0)
    seen = seen_by(views, at) + np.random.default_rng(1).normal(0.0, 0.1, (9, count, 2))
    found = fit_slope(ViewGeometry.of(views), seen, np.ones((9, count), bool), 1.0 / at[:, 2], even(count))
    assert np.std(found.inverse_distance) == pytest.approx(0.1 / np.sqrt(found.information[0]), rel=0.04)
    assert np.mean(found.squares_px2 / found.dof) == pytest.approx(0.01, rel=0.02)


def test_points_on_edges_are_weighted_by_their_precision() -> None:
    """Points are ten times as precise across an edge as along it: slopes are better than with equal weights."""
    views, count = uneven_views(), 4000
    at = np.repeat(points(1), count, axis=0)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    errors = np.random.default_rng(1).normal(0.0, [0.02, 0.2], (9, count, 2)) @ turn.T
    precision = turn @ np.diag([1 / 0.02**2, 1 / 0.2**2]) @ turn.T
    mean = np.trace(precision) / 2.0
    geometry, seen, used = ViewGeometry.of(views), seen_by(views, at) + errors, np.ones((9, count), bool)
    found = fit_slope(geometry, seen, used, 1.0 / at[:, 2], np.tile(precision / mean, (count, 1, 1)))
    assert np.std(found.inverse_distance) == pytest.approx(1.0 / np.sqrt(mean * found.information[0]), rel=0.04)
    assert np.std(found.inverse_distance) < 0.3 * np.std(
        fit_slope(geometry, seen, used, 1.0 / at[:, 2], even(count)).inverse_distance
    )
    assert np.mean(found.squares_px2 / found.dof) * mean == pytest.approx(1.0, rel=0.02)
    assert np.allclose(found.directions.mean(axis=0), at[0, :2] / at[0, 2], atol=1e-5)


def test_two_slopes_are_found_along_any_directions() -> None:
    geometry = ViewGeometry.of(level(uneven_views()))
    random = np.random.default_rng(4)
    parts = random.uniform(-2e-4, 2e-4, (30, 3)) + np.array([1 / 450.0, 0, 0])
    w, d, e = parts.T
    slopes = np.array([[w + d, e], [e, w - d]]).transpose(2, 0, 1)
    seen = astigmatic_pixels(geometry, random.uniform(-0.1, 0.1, (30, 2)), slopes)
    found = fit_two_slopes(geometry, seen, np.ones((9, 30), bool), w, even(30))
    assert np.allclose(found.matrices, slopes, rtol=0, atol=1e-12)
    assert np.allclose(found.anisotropy, parts[:, 1:], rtol=0, atol=1e-12)
    assert found.squares_px2.max() < 1e-9
    # One slope does not explain it.
    assert np.median(fit_slope(geometry, seen, np.ones((9, 30), bool), w, even(30)).squares_px2) > 1.0


def test_points_have_one_slope_and_errors_feign_two_at_the_stated_rate() -> None:
    views, count = uneven_views(), 4000
    at = np.repeat(points(1), count, axis=0)
    exact = seen_by(views, at)
    geometry, used, w = ViewGeometry.of(views), np.ones((9, count), bool), 1.0 / at[:, 2]
    assert np.abs(fit_two_slopes(geometry, exact, used, w, even(count)).anisotropy).max() < 1e-12
    seen = exact + np.random.default_rng(1).normal(0.0, 0.1, exact.shape)
    found = fit_two_slopes(geometry, seen, used, w, even(count))
    squares = (
        np.einsum("ni,nij,nj->n", found.anisotropy, np.linalg.inv(found.anisotropy_covariance), found.anisotropy) / 0.01
    )
    # Chi squared of two numbers: its mean, and the part of it beyond 9.21.
    assert squares.mean() == pytest.approx(2.0, rel=0.06)
    assert np.mean(squares > 9.21) == pytest.approx(0.01, abs=0.005)
    assert np.mean(found.squares_px2 / found.dof) == pytest.approx(0.01, rel=0.02)


def test_collinear_or_too_few_views_do_not_determine_two_slopes() -> None:
    geometry, at = ViewGeometry.of(uneven_views(1, 5)), points(3)
    seen = seen_by(uneven_views(1, 5), at)
    flat = ViewGeometry(geometry.focal_px, geometry.centre_px, geometry.lateral_mm * [1, 0], geometry.axial_mm, 2)
    assert np.isnan(fit_two_slopes(flat, seen, np.ones((5, 3), bool), 1 / at[:, 2], even(3)).matrices).all()
    few = np.zeros((9, 3), bool)
    few[[0, 4]] = True
    found = fit_two_slopes(ViewGeometry.of(uneven_views()), seen_by(uneven_views(), at), few, 1 / at[:, 2], even(3))
    assert np.isnan(found.anisotropy).all()


def test_few_residuals_are_shrunk_towards_the_usual_noise() -> None:
    dof = np.array([1, 15, 15, 0])
    squares = np.array([0.0, 15.0, 15.0, 0.0])
    found = moderated_variance(squares, dof, 4.0)
    assert np.allclose(found, [4 / 5, 1.0, 1.0, 1.0])
    assert (moderated_variance(np.zeros(2), np.zeros(2, int), 4.0) == 1.0).all()
    assert np.allclose(moderated_variance(np.zeros(2), np.array([9, 15]), 4.0), 0.003**2)
