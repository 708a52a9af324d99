"""Blur out of focus of views whose boards are planes: a Gaussian with the variance of the circle of confusion.

A thin lens that is in focus at a distance shows a point at another one, both along the axis, as a disc of the diameter
f A |1 / focus - 1 / distance|. The discs of a plane grow linearly in the image.
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

BLUR_STEP_PX = 0.25
"""Largest step of sigma, px, between blurred copies that are mixed."""

LEAST_BLUR_PX = 0.02
"""Sigma, px, that is left out."""

ROWS = 32
"""Rows that are mixed at a time."""

LEAST_SAMPLED = 0.7
"""Sigma, subpixels, from which on a sampled Gaussian has the variance of the Gaussian; less is mixed."""


def defocused(sharp: NDArray[np.float32], variance_px2: NDArray[np.float32], subpixels: int) -> NDArray[np.float32]:
    """Blur a view (h, w) by a variance (h, w) of each subpixel, mixed between levels.

    Parameters
    ----------
    sharp
        The view in focus.
    variance_px2
        Variance of the defocus along an axis, px^2.
    subpixels
        Squares along each side of a pixel.
    """
    low, high = (float(np.sqrt(end)) for end in (variance_px2.min(), variance_px2.max()))
    if high < LEAST_BLUR_PX:
        return sharp
    levels = _levels(low * subpixels, high * subpixels, BLUR_STEP_PX * subpixels)
    blurred = [_blurred(sharp, level) for level in levels]
    found = np.empty_like(sharp)
    # A few rows at a time stay in the processor's cache.
    for start in range(0, len(sharp), ROWS):
        rows = slice(start, start + ROWS)
        mixed = blurred[0][rows]
        for (before, level), more in zip(pairwise(levels), blurred[1:], strict=True):
            part = variance_px2[rows] * np.float32(subpixels**2 / (level**2 - before**2))
            part -= np.float32(before**2 / (level**2 - before**2))
            if len(levels) > 2:
                np.clip(part, 0.0, 1.0, out=part)
            part *= more[rows] - mixed
            part += mixed
            mixed = part
        found[rows] = mixed
    return found


def _levels(low: float, high: float, step: float) -> list[float]:
    """Rising sigmas from `low` (or less) to `high` (or more), all 0 or at least `LEAST_SAMPLED`."""
    low = low if low >= LEAST_SAMPLED else 0.0
    even = np.linspace(low, high, max(int(np.ceil((high - low) / step)), 1) + 1).tolist()
    inner = [level for level in even[1:-1] if level >= LEAST_SAMPLED]
    return sorted({low, *inner, max(high, LEAST_SAMPLED)})


def _blurred(picture: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    if sigma == 0.0:
        return picture
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
