"""Selection of sharp frames from all parts of a video, with different places and poses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.frame_choice import SharpestFrames, SharpFrame, most_informative
from mirrorcam.optics.calibration.solver.observations import Corners
from mirrorcam.optics.geometry.boards import Checkerboard

BOARD = Checkerboard(cols=8, rows=6, square_mm=20.0).corners_in_board_mm
TEXTURE = np.random.default_rng(0).uniform(0, 255, (60, 80))


def blurred(sigma_px: float) -> Grey:
    return gaussian_filter(TEXTURE, sigma_px).astype(np.uint8)


@pytest.mark.parametrize("frames", [1, 7, 8, 50, 137])
def test_each_section_contributes_its_sharpest_frame(frames: int) -> None:
    """Every fifth frame is sharp; at most eight sharp frames are kept, from all parts of the video."""
    kept = SharpestFrames(8)
    for number in range(frames):
        kept.add(SharpFrame.of(number, blurred(0.5 if number % 5 == 3 else 2.0)))
    chosen = kept.chosen()
    numbers = [frame.number for frame in chosen]
    assert len(chosen) == min(frames, 8)
    assert numbers == sorted(set(numbers))
    if frames >= 50:
        assert all(number % 5 == 3 for number in numbers)
        assert numbers[0] < frames / 6 and numbers[-1] > frames * 5 / 6
        assert np.diff(numbers).max() < 3 * frames / 8


def test_a_picture_is_less_sharp_the_more_it_is_blurred() -> None:
    sharpness = [SharpFrame.of(0, blurred(sigma)).sharpness for sigma in (0.3, 1.0, 3.0)]
    assert sharpness[0] > 4 * sharpness[1] > 16 * sharpness[2]


def seen(x: float, y: float, turn_deg: float, size: float = 1.0, shortened: float = 1.0) -> Corners:
    """Return a board at a place, rotated and scaled in the picture, and foreshortened along its rows."""
    drawn = (BOARD[:, :2] - BOARD[:, :2].mean(axis=0)) * [shortened, 1.0] * size
    angle = np.radians(turn_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return Corners(np.arange(len(BOARD)), drawn @ turn.T + [x, y])


def test_frames_that_show_something_else_are_preferred() -> None:
    still = [[seen(200, 200, 3.0)] for _ in range(20)]
    moving = [
        [seen(400, 200, 3.0)],
        [seen(200, 350, 3.0)],
        [seen(200, 200, 60.0)],
        [seen(200, 200, 3.0, size=1.8)],
        [seen(200, 200, 3.0, shortened=0.5)],
    ]
    frames = [*still[:10], *moving, *still[10:], []]
    chosen = most_informative(frames, BOARD, width_px=640, max_frames=6)
    assert len(chosen) == 6
    assert set(range(10, 15)) < set(chosen)


def test_frames_without_a_board_are_never_chosen() -> None:
    few = Corners(np.arange(3), seen(100, 100, 0.0).pixels[:3])
    assert most_informative([[], [seen(300, 200, 0.0)], [few]], BOARD, width_px=640, max_frames=5) == [1]
