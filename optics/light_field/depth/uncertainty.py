"""How sure depth is: standard deviation from the information of the views, and a probability of being right."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.refine import NOISE_GREY, SMOOTH, Match

Float32 = NDArray[np.float32]

AVERAGED_PX = 7
LEAST_LENGTH_PX, MOST_LENGTH_PX = 0.6, 8.0
CORRELATED = 1.0
FLOOR_PX = 0.02


def standard_deviation_px(match: Match, smooth: Float32, range_px: float) -> Float32:
    """Standard deviation (v, u) of the place, px of the farthest view's motion, `range_px` at most.

    A surface of which second differences are held small at inverse variance SMOOTH is an average over about
    (SMOOTH / information)^(1/4) px each way. The noise is that which the residuals show.
    """
    size = (AVERAGED_PX, AVERAGED_PX)
    weight = np.maximum(match.agreeing, np.float32(1e-3))
    total = cv2.blur(weight, size)
    residual = cv2.blur(match.residual * weight, size) / total
    noise = np.maximum(residual / (2.0 * NOISE_GREY**2), np.float32(0.25))
    information = cv2.blur(match.information, size)
    length = np.power(SMOOTH / np.maximum(information, 1e-6), 0.25)
    length = np.clip(length * smooth, LEAST_LENGTH_PX, MOST_LENGTH_PX)
    variance = CORRELATED * noise / np.maximum(information * np.pi * np.square(length), 1e-9)
    return np.minimum(np.sqrt(variance + FLOOR_PX**2), range_px / np.sqrt(12.0)).astype(np.float32)
