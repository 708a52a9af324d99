"""Exposure and sharpness of a live frame in each sub-image, to adjust the camera by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

MARGIN_PX = 24
"""Margin inside an outline that covers the blur of the mirror's edge and errors of its position."""
CLIPPED, BLACK = 250, 8
"""Grey levels at and above which a channel counts as clipped, and below which it counts as black."""
MAX_CLIPPED, BADLY_CLIPPED = 0.005, 0.05
"""Clipped fractions above which a frame is a little too bright, and too bright."""
MAX_BLACK = 0.25
DARK_GREY, BRIGHT_GREY = 40.0, 200.0
"""A frame is too dark if 99 % of its pixels are below the first, too bright if half are above the second."""
BINS = 32
MIN_GREY = 4.0
"""Mean grey level below which a sub-image is too dark for a measurement."""
NOISE = 0.25
"""Quantile of the energy of detail that counts as noise."""


@dataclass(frozen=True, eq=False)
class SubImage:
    """Window (rows, columns) of a frame, and its mask (h, w): 255 for pixels of the sub-image, else 0."""

    window: tuple[slice, slice]
    mask: NDArray[np.uint8]

    @property
    def pixels(self) -> int:
        """Number of pixels of the sub-image."""
        return int(np.count_nonzero(self.mask))


def sub_image_masks(layout: Layout, margin_px: int = MARGIN_PX) -> list[SubImage | None]:
    """The pixels of each mirror's sub-image on the sensor, excluding a margin; None if there are none."""
    camera = layout.camera
    sub_images: list[SubImage | None] = []
    for k in range(len(layout.mirrors)):
        outline = layout.outline_px(k, usable=True)
        outline = outline[np.isfinite(outline).all(axis=1)]
        filled: Any = np.zeros((camera.height_px, camera.width_px), np.uint8)
        cv2.fillConvexPoly(filled, np.rint(np.clip(outline, -1e4, 1e4)).astype(np.int32), [255])
        kernel = np.ones((2 * margin_px + 1,) * 2, np.uint8)
        filled = cv2.erode(filled, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=[255])
        rows, columns = np.flatnonzero(filled.any(axis=1)), np.flatnonzero(filled.any(axis=0))
        if not len(rows):
            sub_images.append(None)
            continue
        window = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
        sub_images.append(SubImage(window, np.ascontiguousarray(filled[window])))
    return sub_images


@dataclass(frozen=True)
class Exposure:
    """Exposure in the sub-images, measured in the brightest channel of each pixel.

    Attributes
    ----------
    histogram
        Fractions of the pixels in BINS ranges, from dark to bright.
    clipped, black
        Fractions of clipped and black pixels.
    median, high
        Median and 99th percentile, grey levels.
    advice
        Advice in a few words.
    """

    histogram: tuple[float, ...]
    clipped: float
    black: float
    median: float
    high: float
    advice: str


def measure_exposure(frame: NDArray[np.uint8], sub_images: Sequence[SubImage | None]) -> Exposure:
    """Measure the exposure of a frame (h, w, 3) in RGB, or (h, w), in its sub-images, from every fourth pixel."""
    total = np.zeros(256)
    for sub_image in sub_images:
        if sub_image is None:
            continue
        part: Any = frame[sub_image.window][::2, ::2]
        brightest = np.ascontiguousarray(part.max(axis=2) if part.ndim == 3 else part)
        mask = np.ascontiguousarray(sub_image.mask[::2, ::2])
        total += np.asarray(cv2.calcHist([brightest], [0], mask, [256], [0, 256]), dtype=np.float64).ravel()
    fractions = total / max(total.sum(), 1.0)
    cumulative = np.cumsum(fractions)
    clipped, black = float(fractions[CLIPPED:].sum()), float(fractions[:BLACK].sum())
    median, high = float(np.searchsorted(cumulative, 0.5)), float(np.searchsorted(cumulative, 0.99))
    histogram = tuple(float(value) for value in fractions.reshape(BINS, -1).sum(axis=1))
    return Exposure(histogram, clipped, black, median, high, _advice(clipped, black, median, high))


def _advice(clipped: float, black: float, median: float, high: float) -> str:
    if clipped > BADLY_CLIPPED:
        return f"too bright: {100 * clipped:.0f} % is clipped, halve the exposure"
    if clipped > MAX_CLIPPED:
        return f"a little too bright: {100 * clipped:.1f} % is clipped, expose less"
    if high < DARK_GREY:
        return "too dark: expose longer or add light"
    if black > MAX_BLACK and median < DARK_GREY:
        return f"dark: {100 * black:.0f} % is black, add light"
    if median > BRIGHT_GREY:
        return "bright, nothing is clipped yet: expose a little less"
    return "good"


def sharpness(grey: NDArray[np.uint8], sub_images: Sequence[SubImage | None]) -> FloatArray:
    """Sharpness (mirrors,) of a picture (h, w): the RMS of the Laplacian divided by the mean grey level.

    It does not depend on exposure. The noise level of the quarter of the area with the least detail is subtracted. NaN
    for a dark or empty sub-image. The value depends on the scene: compare only values of the same scene.
    """
    values = np.full(len(sub_images), np.nan)
    for k, sub_image in enumerate(sub_images):
        if sub_image is None:
            continue
        window: Any = grey[sub_image.window]
        mean = float(cv2.mean(window, mask=sub_image.mask)[0])
        if mean < MIN_GREY:
            continue
        detail: Any = cv2.Laplacian(window, cv2.CV_32F)
        energy: Any = cv2.boxFilter(detail * detail, -1, (16, 16))[::8, ::8][sub_image.mask[::8, ::8] > 0]
        if len(energy):
            values[k] = np.sqrt(max(float(energy.mean() - np.quantile(energy, NOISE)), 0.0)) / mean
    return values


class FocusMeter:
    """Sharpness of each sub-image relative to the best so far, 0 to 1; call `reset` when the scene has changed."""

    def __init__(self, mirrors: int) -> None:
        self.best = np.zeros(mirrors)

    def reset(self) -> None:
        """Forget the best so far."""
        self.best[:] = 0.0

    def measure(self, sharpness: FloatArray) -> FloatArray:
        """The sharpness (mirrors,) relative to the best so far, including this one; NaN if none was measured."""
        self.best = np.fmax(self.best, sharpness)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(self.best > 0.0, sharpness / self.best, np.nan))
