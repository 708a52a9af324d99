"""The print as an image: its values at corners, the sizes of its markers, its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE, blurred_print, sample
from mirrorcam.optics.geometry.targets import Charuco, Checkerboard, Target

PLAIN = Checkerboard(cols=6, rows=5, square_mm=10.0)
CHARUCO = Charuco(cols=6, rows=5, square_mm=10.0, marker_mm=7.3)


def at(places: np.ndarray) -> np.ndarray:
    """Pixels (1, n, 2) of the padded print at places (n, 2) in squares."""
    return ((places + 1.0) * PX_PER_SQUARE - 0.5)[None]


@pytest.mark.parametrize("target", [PLAIN, CHARUCO])
def test_inner_corners_are_half_black(target: Target) -> None:
    places = target.corners_in_board_mm[:, :2] / target.square_mm
    value = blurred_print(target, 0.03).value
    np.testing.assert_allclose(sample(value, at(places)), 0.0, atol=1e-3)


def test_squares_are_black_from_the_top_left_and_the_margin_is_white() -> None:
    value = blurred_print(PLAIN, 0.02).value
    middles = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5], [-0.5, 2.5]])
    np.testing.assert_allclose(sample(value, at(middles))[0], [-1.0, 1.0, 1.0, -1.0, 1.0], atol=1e-5)


def test_the_ink_of_a_marker_is_exact_to_parts_of_a_pixel() -> None:
    """A marker's side of 7.3 mm is 29.2 px: its black border covers 0.6 px of the 15th pixel left of its middle."""
    value = blurred_print(CHARUCO, 0.0).value  # the least blur there is
    middle = at(np.array([[1.5, 0.5]]))
    row = sample(value, middle + np.stack([np.arange(-20.0, 20.0), np.zeros(40)], axis=1)[None])[0]
    white = np.sum(1.0 + row) / 2.0
    assert 40.0 - white >= 2.0 * 29.2 / CHARUCO.opencv.getDictionary().markerSize / 2.0
    edge = np.interp(0.0, row[:10][::-1], np.arange(-20.0, -10.0)[::-1])
    assert edge == pytest.approx(-29.2 / 2.0, abs=0.15)


def test_derivatives_are_those_of_the_value() -> None:
    blurred = blurred_print(CHARUCO, 0.1)
    down, right = (d * PX_PER_SQUARE for d in np.gradient(blurred.value))
    np.testing.assert_allclose(blurred.right, right, atol=1e-4)
    np.testing.assert_allclose(blurred.down, down, atol=1e-4)
    inner = np.s_[2:-2, 2:-2]
    numeric = sum(np.gradient(np.gradient(blurred.value, axis=k), axis=k) for k in (0, 1)) * PX_PER_SQUARE**2
    assert np.corrcoef(numeric[inner].ravel(), blurred.laplacian[inner].ravel())[0, 1] > 0.99
