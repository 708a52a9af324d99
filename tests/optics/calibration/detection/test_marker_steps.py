"""The number of columns of a board of any size, by the markers one above the other."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.detection.marker_steps import Steps, marker_steps
from mirrorcam.optics.geometry.targets import Charuco
from tests.optics.calibration.detection.aprilgrid_sheet import GRID, Sheet
from tests.optics.calibration.detection.one_mirror import CAMERA, one_mirror
from tests.optics.synthetic import posed, render

ODD = Charuco(cols=9, rows=7, square_mm=18.0, marker_mm=13.0)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("board", "columns"), [(Sheet(), 6), (ODD, 9), (ODD.replaced(cols=10), 10)])
def test_columns_are_read(board: Sheet | Charuco, columns: int, *, mirrored: bool) -> None:
    place = np.array([0.0, 350.0, 80.0]) if mirrored else np.array([0.0, 0.0, 320.0])
    pose = posed(board, place, np.array([12.0, -10.0, 30.0]), direct=not mirrored)
    picture = render(CAMERA, one_mirror() if mirrored else None, board, pose, noise_grey=2.0)
    # Of the target, only what its markers are like counts.
    target = GRID.replaced(cols=3, rows=8) if isinstance(board, Sheet) else board.replaced(cols=12, rows=4)
    likely, steps = marker_steps(picture, target, mirrored=mirrored).likely
    highest = steps.highest
    assert likely == columns
    # The last row of squares lies beyond the inner corners.
    rows = (2 * highest + 1) // columns + 1 + steps.follows
    assert rows.max() <= (8 if isinstance(board, Sheet) else board.rows)
    # Corners of markers hide some of a ChArUco board's own.
    assert len(highest) >= (12 if isinstance(board, Sheet) else 1)
    last = 23 if isinstance(board, Sheet) else board.cols * board.rows // 2 - 1
    assert columns <= highest.min() <= highest.max() <= last
    assert len(marker_steps(picture, target, mirrored=not mirrored).likely[1].highest) < 3


def test_what_no_half_of_the_pairs_says_is_not_likely() -> None:
    steps = Steps(np.array([4, 4, 7, 9]), np.arange(4), np.zeros(4, np.int64))
    assert steps.likely[0] == 0
    more = Steps.together([steps, Steps(np.array([4]), np.array([9]), np.array([1]))])
    assert more.likely[0] == 4
    assert more.likely[1].highest.tolist() == [0, 1, 9]
    assert more.likely[1].follows.tolist() == [0, 0, 1]
    blank = np.full((200, 300), 80, dtype=np.uint8)
    assert marker_steps(blank, ODD, mirrored=False).likely[0] == 0
