"""Conversion between grey levels and light by the sRGB curve (IEC 61966-2-1), with which cameras encode pictures.

Blur adds light, not grey levels: a mean of grey levels would darken bright spots out of focus.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.light_field import Samples

Float32 = NDArray[np.float32]

TOE, TOE_SLOPE, OFFSET, EXPONENT = 0.0031308, 12.92, 0.055, 2.4


def _light(levels: NDArray[Any]) -> NDArray[Any]:
    bright = np.power((np.maximum(levels, 0.0) + OFFSET) / (1.0 + OFFSET), EXPONENT)
    return np.where(levels > TOE * TOE_SLOPE, bright, levels / TOE_SLOPE)


_BYTE_TO_LIGHT = _light(np.arange(256) / 255.0).astype(np.float32)


def light_from_levels(levels: Samples) -> Float32:
    """Convert grey levels (...), bytes or float32 from 0 to 1, to light (...), where white is 1."""
    if levels.dtype == np.uint8:
        flat: Any = np.ascontiguousarray(levels).reshape(-1, 1)
        return np.asarray(cv2.LUT(flat, _BYTE_TO_LIGHT), dtype=np.float32).reshape(levels.shape)
    return _light(levels).astype(np.float32)


def levels_from_light(light: Float32) -> Float32:
    """Convert light (...) to grey levels (...), 0 to 1; values below black and above white continue the curve."""
    flat = np.ascontiguousarray(light, dtype=np.float32).reshape(light.shape[0], -1)
    power: Any = cv2.pow(np.maximum(flat, np.float32(0.0)), 1.0 / EXPONENT)
    bright = power * np.float32(1.0 + OFFSET) - np.float32(OFFSET)
    levels = np.where(flat > np.float32(TOE), bright, flat * np.float32(TOE_SLOPE))
    return np.asarray(levels, dtype=np.float32).reshape(light.shape)


def light_per_level(light: Float32) -> Float32:
    """Return the derivative (...) of light with respect to grey level, where white is 1 in both; at least black's."""
    derivative = EXPONENT / (1.0 + OFFSET) * np.power(np.maximum(light, 0.0), (EXPONENT - 1.0) / EXPONENT)
    return np.where(light > TOE, derivative, 1.0 / TOE_SLOPE).astype(np.float32)
