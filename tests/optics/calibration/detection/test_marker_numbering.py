"""Numbering by markers, of parts of a drawn board whose corners are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.calibration.detection.blurred_print import Image
from mirrorcam.optics.calibration.detection.detections import NO_LIMITS, QUARTER_ROTATIONS, DetectedGrid
from mirrorcam.optics.calibration.detection.marker_numbering import Markers, numbered_by_markers
from mirrorcam.optics.calibration.solver.observations import Corners
from mirrorcam.optics.geometry.boards import Charuco

BOARD = Charuco(cols=12, rows=9, square_mm=10.0, marker_mm=7.5)
SIDE = 24
WHITE = [(col, row) for row in range(9) for col in range(12) if (row + col) % 2]
MARKERS = Markers(
    codes=np.array(
        [
            BOARD.opencv_board.getDictionary().generateImageMarker(n, 6, borderBits=1)[1:-1, 1:-1] > 0
            for n in range(len(WHITE))
        ]
    ),
    grid_xy=np.array(WHITE) - 1,
    side=0.75,
    parity=1,
)


def drawn(*, blur_px: float) -> Image:
    return np.asarray(cv2.GaussianBlur(BOARD.image(SIDE).astype(np.float32), (0, 0), blur_px), dtype=np.float32)


def part(cols: slice, rows: slice, turn: int) -> tuple[DetectedGrid, np.ndarray]:
    """Return a grid of corners with its own coordinates, and their true ones."""
    x, y = np.meshgrid(np.arange(11)[cols], np.arange(8)[rows])
    true = np.stack([x.ravel(), y.ravel()], axis=1)
    by = np.array([5, -3])
    by[0] += (by.sum() + turn) % 2 == 0
    corners = Corners(np.arange(len(true)), (SIDE * (true + 1.0) - 0.5).astype(np.float64))
    return DetectedGrid(true @ QUARTER_ROTATIONS[turn].T + by, corners, NO_LIMITS), true


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("blur_px", [0.7, 3.0])
def test_a_part_is_numbered(turn: int, blur_px: float) -> None:
    for cols, rows in ((np.s_[:], np.s_[:]), (np.s_[2:7], np.s_[3:7])):
        grid, true = part(cols, rows, turn)
        found = numbered_by_markers(drawn(blur_px=blur_px), grid, MARKERS)
        assert found is not None
        np.testing.assert_array_equal(found.grid_xy, true)


def test_a_part_without_markers_of_the_board_is_not_numbered() -> None:
    grid, _ = part(np.s_[2:7], np.s_[3:7], 0)
    other = BOARD.replaced(dictionary="DICT_4X4_1000").opencv_board.getDictionary()
    codes = np.array([other.generateImageMarker(n + 700, 6, borderBits=1)[1:-1, 1:-1] > 0 for n in range(len(WHITE))])
    picture = drawn(blur_px=0.7)
    assert numbered_by_markers(picture, grid, Markers(codes, MARKERS.grid_xy, 0.75, parity=1)) is None
    assert numbered_by_markers(np.full_like(picture, 90.0), grid, MARKERS) is None
    mirrored = np.ascontiguousarray(picture[:, ::-1])
    assert numbered_by_markers(mirrored, grid, MARKERS) is None
    line, _ = part(np.s_[:], np.s_[:1], 0)
    assert numbered_by_markers(picture, line, MARKERS) is None
