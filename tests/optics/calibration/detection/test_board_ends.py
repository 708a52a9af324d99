"""Ends of a board that are seen, and edges that cut a board off and are none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.optics.calibration.detection.board_ends import board_ends
from mirrorcam.optics.geometry.targets import Checkerboard

BOARD = Checkerboard(cols=9, rows=8, square_mm=1.0)
SIDE, MARGIN = 20, 40
ALL = np.ones((2, 2), dtype=bool)


def drawn(*, beyond: int) -> NDArray[np.float32]:
    """The board with a margin of one square of white paper, and what lies beyond."""
    paper = np.full((10 * SIDE, 11 * SIDE), 220, np.uint8)
    paper[SIDE:-SIDE, SIDE:-SIDE] = 30 + 190 * (BOARD.image(SIDE) > 0)
    picture = np.pad(paper, MARGIN, constant_values=beyond)
    return np.asarray(cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0), dtype=np.float32)


def ends(picture: NDArray[np.float32], cols: slice, rows: slice) -> NDArray[np.bool_]:
    """Ends by the corners of some columns and rows."""
    x, y = np.meshgrid(np.arange(8)[cols], np.arange(7)[rows])
    corners = np.stack([x.ravel(), y.ravel()], axis=1)
    pixels = np.asarray(MARGIN + SIDE * (corners + 2.0) - 0.5, dtype=np.float64)
    # The first corner has black right of and below it, so that its sum is odd.
    return np.isfinite(board_ends(picture, corners + np.array([1, 0]), pixels))


@pytest.mark.parametrize("beyond", [20, 120, 250])
def test_a_whole_board_ends_on_all_sides(beyond: int) -> None:
    np.testing.assert_array_equal(ends(drawn(beyond=beyond), np.s_[:], np.s_[:]), ALL)


def test_a_board_that_goes_on_does_not_end() -> None:
    found = ends(drawn(beyond=20), np.s_[2:], np.s_[:5])
    np.testing.assert_array_equal(found, [[False, True], [True, False]])


@pytest.mark.parametrize("grey", [20, 120, 220])
@pytest.mark.parametrize("squares", [0.3, 0.6, 0.9, 1.1, 1.4])
def test_an_occluder_is_no_end(grey: int, squares: float) -> None:
    """Also one of the paper's colour, along the grid, unless it begins where the board might end."""
    picture = drawn(beyond=20)
    last = 4
    picture[:, int(MARGIN + SIDE * (last + 2 + squares)) :] = grey
    if not (grey == 220 and 0.85 < squares < 1.15):
        assert not ends(picture, np.s_[: last + 1], np.s_[:])[1, 0]


def test_few_squares_do_not_tell() -> None:
    assert not ends(drawn(beyond=20), np.s_[:3], np.s_[:2]).any()
