"""Growing a board from a few points, and dropping corners off its surface."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.board_growing import grow_board, on_smooth_surface, same_board
from mirrorcam.optics.calibration.detection.board_warp import corner_print_xy
from mirrorcam.optics.calibration.solver.observations import Corners
from mirrorcam.optics.geometry.boards import Charuco
from tests.optics.calibration.detection.one_mirror import CAMERA, seen
from tests.optics.synthetic import posed, render

BOARD = Charuco(cols=11, rows=7, square_mm=18.0, marker_mm=11.25)
PLACES = corner_print_xy(BOARD)


@pytest.fixture(scope="module")
def shown() -> tuple[np.ndarray, FloatArray]:
    """Return a picture of the board, seen directly, and the pixels of its corners."""
    pose = posed(BOARD, np.array([10.0, 0.0, 300.0]), np.array([10.0, -12.0, 6.0]), direct=True)
    picture = render(CAMERA, None, BOARD, pose, noise_grey=1.0).astype(np.float32)
    return picture, seen(BOARD.corners_in_board_mm, pose, None)


def test_a_board_grows_from_one_cell_to_all_its_corners(shown: tuple[np.ndarray, FloatArray]) -> None:
    picture, truth = shown
    cell = np.array([0, 1, 10, 11])
    off = np.random.default_rng(0).normal(0.0, 0.3, (4, 2))
    found = grow_board(picture, PLACES[cell], truth[cell] + off, BOARD, mirrored=False)
    assert len(found) == len(PLACES)
    assert np.sqrt(np.mean((found.pixels - truth[found.ids]) ** 2)) < 0.01


def test_a_covered_part_is_left_out(shown: tuple[np.ndarray, FloatArray]) -> None:
    picture, truth = shown
    covered = picture.copy()
    covered[:, 450:] = 90.0
    found = grow_board(covered, PLACES[[0, 1, 10, 11]], truth[[0, 1, 10, 11]], BOARD, mirrored=False)
    assert len(found) > 20
    assert found.pixels[:, 0].max() < 450.0
    assert np.linalg.norm(found.pixels - truth[found.ids], axis=1).max() < 0.1


def test_a_mirrored_board_is_rejected(shown: tuple[np.ndarray, FloatArray]) -> None:
    picture, truth = shown
    assert len(grow_board(picture, PLACES[[0, 1, 10, 11]], truth[[0, 1, 10, 11]], BOARD, mirrored=True)) == 0


def test_corners_off_the_surface_are_dropped() -> None:
    pixels = 25.0 * PLACES + 0.3 * np.square(PLACES)
    pixels[[7, 40]] += [0.0, 2.0]
    keep = on_smooth_surface(PLACES, pixels)
    np.testing.assert_array_equal(np.flatnonzero(~keep), [7, 40])
    assert not on_smooth_surface(PLACES[:7], pixels[:7]).any(), "too few to judge"


def test_no_corner_beyond_a_step_is_kept() -> None:
    pixels = 25.0 * PLACES
    right = PLACES[:, 0] > 6.5
    pixels[right] += [0.0, 4.0]
    keep = on_smooth_surface(PLACES, pixels)
    assert not (keep & right).any()
    assert keep.sum() >= 8


def test_boards_are_the_same_where_most_common_corners_are() -> None:
    first = Corners(np.arange(10), 20.0 * PLACES[:10])
    shifted = Corners(np.arange(5, 15), 20.0 * PLACES[5:15] + 0.5)
    assert same_board(first, shifted)
    assert not same_board(first, Corners(first.ids, first.pixels + 30.0))
    assert not same_board(first, Corners(np.arange(20, 25), first.pixels[:5]))
