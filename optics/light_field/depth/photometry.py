"""Making pictures of views comparable: equal local contrast for the search, equal brightness for the refinement.

Mirrors reflect unevenly and a lens darkens its corners, so that the same thing differs by up to a fifth between views.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from optics.light_field.light_field import LightField

Float32 = NDArray[np.float32]
Picture = NDArray[np.uint8]

WINDOW_PX = 7
"""Side of the square over which brightness and contrast are made alike."""
NOISE = 4.0
"""Standard deviation, of 255, below which contrast is not raised further."""
CONTRAST = 50.0
GAIN_LIMITS = (0.4, 2.5)
GAIN_STRIDE_PX = 4
GAIN_PATCH_PX = 5
FEWEST_SAMPLES = 50
HIDDEN = 6.0
"""Difference, of 255, from which on two samples probably do not show the same place."""
_ROOTS = np.rint(255.0 * np.sqrt(np.arange(256) / 255.0)).astype(np.uint8)


def encoded(light_field: LightField, index: tuple[int, int]) -> Picture:
    """A view as (v, u, 4): red, green, blue as square roots, whose noise is even, and 255 where there is a sample."""
    samples = light_field.samples[index]
    if samples.dtype == np.float32:
        roots = np.rint(255.0 * np.sqrt(np.clip(samples, 0.0, 1.0))).astype(np.uint8)
    else:
        roots = cv2.LUT(samples, _ROOTS).reshape(samples.shape)
    colours = roots if roots.shape[-1] == 3 else np.repeat(roots, 3, axis=-1)
    seen = (light_field.weights[index] > 0).astype(np.uint8) * np.uint8(255)
    return np.dstack([colours, seen])


def halved(picture: Picture) -> tuple[Float32, Float32]:
    """Grey (v // 2, u // 2) of an encoded picture and its weights: 1 where all four pixels have a sample, else 0."""
    rows, columns = picture.shape[0] // 2, picture.shape[1] // 2
    small = np.asarray(cv2.resize(picture[: 2 * rows, : 2 * columns], (columns, rows), interpolation=cv2.INTER_AREA))
    grey = np.asarray(cv2.cvtColor(small, cv2.COLOR_RGBA2GRAY))
    return grey.astype(np.float32), (small[..., 3] == 255).astype(np.float32)


def normalised(grey: Float32, weights: Float32) -> Picture:
    """A grey picture (v, u), 0 to 255, with its local mean taken off and its local contrast made alike.

    Local means leave out what has no weight; there the result is mid-grey.
    """
    size = (WINDOW_PX, WINDOW_PX)
    part = np.maximum(cv2.boxFilter(weights, -1, size), np.float32(1e-3))
    centred = grey - cv2.boxFilter(grey * weights, -1, size) / part
    centred *= weights
    variance = np.maximum(cv2.boxFilter(np.square(centred), -1, size) / part, 0.0)
    centred *= np.float32(CONTRAST) / (np.sqrt(variance) + np.float32(NOISE))
    centred += np.float32(128.5)
    return np.clip(centred, 0.0, 255.0).astype(np.uint8)


def brightened(picture: Picture, across: Float32, down: Float32, reference: Picture) -> Picture:
    """An encoded view (v, u, 4) brought to the brightness of the reference view, for each colour by its own gain.

    The gain is a plane over the view, g = a + b u + c v, fitted to what both show of the same places; places that
    differ too much, hidden in one of them, lose their say in three rounds (Geman-McClure weights).

    Args:
        across, down: pixels (m, n) of the view where every GAIN_STRIDE_PX-th pixel of the reference view is seen.
        reference: the encoded reference view.
    """
    size = (GAIN_PATCH_PX, GAIN_PATCH_PX)
    every = slice(GAIN_STRIDE_PX // 2, None, GAIN_STRIDE_PX)
    theirs = np.asarray(cv2.remap(cv2.blur(picture, size), across, down, cv2.INTER_LINEAR))
    ours = np.asarray(cv2.blur(reference, size))[every, every]
    both = (theirs[..., 3] == 255) & (ours[..., 3] == 255)
    if np.count_nonzero(both) < FEWEST_SAMPLES:
        return picture
    height, width = picture.shape[:2]
    basis = np.stack([np.ones_like(across), across / width - 0.5, down / height - 0.5], axis=-1)[both].astype(float)
    columns = np.arange(width, dtype=np.float32) / np.float32(width) - np.float32(0.5)
    rows = np.arange(height, dtype=np.float32)[:, None] / np.float32(height) - np.float32(0.5)
    gains = np.ones((height, width, 4), np.float32)
    for channel in range(3):
        source, target = theirs[..., channel][both].astype(float), ours[..., channel][both].astype(float)
        terms, weight = basis * source[:, None], np.ones(len(source))
        for _ in range(3):
            weighted = terms * weight[:, None]
            # A trifle of a gain of one, so that a black picture has a gain.
            square = weighted.T @ terms + np.eye(3)
            gain = np.linalg.solve(square, weighted.T @ target + [1.0, 0.0, 0.0])
            weight = 1.0 / np.square(1.0 + np.square((terms @ gain - target) / HIDDEN))
        plane = np.float32(gain[0]) + np.float32(gain[1]) * columns + np.float32(gain[2]) * rows
        np.clip(plane, *GAIN_LIMITS, out=gains[..., channel])
    return np.asarray(cv2.multiply(picture, gains, dtype=cv2.CV_8U))
