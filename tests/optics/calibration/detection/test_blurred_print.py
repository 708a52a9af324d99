"""The print as an image: its values at corners, the sizes of its markers, its derivatives."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.calibration.detection.blurred_print import (
    PX_PER_SQUARE,
    blurred_print,
    image_px_of_print,
    px_per_pitch,
    sample,
    sample_blurred,
)
from mirrorcam.optics.geometry.boards import AprilGrid, Charuco, Checkerboard

PLAIN = Checkerboard(cols=6, rows=5, square_mm=10.0)
CHARUCO = Charuco(cols=6, rows=5, square_mm=10.0, marker_mm=7.3)


def at(places: np.ndarray) -> np.ndarray:
    """Pixels (1, n, 2) of the padded print at places (n, 2) in squares."""
    return ((places + 1.0) * PX_PER_SQUARE - 0.5)[None]


@pytest.mark.parametrize("board", [PLAIN, CHARUCO])
def test_inner_corners_are_half_black(board: Checkerboard | Charuco) -> None:
    places = board.corners_in_board_mm[:, :2] / board.square_mm
    value = blurred_print(board, 0.03).value
    np.testing.assert_allclose(sample(value, at(places)), 0.0, atol=1e-3)


def test_squares_are_black_from_the_top_left_and_the_margin_is_white() -> None:
    value = blurred_print(PLAIN, 0.02).value
    middles = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5], [-0.5, 2.5]])
    np.testing.assert_allclose(sample(value, at(middles))[0], [-1.0, 1.0, 1.0, -1.0, 1.0], atol=1e-5)


def test_the_ink_of_a_marker_is_exact_to_parts_of_a_pixel() -> None:
    """A marker's side of 7.3 mm is 29.2 px, so that its black border begins 14.6 px from its middle."""
    value = blurred_print(CHARUCO, 0.0).value  # the smallest blur
    steps = np.arange(-20.0, -10.0)
    row = sample(value, at(np.array([[1.5, 0.5]])) + np.stack([steps, np.zeros(10)], axis=1)[None])[0]
    edge = float(np.interp(0.0, row[::-1], steps[::-1]))
    assert edge == pytest.approx(-14.6, abs=0.15)
    assert abs(edge - round(edge)) > 0.2, "not where whole pixels would have it"


def test_derivatives_match_finite_differences() -> None:
    blurred = blurred_print(CHARUCO, 0.1)
    down, right = (d * PX_PER_SQUARE for d in np.gradient(blurred.value))
    np.testing.assert_allclose(blurred.derivatives[..., 0], right, atol=1e-4)
    np.testing.assert_allclose(blurred.derivatives[..., 1], down, atol=1e-4)
    mixed = np.gradient(right, axis=0) * PX_PER_SQUARE
    np.testing.assert_allclose(blurred.mixed[1:-1, 1:-1], mixed[1:-1, 1:-1], atol=1e-2)
    for axis, second in ((1, blurred.derivatives[..., 2]), (0, blurred.derivatives[..., 3])):
        numeric = np.diff(blurred.value, n=2, axis=axis) * PX_PER_SQUARE**2
        inner = second[:, 1:-1] if axis else second[1:-1]
        assert np.corrcoef(numeric.ravel(), inner.ravel())[0, 1] > 0.97


def test_a_directional_blur_equals_the_sharp_print_blurred_that_way() -> None:
    """A print blurred by 0.07 cells along a slant and 0.05 across it, against an image of twice the resolution."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    blur = turn @ np.diag([0.07**2, 0.05**2]) @ turn.T
    sharp = blurred_print(CHARUCO, 0.0)
    rest = blur - sharp.sigma**2 * np.eye(2)
    offsets = np.stack(np.meshgrid(*[np.arange(-12.0, 13.0)] * 2), axis=-1) / PX_PER_SQUARE
    kernel = np.exp(-0.5 * np.einsum("yxi,ij,yxj->yx", offsets, np.linalg.inv(rest), offsets))
    exact = np.asarray(cv2.filter2D(sharp.value, -1, kernel / kernel.sum()), dtype=np.float32)
    places = np.random.default_rng(0).uniform(1.2, 3.8, (1, 2000, 2))
    found = sample_blurred(CHARUCO, places, blur[None]).value
    expected = sample(exact, (places + 1.0) * PX_PER_SQUARE - 0.5)
    alike = sample(blurred_print(CHARUCO, 0.059).value, (places + 1.0) * PX_PER_SQUARE - 0.5)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.015
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.5 * np.sqrt(np.mean((alike - expected) ** 2))


@pytest.mark.parametrize("spacing", [0.2, 0.25, 0.3, 0.33])
def test_a_print_of_tags_is_half_black_at_its_corners(spacing: float) -> None:
    board = AprilGrid(cols=3, rows=2, tag_mm=20.0, spacing=spacing)
    assert 32 <= px_per_pitch(board) <= 60
    at = image_px_of_print(board, board.corners_in_board_mm[:, :2] / board.pitch_mm)
    values = sample(blurred_print(board, 0.02).value, at[None])
    assert np.abs(values).max() < 0.02
    # The paper around it is white.
    assert blurred_print(board, 0.02).value[0].min() == 1.0
