"""Saddle points of drawn corners with known places, edges and colours."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.corner_grids import SaddlePoints, corner_grids, saddle_points
from mirrorcam.optics.calibration.solver.observations import IntArray

MIDDLE = np.array([50.3, 48.6])
UPRIGHT = np.array([[20.0, 0.0, 50.0], [0.0, 20.0, 60.0], [0.0, 0.0, 1.0]])
SLANTED = np.array([[18.0, -9.0, 300.0], [7.0, 14.0, 90.0], [0.01, -0.02, 1.0]])


def corner(first_deg: float, second_deg: float, *, blur_px: float = 0.8) -> NDArray[np.uint8]:
    """A corner at `MIDDLE`: white from the first edge to the second one, clockwise, and opposite."""
    fine = 8
    y, x = (np.mgrid[: 100 * fine, : 100 * fine] + 0.5) / fine - 0.5
    angle = np.degrees(np.arctan2(y - MIDDLE[1], x - MIDDLE[0]))
    white = (angle - first_deg) % 180.0 < (second_deg - first_deg) % 180.0
    drawn = np.where(white, 200.0, 40.0).reshape(100, fine, 100, fine).mean(axis=(1, 3))
    return np.rint(cv2.GaussianBlur(drawn, (0, 0), blur_px)).astype(np.uint8)


def nearest(points: SaddlePoints) -> tuple[float, FloatArray]:
    off = np.linalg.norm(points.pixels - MIDDLE, axis=1)
    return float(off.min()), np.degrees(points.axes[off.argmin()])


@pytest.mark.parametrize("edges_deg", [(0.0, 90.0), (90.0, 0.0), (20.0, 110.0), (130.0, 60.0), (5.0, 50.0)])
@pytest.mark.parametrize("blur_px", [0.6, 2.0, 5.0])
def test_a_corner_is_found_with_its_edges_and_colours(edges_deg: tuple[float, float], blur_px: float) -> None:
    off_px, axes_deg = nearest(saddle_points(corner(*edges_deg, blur_px=blur_px)))
    assert off_px < 0.5 + 0.2 * blur_px
    turned = (axes_deg - edges_deg + 90.0) % 180.0 - 90.0
    # Blur widens the acute angle between the edges.
    assert np.abs(turned).max() < (15.0 if edges_deg != (5.0, 50.0) else 25.0)


def test_edges_and_ends_of_lines_are_not_corners() -> None:
    picture = np.full((100, 100), 40, np.uint8)
    picture[30:70, 30:70] = 200  # corners of a square
    assert len(saddle_points(picture)) == 0


def test_points_near_others_are_not_added() -> None:
    first = SaddlePoints(np.array([[10.0, 10.0]]), np.zeros((1, 2)), np.ones(1))
    second = SaddlePoints(np.array([[11.0, 10.0], [20.0, 10.0]]), np.zeros((2, 2)), np.ones(2))
    np.testing.assert_array_equal(first.with_new(second, 2.0).pixels, [[10.0, 10.0], [20.0, 10.0]])
    assert len(first.where(np.array([False])).with_new(second, 2.0)) == 2


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
    return first.with_new(second, 0.0)


@pytest.mark.parametrize("map_px", [UPRIGHT, SLANTED, np.diag([0.3, 1.0, 1.0]) @ UPRIGHT])
def test_a_grid_is_linked(map_px: FloatArray) -> None:
    points, places = grid(map_px)
    shuffled = np.random.default_rng(0).permutation(len(points))
    ((members, found),) = corner_grids(points.where(shuffled))
    true = places[shuffled[members]]
    assert len(members) == len(points)
    # The places are correct up to a rotation, and a shift that keeps the colours.
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


def test_two_grids_are_separated() -> None:
    first, _ = grid(UPRIGHT)
    turned = np.array([[0.8, -0.6, 300.0], [0.6, 0.8, 20.0], [0.0, 0.0, 1.0]]) @ UPRIGHT
    second, _ = grid(turned, cols=4, rows=4)
    sizes = [len(members) for members, _ in corner_grids(joined(first, second))]
    assert sizes == [35, 16]


def test_few_points_form_no_grid() -> None:
    points, _ = grid(UPRIGHT, cols=2, rows=2)
    assert corner_grids(points) == []
