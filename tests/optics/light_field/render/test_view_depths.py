"""Depths of all views: projected pixels, certainty, and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.render.perspective import all_in_focus
from mirrorcam.optics.light_field.render.view_depths import ViewDepths, fill_holes, project_pixels, remove_nearer
from tests.optics.light_field.depth.surfaces import grid_views, photograph
from tests.optics.light_field.render.scenes import SCENE, WALL, behind_mm, true_depths

NAN = np.nan


def test_pixels_are_projected_to_the_pixels_of_their_points() -> None:
    views = grid_views()
    start, end = (0, 2), (2, 0)
    points = views.plane_points_in_rig(410.0, np.array([[31.0, 52.0], [77.0, 11.0]]), start)
    inverse_distance = np.full((90, 120), 1.0 / (410.0 - behind_mm(views)), np.float32)
    u, v = project_pixels(views, start, views.positions_mm[end], inverse_distance)
    expected = views.project(points)[end]
    np.testing.assert_allclose([[u[52, 31], v[52, 31]], [u[11, 77], v[11, 77]]], expected, atol=1e-3)
    # Points at infinity move by f x (1 / Z0 - 0).
    u, _ = project_pixels(views, (1, 1), np.array([20.0, 0.0, 0.0]), np.zeros((90, 120), np.float32))
    moved = views.focal_px * 20.0 / views.reference_distance_mm
    np.testing.assert_allclose(u - np.arange(120), moved, atol=1e-3)


def test_bad_depths_are_refused() -> None:
    views = grid_views()
    light_field = photograph(views, [WALL])[0]
    with pytest.raises(InputError, match="depths have shape"):
        ViewDepths.of_depths(views, np.ones((3, 3, 5, 5)))
    with pytest.raises(InputError, match="expected all beyond"):
        ViewDepths.of_depths(views, np.full((3, 3, 90, 120), behind_mm(views) - 1.0))
    nothing = ViewDepths.of_depths(views, np.full((3, 3, 90, 120), np.nan))
    with pytest.raises(InputError, match="no depth is known in any view"):
        all_in_focus(light_field, nothing)
    with pytest.raises(InputError, match="nothing lies in front of"):
        remove_nearer(light_field, nothing, behind_mm(views) - 5.0)


def test_depth_of_the_reference_view_is_projected_to_the_others() -> None:
    views = grid_views()
    true = true_depths(views, SCENE)
    depths = ViewDepths.of_reference(views, true.depth_mm(views)[1, 1])
    np.testing.assert_allclose(depths.inverse_distance[1, 1], true.inverse_distance[1, 1], rtol=1e-6)
    assert depths.measured[1, 1].all()
    close = np.abs(depths.inverse_distance / true.inverse_distance - 1.0) < 0.01
    assert close[depths.measured].mean() > 0.99
    # Next to the card, places hidden from the reference view are filled with the wall, as uncertain.
    assert close[:, :, 10:-10, 20:-20].mean() > 0.98
    hidden = ~depths.measured[1, 0, 25:60, 40:80]
    assert 0.02 < hidden.mean() < 0.5
    assert close[1, 0, 25:60, 40:80][hidden].mean() > 0.7
    holes = true.depth_mm(views)[1, 1].copy()
    holes[10:20, 10:20] = np.nan
    depths = ViewDepths.of_reference(views, holes)
    assert not depths.measured[1, 1, 10:20, 10:20].any()
    assert np.isfinite(depths.inverse_distance).all()
    with pytest.raises(InputError, match="depth has shape"):
        ViewDepths.of_reference(views, holes[1:])


def test_samples_around_excluded_ones_are_excluded() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE)[0]
    depths = true_depths(views, SCENE)
    nearer = depths.inverse_distance > 1.0 / 460.0
    weights = remove_nearer(light_field, depths, 460.0 + behind_mm(views)).weights
    assert (weights[nearer] == 0).all()
    for shift in ((2, 0), (-2, 0), (0, 2), (0, -2)):
        assert (weights[np.roll(nearer, shift, axis=(2, 3))] == 0).all()
    assert (weights[np.roll(nearer, (3, 0), axis=(2, 3))] > 0).any()


def test_a_hole_is_filled_from_the_background() -> None:
    line = np.array([0.2, 0.2, 0.9, 0.9, NAN, NAN, NAN, NAN, 0.3, 0.3], np.float32)
    shown = fill_holes(np.tile(line, (9, 1)), 0.05)
    np.testing.assert_array_equal(shown[:, 4:8], np.float32(0.3))
    np.testing.assert_array_equal(shown[:, :4], np.tile(line[:4], (9, 1)))


def test_a_slope_in_the_background_is_continued_from_close_pixels() -> None:
    slope = np.linspace(0.2, 0.3, 21, dtype=np.float32)
    holes = slope.copy()
    holes[8:13] = NAN
    shown = fill_holes(np.tile(holes, (3, 1)), 0.2)
    assert np.abs(shown - slope).max() < 0.012


def test_cracks_in_near_surfaces_are_filled_with_near_depth() -> None:
    card = np.full((20, 20), 0.2, np.float32)
    card[5:15, 5:15] = 0.8
    card[:, 10] = NAN
    assert (fill_holes(card, 0.05)[5:15, 10] == np.float32(0.8)).all()
    assert (fill_holes(card, 0.05)[:5, 10] == np.float32(0.2)).all()


def test_corners_without_neighbours_are_filled() -> None:
    corner = np.full((8, 9), NAN, np.float32)
    corner[0, 0] = 0.4
    np.testing.assert_allclose(fill_holes(corner, 0.1), 0.4, rtol=1e-6)
    with pytest.raises(ValueError, match="all pixels are holes"):
        fill_holes(np.full((3, 3), NAN, np.float32), 0.1)
