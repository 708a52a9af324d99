"""Saddle points of drawn corners, whose places, edges and colours are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.saddle_points import SaddlePoints, saddle_points

MIDDLE = np.array([50.3, 48.6])


def corner(first_deg: float, second_deg: float, *, blur_px: float = 0.8) -> NDArray[np.uint8]:
    """A corner at `MIDDLE`: white from the first edge to the second one, clockwise, and opposite."""
    fine = 8
    y, x = (np.mgrid[: 100 * fine, : 100 * fine] + 0.5) / fine - 0.5
    angle = np.degrees(np.arctan2(y - MIDDLE[1], x - MIDDLE[0]))
    white = (angle - first_deg) % 180.0 < (second_deg - first_deg) % 180.0
    drawn = np.where(white, 200.0, 40.0).reshape(100, fine, 100, fine).mean(axis=(1, 3))
    return np.rint(cv2.GaussianBlur(drawn, (0, 0), blur_px)).astype(np.uint8)


def nearest(points: SaddlePoints) -> tuple[float, FloatArray]:
    off = np.linalg.norm(points.pixels - MIDDLE, axis=1)
    return float(off.min()), np.degrees(points.axes[off.argmin()])


@pytest.mark.parametrize("edges_deg", [(0.0, 90.0), (90.0, 0.0), (20.0, 110.0), (130.0, 60.0), (5.0, 50.0)])
@pytest.mark.parametrize("blur_px", [0.6, 2.0, 5.0])
def test_a_corner_is_found_with_its_edges_and_colours(edges_deg: tuple[float, float], blur_px: float) -> None:
    off_px, axes_deg = nearest(saddle_points(corner(*edges_deg, blur_px=blur_px)))
    assert off_px < 0.5 + 0.2 * blur_px
    turned = (axes_deg - edges_deg + 90.0) % 180.0 - 90.0
    # Blur widens the sharper of the two angles between the edges.
    assert np.abs(turned).max() < (15.0 if edges_deg != (5.0, 50.0) else 25.0)


def test_edges_and_ends_of_lines_are_no_corners() -> None:
    picture = np.full((100, 100), 40, np.uint8)
    picture[30:70, 30:70] = 200  # corners of a square
    assert len(saddle_points(picture)) == 0


def test_points_near_others_are_not_added() -> None:
    first = SaddlePoints(np.array([[10.0, 10.0]]), np.zeros((1, 2)), np.ones(1))
    second = SaddlePoints(np.array([[11.0, 10.0], [20.0, 10.0]]), np.zeros((2, 2)), np.ones(2))
    np.testing.assert_array_equal(first.and_others(second, 2.0).pixels, [[10.0, 10.0], [20.0, 10.0]])
    assert len(first.where(np.array([False])).and_others(second, 2.0)) == 2
