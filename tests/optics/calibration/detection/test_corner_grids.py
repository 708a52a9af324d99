"""Linking of corners whose places on the grid are known."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.corner_grids import corner_grids
from mirrorcam.optics.calibration.detection.saddle_points import SaddlePoints
from mirrorcam.optics.calibration.solver.observations import IntArray


def grid(map_px: FloatArray, *, cols: int = 7, rows: int = 5) -> tuple[SaddlePoints, IntArray]:
    """The corners of a grid under a homography (3, 3), and their places (n, 2)."""
    places = np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).reshape(-1, 2)

    def seen(at: FloatArray) -> FloatArray:
        lifted = np.column_stack([at, np.ones(len(at))]) @ map_px.T
        return np.asarray(lifted[:, :2] / lifted[:, 2:])

    pixels = seen(places.astype(float))
    right, down = (seen(places + step) - pixels for step in (np.array([0.01, 0.0]), np.array([0.0, 0.01])))
    along = np.stack([np.arctan2(d[:, 1], d[:, 0]) for d in (right, down)], axis=1) % np.pi
    # White right of and below where the sum is even.
    axes = np.where(places.sum(axis=1)[:, None] % 2 == 0, along, along[:, ::-1])
    return SaddlePoints(pixels, axes, np.ones(len(pixels))), places


def joined(first: SaddlePoints, second: SaddlePoints) -> SaddlePoints:
    return first.and_others(second, 0.0)


UPRIGHT = np.array([[20.0, 0.0, 50.0], [0.0, 20.0, 60.0], [0.0, 0.0, 1.0]])
SLANTED = np.array([[18.0, -9.0, 300.0], [7.0, 14.0, 90.0], [0.01, -0.02, 1.0]])


@pytest.mark.parametrize("map_px", [UPRIGHT, SLANTED, np.diag([0.3, 1.0, 1.0]) @ UPRIGHT])
def test_a_grid_is_linked_as_it_lies(map_px: FloatArray) -> None:
    points, places = grid(map_px)
    shuffled = np.random.default_rng(0).permutation(len(points))
    ((members, found),) = corner_grids(points.where(shuffled))
    true = places[shuffled[members]]
    assert len(members) == len(points)
    # The places are right up to a turn and a shift; the shift keeps the colours.
    turns = [np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turn) for turn in range(4)]
    shifts = [true - found @ turn.T for turn in turns]
    (right,) = [turn for turn, shift in enumerate(shifts) if (shift == shift[0]).all()]
    assert (shifts[right][0].sum() + right) % 2 == 0


def test_a_missing_corner_and_stray_points_do_no_harm() -> None:
    points, _ = grid(SLANTED)
    random = np.random.default_rng(1)
    stray = SaddlePoints(random.uniform(0, 500, (60, 2)), random.uniform(0, np.pi, (60, 2)), np.ones(60))
    kept = points.where(np.arange(len(points)) != 17)
    ((members, _),) = corner_grids(joined(kept, stray))
    assert (members < len(kept)).sum() >= len(kept) - 2
    assert (members >= len(kept)).sum() <= 2


def test_two_grids_are_told_apart() -> None:
    first, _ = grid(UPRIGHT)
    turned = np.array([[0.8, -0.6, 300.0], [0.6, 0.8, 20.0], [0.0, 0.0, 1.0]]) @ UPRIGHT
    second, _ = grid(turned, cols=4, rows=4)
    sizes = [len(members) for members, _ in corner_grids(joined(first, second))]
    assert sizes == [35, 16]


def test_few_points_are_no_grid() -> None:
    points, _ = grid(UPRIGHT, cols=2, rows=2)
    assert corner_grids(points) == []
