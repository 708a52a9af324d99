"""Checkerboards that are wholly visible are found under the distortion of a fisheye lens."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey, find_checkerboards
from mirrorcam.optics.calibration.detection.whole_board import whole_board
from mirrorcam.optics.geometry.targets import Checkerboard

BOARD = Checkerboard(cols=5, rows=7, square_mm=30.0)
FOCAL_PX, MIDDLE, SIZE = 190.0, 300.0, 601


def through_fisheye(*, flipped: bool) -> tuple[Grey, FloatArray]:
    """A picture of the board very near to an equidistant lens, and the pixels (24, 2) of its corners."""
    print_ = np.pad(BOARD.image(40), 40, constant_values=255)
    v, u = (np.indices((SIZE, SIZE)) - MIDDLE) / FOCAL_PX
    angle = np.hypot(u, v)
    out = np.tan(np.minimum(angle, 1.5)) / np.maximum(angle, 1e-9)
    middle = np.array([20.0, -30.0])
    x, y = (
        60.0 * axis * out + move + size / 2.0 for axis, move, size in zip((u, v), middle, BOARD.size_mm, strict=True)
    )
    on_print = np.stack([x, y], axis=2) / BOARD.square_mm
    at = ((on_print + 1.0) * 40.0 - 0.5).astype(np.float32)
    seen = cv2.GaussianBlur(cv2.remap(print_, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=120.0), (0, 0), 0.8)
    corners = (BOARD.corners_in_board_mm[:, :2] - np.array(BOARD.size_mm) / 2.0 - middle) / 60.0
    radius = np.linalg.norm(corners, axis=1, keepdims=True)
    pixels = MIDDLE + FOCAL_PX * np.arctan(radius) / np.maximum(radius, 1e-9) * corners
    if flipped:
        return np.ascontiguousarray(seen[:, ::-1]), pixels * [-1.0, 1.0] + [SIZE - 1.0, 0.0]
    return np.asarray(seen, dtype=np.uint8), pixels


@pytest.mark.parametrize("flipped", [False, True])
def test_all_corners_are_found_under_strong_distortion(*, flipped: bool) -> None:
    picture, truth = through_fisheye(flipped=flipped)
    (grid,) = find_checkerboards(picture, BOARD)
    numberings = grid.numberings(BOARD, mirrored=flipped)
    assert 0 < len(numberings) <= 2
    off = min(float(np.abs(one.pixels - truth[one.ids]).max()) for one in numberings)
    assert off < 0.5
    assert len(grid) == 24


def test_a_board_that_is_partly_hidden_or_of_another_size_is_not_whole() -> None:
    picture, _ = through_fisheye(flipped=False)
    assert whole_board(picture, BOARD) is not None
    assert whole_board(picture, BOARD.replaced(rows=9)) is None
    hidden = picture.copy()
    hidden[:, :270] = 128
    assert whole_board(hidden, BOARD) is None
    assert find_checkerboards(np.full((300, 400), 90, np.uint8), BOARD) == []
