"""How pixels move between views, against the pinholes of `Views`."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.light_field.depth.parallax import (
    halved,
    other_views,
    parallax,
    plane_inverse_distances,
    reference_index,
)
from tests.optics.light_field.depth.surfaces import grid_views

VIEWS = grid_views()
COLUMNS = np.arange(VIEWS.width_px, dtype=np.float32)[None]
ROWS = np.arange(VIEWS.height_px, dtype=np.float32)[:, None]


def test_pixels_move_as_in_the_pinholes() -> None:
    for depth in (250.0, 375.0, 800.0):
        distance = depth + VIEWS.reference_distance_mm - VIEWS.reference_depth_mm
        offset_u = (VIEWS.pixel_grid() - VIEWS.centre_px) * distance / VIEWS.focal_px
        points = np.concatenate([offset_u, np.full((*offset_u.shape[:2], 1), distance)], axis=-1)
        truth = VIEWS.project_in_view(points)
        q = np.full((VIEWS.height_px, VIEWS.width_px), 1.0 / distance, np.float32)
        for index in other_views(VIEWS):
            moved = np.stack(parallax(VIEWS, index).pixels(COLUMNS, ROWS, q), axis=-1)
            assert np.abs(moved - truth[index]).max() < 2e-4
            matrix = parallax(VIEWS, index).affine(1.0 / distance)
            assert np.allclose(VIEWS.pixel_grid() @ matrix[:, :2].T + matrix[:, 2], truth[index], atol=1e-9)


def test_slopes_are_the_derivatives_of_pixels() -> None:
    q, small = np.full((1, 1), 1.0 / 400.0, np.float32), np.float32(1e-5)
    for index in other_views(VIEWS):
        view = parallax(VIEWS, index)
        after, before = view.pixels(COLUMNS, ROWS, q + small), view.pixels(COLUMNS, ROWS, q - small)
        for slope, high, low in zip(view.derivatives(COLUMNS, ROWS, q), after, before, strict=True):
            assert np.allclose(slope, (high - low) / (2 * small), atol=20.0, rtol=5e-3)
            assert np.abs(slope).max() > 100.0


def test_halved_views_see_the_same_points() -> None:
    half = halved(VIEWS)
    assert (half.width_px, half.height_px) == (60, 45)
    point = np.array([12.0, -7.0, 420.0])
    assert np.allclose(2 * half.project_in_view(point) + 0.5, VIEWS.project_in_view(point))


def test_the_reference_view_is_the_one_at_the_origin() -> None:
    assert reference_index(VIEWS) == (1, 1)
    assert reference_index(grid_views(2, 4)) == (1, 2)
    assert len(other_views(VIEWS)) == 8
    assert (1, 1) not in other_views(VIEWS)


def test_from_plane_to_plane_no_view_moves_by_more_than_a_step() -> None:
    even = grid_views(uneven=False)
    q = plane_inverse_distances(even, 250.0, 800.0, 0.5)
    behind = even.reference_view_depth_mm
    assert np.allclose([1 / q[-1] + behind, 1 / q[0] + behind], [250.0, 800.0])
    moves = np.array([even.project_in_view(np.array([0.0, 0.0, 1 / each])) for each in q])
    steps = np.abs(np.diff(moves, axis=0)).max(axis=(1, 2, 3))
    assert steps.max() <= 0.5
    assert steps.min() > 0.45
