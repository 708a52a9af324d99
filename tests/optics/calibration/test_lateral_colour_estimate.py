"""Lateral colour from pictures of a board whose colours were magnified by known factors."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.lateral_colour_estimate import estimated_lateral_colour
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.sensor_model import magnify

BOARD = Charuco(cols=10, rows=7, square_mm=20.0, marker_mm=15.0)
SIDE_PX = 32
CAMERA = Camera(width_px=400, height_px=280, fx_px=300.0, fy_px=300.0, cx_px=190.0, cy_px=140.0)
MARGIN_PX = 28


def picture(factors: FloatArray, noise_grey: float = 0.5) -> tuple[np.ndarray, Observations]:
    """A sharp board, each colour magnified about the principal point; and its corners."""
    printed = BOARD.image(SIDE_PX).astype(np.float32)
    canvas = np.full((CAMERA.height_px, CAMERA.width_px), 200.0, dtype=np.float32)
    canvas[MARGIN_PX : MARGIN_PX + len(printed), MARGIN_PX : MARGIN_PX + printed.shape[1]] = 30.0 + 0.7 * printed
    blurred = np.asarray(cv2.GaussianBlur(canvas, (0, 0), 1.0), dtype=np.float32)
    colours = np.stack([magnify(blurred, CAMERA, factor) for factor in factors], axis=-1)
    noise = np.random.default_rng(1).normal(0.0, noise_grey, colours.shape)
    corners = BOARD.corners_in_board_mm[:, :2] / BOARD.square_mm * SIDE_PX + MARGIN_PX - 0.5
    ids = np.arange(len(corners))
    return np.clip(np.rint(colours + noise), 0, 255).astype(np.uint8), Observations.of_view(0, 0, ids, corners)


def test_magnifications_of_red_and_blue_are_found() -> None:
    found = estimated_lateral_colour([picture(np.array([1.001, 1.0, 0.9994]))], CAMERA, BOARD)
    assert found is not None
    squared = 0.2  # halfway to the corner, where scale and radial number are not told apart
    for numbers, expected in ((found.red, 1e-3), (found.blue, -6e-4)):
        assert numbers @ [1.0, squared] == pytest.approx(expected, abs=8e-5)
    assert (found.red_sigma < 2e-4).all()


def test_colours_that_coincide_and_grey_pictures_have_none() -> None:
    assert estimated_lateral_colour([picture(np.ones(3))], CAMERA, BOARD) is None
    grey, corners = picture(np.ones(3), noise_grey=0.0)
    assert estimated_lateral_colour([(grey, corners)], CAMERA, BOARD) is None
    assert estimated_lateral_colour([], CAMERA, BOARD) is None
