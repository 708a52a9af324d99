"""Linking of the corners of AprilGrids."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.detection.tag_grids import linked_tags
from mirrorcam.optics.geometry.targets import Checkerboard
from tests.optics.calibration.detection.aprilgrid_sheet import GRID, Sheet
from tests.optics.calibration.detection.one_mirror import CAMERA, seen
from tests.optics.synthetic import posed, render


@pytest.mark.parametrize("turn_deg", [0.0, 40.0, 90.0, 200.0])
def test_corners_are_linked_and_tags_told_from_gaps(turn_deg: float) -> None:
    pose = posed(Sheet(), np.array([0.0, 0.0, 320.0]), np.array([15.0, -20.0, turn_deg]), direct=True)
    picture = render(CAMERA, None, Sheet(), pose, noise_grey=1.0)
    (places, pixels), *others = linked_tags(picture, GRID)
    assert others == []
    assert len(places) > 80
    truth = seen(GRID.corners_in_board_mm, pose, None)
    apart = np.linalg.norm(pixels[:, None] - truth, axis=2)
    assert apart.min(axis=1).max() < 1.0
    row, col = np.divmod(apart.argmin(axis=1), 2 * GRID.cols)
    true = {(int(c), int(r)): number for number, (c, r) in enumerate(zip(col, row, strict=True))}
    for number, (x, y) in enumerate(zip(col, row, strict=True)):
        # The corner across a tag, along the grid's own axes.
        x, y = int(x), int(y)
        other = true.get((x + 1 if x % 2 == 0 else x - 1, y))
        if other is None:
            continue
        low = np.minimum(places[number], places[other])
        axis = int(np.flatnonzero(places[number] != places[other])[0])
        assert np.abs(places[number] - places[other]).sum() == 1
        assert low[axis] % 2 == (1, 0)[axis], "tags begin at odd x and even y"


def test_a_checkerboard_is_none() -> None:
    board = Checkerboard(cols=9, rows=7, square_mm=16.0)
    pose = posed(board, np.array([0.0, 0.0, 320.0]), np.array([15.0, -20.0, 10.0]), direct=True)
    assert linked_tags(render(CAMERA, None, board, pose), GRID) == []
