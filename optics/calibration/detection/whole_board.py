"""A checkerboard that is wholly visible under a distortion so strong that its corners do not link into grids.

OpenCV links squares, which bend less than rows of corners do, as long as all of the board is visible.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import sample
from mirrorcam.optics.calibration.solver.observations import IntArray
from mirrorcam.optics.geometry.targets import Checkerboard

FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK


def whole_board(grey: NDArray[np.uint8], target: Checkerboard) -> tuple[IntArray, FloatArray] | None:
    """Places (n, 2) of all corners of a board in a picture (h, w), as of `corner_grids`, and their pixels (n, 2).

    None where no board of the target's size is wholly visible.
    """
    across, down = target.corners_across
    found, corners = cv2.findChessboardCorners(grey, (across, down), flags=FLAGS)
    if not found:
        return None
    pixels = np.asarray(corners, dtype=np.float64).reshape(down, across, 2)
    along = [np.diff(pixels, axis=axis).reshape(-1, 2).sum(axis=0) for axis in (1, 0)]
    if np.linalg.det(np.array(along)) < 0.0:
        pixels = pixels[:, ::-1]
    y, x = np.indices(pixels.shape[:2])
    # Right of and below a corner whose coordinates have an even sum there is white.
    middles = (pixels[:-1, :-1] + pixels[1:, :-1] + pixels[:-1, 1:] + pixels[1:, 1:]) / 4.0
    bright = sample(np.asarray(grey, dtype=np.float32), middles.reshape(1, -1, 2))[0]
    even = ((x + y) % 2 == 0)[:-1, :-1].ravel()
    if bright[even].mean() < bright[~even].mean():
        x = x + 1
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.int64), pixels.reshape(-1, 2)
