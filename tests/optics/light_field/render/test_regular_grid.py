"""Views moved to an even grid against pinholes that stand there, in scenes with slopes and edges."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.render.regular_grid import moved_to_regular_grid
from tests.optics.light_field.photographs import waves

BEHIND_MM = -80.0


def views() -> Views:
    """3 x 3 views, uneven in all three axes, the reference 80 mm behind the pupil."""
    positions = np.zeros((3, 3, 3))
    positions[..., :2] = np.stack(np.meshgrid([-20.0, 0.0, 20.0], [-15.0, 0.0, 15.0]), axis=-1)
    positions += np.random.default_rng(6).normal(0.0, 1.5, positions.shape)
    positions -= positions[1, 1]
    return Views(
        positions_mm=positions,
        focal_px=400.0,
        centre_px=np.array([95.0, 62.0]),
        width_px=190,
        height_px=120,
        reference_depth_mm=400.0,
        reference_view_in_rig_mm=np.array([0.0, BEHIND_MM, 0.0]),
        view_from_rig=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        layout_identity="0123456789abcdef",
    )


def seen(of: Views) -> tuple[NDArray[np.float32], FloatArray, NDArray[np.bool_]]:
    """What pinholes see of a tilted wall and a square before it (t, s, v, u), the distances along view z, and edges."""
    pixels, distances = [], []
    edges = []
    for view in np.ndindex(of.rows, of.cols):
        matrix, place = of.matrices[view], of.positions_mm[view]
        rays = (of.pixel_grid() - matrix[:2, 2]) / matrix[0, 0]
        # The wall: z = 500 + 0.4 x - 0.2 y; the square: z = 420, |x| and |y - 5| up to 25.
        wall = (500.0 + 0.4 * place[0] - 0.2 * place[1] - place[2]) / (1.0 - 0.4 * rays[..., 0] + 0.2 * rays[..., 1])
        square = np.full(wall.shape, 420.0 - place[2])
        on_square = rays * square[..., None] + place[:2]
        hit = (np.abs(on_square - [0.0, 5.0]) <= 25.0).all(axis=-1)
        along = np.where(hit, square, wall)
        at = rays * along[..., None] + place[:2]
        pixels.append(waves(at[..., 0], at[..., 1] + 40.0 * hit))
        distances.append(along + place[2])
        edge = np.zeros_like(hit)
        for axis in (0, 1):
            for shift in (-2, -1, 1, 2):
                edge |= np.roll(hit, shift, axis=axis) != hit
        edges.append(edge)
    grid = (of.rows, of.cols, of.height_px, of.width_px)
    return (
        np.array(pixels, dtype=np.float32).reshape(grid),
        np.array(distances).reshape(grid),
        np.array(edges).reshape(grid),
    )


@pytest.fixture(scope="module")
def true() -> LightField:
    samples, _, _ = seen(views())
    return LightField.of(views(), samples[..., None], np.ones(samples.shape, np.float32))


def test_moved_views_are_what_pinholes_on_the_grid_see(true: LightField) -> None:
    depth_mm = seen(views())[1][1, 1] + BEHIND_MM
    moved = moved_to_regular_grid(true, depth_mm)
    expected, _, edges = seen(true.on_regular_grid())
    assert not moved.positions_mm[..., 2].any()
    assert np.allclose(np.diff(moved.positions_mm, axis=0)[..., 1], moved.step_mm("t"))
    assert np.array_equal(moved.samples[1, 1], true.samples[1, 1])
    for view in np.ndindex(3, 3):
        good = moved.valid[view] & ~edges[view]
        assert moved.valid[view].mean() > 0.75
        error = np.abs(moved.samples[view][..., 0] - expected[view])
        assert error[good].max() < 0.02
        # What hides or shows beside an edge is taken from the right side of it, but for a pixel or so.
        assert (error[moved.valid[view]] > 0.05).mean() < 0.01
        if view != (1, 1):
            unmoved = np.abs(true.samples[view][..., 0] - expected[view])
            assert np.median(unmoved[good]) > 4 * np.median(error[good])
    assert not moved.samples[~moved.valid].any()


def test_on_the_reference_plane_nothing_moves() -> None:
    random = np.random.default_rng(0).random((3, 3, 120, 190, 1)).astype(np.float32)
    light_field = LightField.of(views(), random, np.ones(random.shape[:4], np.float32))
    moved = moved_to_regular_grid(light_field, np.full((120, 190), 400.0))
    inner = moved.valid[:, :, 1:-1, 1:-1]
    assert inner.all()
    assert np.abs(moved.samples - random)[:, :, 1:-1, 1:-1].max() < 0.02


def test_where_no_depth_is_known_nothing_is_claimed(true: LightField) -> None:
    depth_mm = seen(views())[1][1, 1] + BEHIND_MM
    depth_mm[:, :90] = np.nan
    moved = moved_to_regular_grid(true, depth_mm)
    for view in np.ndindex(3, 3):
        if view != (1, 1):
            assert not moved.valid[view][:, :60].any()
            assert moved.valid[view][5:-5, 130:150].all()


def test_depth_maps_that_do_not_fit_are_refused(true: LightField) -> None:
    with pytest.raises(InputError, match=r"^depth map has shape \(3, 4\), expected \(120, 190\) of the views$"):
        moved_to_regular_grid(true, np.ones((3, 4)))
    with pytest.raises(InputError, match=r"^depth map has a depth of -90 mm, expected all beyond -7\d\.?\d* mm$"):
        moved_to_regular_grid(true, np.full((120, 190), -90.0))
