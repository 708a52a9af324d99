"""The side of a board's markers is measured in pictures, independent of the stated one."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.detection import marker_layout as module
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.marker_layout import (
    NEIGHBOUR_OFFSETS,
    GriddedPicture,
    MarkerPairs,
    VerticalPairs,
    marker_pairs,
    marker_side,
)
from mirrorcam.optics.geometry.boards import AprilGrid, Charuco
from tests.nightly import a_few
from tests.optics.calibration.detection.aprilgrid_sheet import GRID, Sheet
from tests.optics.calibration.detection.one_mirror import CAMERA, one_mirror
from tests.optics.synthetic import posed, render

# Sides that the renderer draws exactly: whole modules of its 48 px for a square.
BOARD = Charuco(cols=12, rows=8, square_mm=24.0, marker_mm=18.0)
ODD = Charuco(cols=9, rows=7, square_mm=18.0, marker_mm=13.0)


@pytest.mark.parametrize("mirrored", a_few(3, [False, True]))
@pytest.mark.parametrize(
    ("cols", "side", "blur_px"), [(12, 0.75, 1.5), (12, 0.5, 0.5), (8, 0.75, 0.5), (16, 0.625, 1.5)]
)
def test_the_side_is_measured(cols: int, side: float, blur_px: float, *, mirrored: bool) -> None:
    square_mm = 288.0 / cols
    printed = BOARD.replaced(cols=cols, rows=round(cols / 1.5), square_mm=square_mm, marker_mm=side * square_mm)
    place = np.array([0.0, 350.0, 80.0]) if mirrored else np.array([0.0, 0.0, 320.0])
    pose = posed(printed, place, np.array([10.0, 12.0, 20.0]), direct=not mirrored)
    layout = one_mirror() if mirrored else None
    picture = render(CAMERA, layout, printed, pose, noise_grey=2.0, blur_px=blur_px)
    for stated in (side, 1.2 * side, 0.7 * side):
        board = printed.replaced(marker_mm=stated * square_mm)
        shown = [GriddedPicture.of(picture, board)]
        found = marker_side(shown, board, mirrored=None if stated == side else mirrored)
        assert found is not None
        assert abs(found - side) < 0.015


def test_the_side_is_measured_from_a_rough_one_far_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "TRIAL_SIDES", (0.6,))
    pose = posed(BOARD, np.array([0.0, 0.0, 320.0]), np.array([10.0, 12.0, 20.0]), direct=True)
    picture = render(CAMERA, None, BOARD, pose, noise_grey=2.0)
    stated = BOARD.replaced(marker_mm=0.55 * BOARD.square_mm)
    found = marker_side([GriddedPicture.of(picture, stated)], stated, mirrored=False)
    assert found == pytest.approx(0.75, abs=0.015)


def test_a_blank_picture_shows_no_markers() -> None:
    assert marker_side([GriddedPicture.of(np.full((200, 300), 90, np.uint8), BOARD)], BOARD, mirrored=None) is None


def steps_in(picture: Grey, board: AprilGrid | Charuco, *, mirrored: bool) -> VerticalPairs:
    return marker_pairs(GriddedPicture.of(picture, board), board, mirrored=mirrored).vertical(board)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("printed", "columns"), [(Sheet(), 6), (ODD, 9), (ODD.replaced(cols=10), 10)])
def test_columns_are_read(printed: Sheet | Charuco, columns: int, *, mirrored: bool) -> None:
    place = np.array([0.0, 350.0, 80.0]) if mirrored else np.array([0.0, 0.0, 320.0])
    pose = posed(printed, place, np.array([12.0, -10.0, 30.0]), direct=not mirrored)
    picture = render(CAMERA, one_mirror() if mirrored else None, printed, pose, noise_grey=2.0)
    # Only the kind of markers is taken from the board.
    board = GRID.replaced(cols=3, rows=8) if isinstance(printed, Sheet) else printed.replaced(cols=12, rows=4)
    likely, steps = steps_in(picture, board, mirrored=mirrored).majority
    highest = steps.highest
    assert likely == columns
    # The last row of squares lies beyond the inner corners.
    rows = (2 * highest + 1) // columns + 1 + steps.has_next_row
    assert rows.max() <= (8 if isinstance(printed, Sheet) else printed.rows)
    # Corners of markers hide some of a ChArUco board's corners.
    assert len(highest) >= (12 if isinstance(printed, Sheet) else 1)
    last = 23 if isinstance(printed, Sheet) else printed.cols * printed.rows // 2 - 1
    assert columns <= highest.min() <= highest.max() <= last
    assert len(steps_in(picture, board, mirrored=not mirrored).majority[1].highest) < 3


def test_a_layout_without_half_of_the_pairs_is_unlikely() -> None:
    steps = VerticalPairs(np.array([4, 4, 7, 9]), np.arange(4), np.zeros(4, np.int64))
    assert steps.majority[0] == 0
    more = VerticalPairs(*np.array([[4, 4, 7, 9, 4], [0, 1, 2, 3, 9], [0, 0, 0, 0, 1]]))
    assert more.majority[0] == 4
    assert more.majority[1].highest.tolist() == [0, 1, 9]
    assert more.majority[1].has_next_row.tolist() == [0, 0, 1]
    blank = np.full((200, 300), 80, dtype=np.uint8)
    assert steps_in(blank, ODD, mirrored=False).majority[0] == 0


@pytest.mark.parametrize(("cols", "rows"), [(6, 6), (5, 8), (8, 5), (7, 7)])
@pytest.mark.parametrize("legacy", [False, True])
def test_only_the_right_numbering_explains_all_neighbours(cols: int, rows: int, *, legacy: bool) -> None:
    board = ODD.replaced(cols=cols, rows=rows, legacy=legacy, first_marker=11)
    at = {(int(col), int(row)): 11 + number for number, (row, col) in enumerate(board.marker_squares)}
    pairs = MarkerPairs.of(
        [
            (n, at[x + dx, y + dy], (dx, dy))
            for (x, y), n in at.items()
            for dx, dy in NEIGHBOUR_OFFSETS
            if (x + dx, y + dy) in at
        ],
        inner=False,
    )
    slanted = int((pairs.offset[:, 0] != 0).sum())
    white = not board.black[0, 0]
    assert pairs.count_consistent(cols, 11, white_first=white) == slanted
    # With an odd number of columns, only pairs at the ends of rows distinguish the patterns.
    assert pairs.count_consistent(cols, 11, white_first=not white) <= (slanted - (rows - 1) if cols % 2 else 0)
    for phase in range(1, cols):
        assert pairs.count_consistent(cols, 11 + phase, white_first=white) < slanted
    assert pairs.vertical(board).majority[0] == cols
