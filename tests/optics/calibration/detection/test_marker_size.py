"""The side of a board's markers is measured in pictures, whatever side is stated."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.detection import marker_size as module
from mirrorcam.optics.calibration.detection.marker_size import marker_side
from mirrorcam.optics.calibration.detection.marker_steps import GriddedPicture
from mirrorcam.optics.geometry.targets import Charuco
from tests.optics.calibration.detection.one_mirror import CAMERA, one_mirror
from tests.optics.synthetic import posed, render

# Sides that the renderer draws exactly: whole modules of its 48 px for a square.
BOARD = Charuco(cols=12, rows=8, square_mm=24.0, marker_mm=18.0)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(
    ("cols", "side", "blur_px"), [(12, 0.75, 1.5), (12, 0.5, 0.5), (8, 0.75, 0.5), (16, 0.625, 1.5)]
)
def test_the_side_is_measured(cols: int, side: float, blur_px: float, *, mirrored: bool) -> None:
    square_mm = 288.0 / cols
    board = BOARD.replaced(cols=cols, rows=round(cols / 1.5), square_mm=square_mm, marker_mm=side * square_mm)
    place = np.array([0.0, 350.0, 80.0]) if mirrored else np.array([0.0, 0.0, 320.0])
    pose = posed(board, place, np.array([10.0, 12.0, 20.0]), direct=not mirrored)
    layout = one_mirror() if mirrored else None
    picture = render(CAMERA, layout, board, pose, noise_grey=2.0, blur_px=blur_px)
    for stated in (side, 1.2 * side, 0.7 * side):
        target = board.replaced(marker_mm=stated * square_mm)
        shown = [GriddedPicture.of(picture, target)]
        found = marker_side(shown, target, mirrored=None if stated == side else mirrored)
        assert found is not None
        assert abs(found - side) < 0.015


def test_the_side_is_measured_from_a_rough_one_far_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ROUGH", (0.6,))
    pose = posed(BOARD, np.array([0.0, 0.0, 320.0]), np.array([10.0, 12.0, 20.0]), direct=True)
    picture = render(CAMERA, None, BOARD, pose, noise_grey=2.0)
    stated = BOARD.replaced(marker_mm=0.55 * BOARD.square_mm)
    found = marker_side([GriddedPicture.of(picture, stated)], stated, mirrored=False)
    assert found == pytest.approx(0.75, abs=0.015)


def test_a_blank_picture_shows_no_markers() -> None:
    assert marker_side([GriddedPicture.of(np.full((200, 300), 90, np.uint8), BOARD)], BOARD, mirrored=None) is None
