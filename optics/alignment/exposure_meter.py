"""How well a frame is exposed inside its sub-images, and what to change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.alignment.sub_image_masks import SubImage

CLIPPED, BLACK = 250, 8
"""Grey levels from which on, and below which, a channel tells nothing."""
MOST_CLIPPED, MUCH_CLIPPED = 0.005, 0.05
MOST_BLACK = 0.25
DARK_GREY, BRIGHT_GREY = 40.0, 200.0
"""99 % of the pixels below, or half of them above: too dark, or too bright."""
BINS = 32


@dataclass(frozen=True)
class Exposure:
    """Exposure inside the sub-images.

    Attributes
    ----------
    histogram
        Parts of the pixels in BINS ranges of the brightest channel, from dark to bright.
    clipped, black
        Parts of the pixels that are too bright and too dark to tell anything.
    median, high
        Grey levels that half and 99 % of the pixels are below.
    advice
        What to do, in a few words.
    """

    histogram: tuple[float, ...]
    clipped: float
    black: float
    median: float
    high: float
    advice: str


def measure_exposure(frame: NDArray[np.uint8], sub_images: Sequence[SubImage | None]) -> Exposure:
    """The exposure of a frame (h, w, 3) in RGB, or (h, w), inside its sub-images; every fourth pixel is counted."""
    total = np.zeros(256)
    for each in sub_images:
        if each is None:
            continue
        part: Any = frame[each.window][::2, ::2]
        brightest = np.ascontiguousarray(part.max(axis=2) if part.ndim == 3 else part)
        mask = np.ascontiguousarray(each.mask[::2, ::2])
        total += np.asarray(cv2.calcHist([brightest], [0], mask, [256], [0, 256]), dtype=np.float64).ravel()
    parts = total / max(total.sum(), 1.0)
    below = np.cumsum(parts)
    clipped, black = float(parts[CLIPPED:].sum()), float(parts[:BLACK].sum())
    median, high = float(np.searchsorted(below, 0.5)), float(np.searchsorted(below, 0.99))
    histogram = tuple(float(value) for value in parts.reshape(BINS, -1).sum(axis=1))
    return Exposure(histogram, clipped, black, median, high, _advice(clipped, black, median, high))


def _advice(clipped: float, black: float, median: float, high: float) -> str:
    """What to do."""
    if clipped > MUCH_CLIPPED:
        return f"too bright: {100 * clipped:.0f} % is clipped, halve the exposure"
    if clipped > MOST_CLIPPED:
        return f"a little too bright: {100 * clipped:.1f} % is clipped, expose less"
    if high < DARK_GREY:
        return "too dark: expose longer or add light"
    if black > MOST_BLACK and median < DARK_GREY:
        return f"dark: {100 * black:.0f} % is black, add light"
    if median > BRIGHT_GREY:
        return "bright, nothing is clipped yet: expose a little less"
    return "good"
