"""Small blocks of each view of a light field, in which noise and lighting are measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.light_field import LightField

Float32 = NDArray[np.float32]

BLOCK_PX = 5
STRIDE_PX, SMALL_STRIDE_PX, SMALL_VIEW = 16, 8, 20_000
"""Distance of the blocks, and that in views of fewer pixels."""
DARK = 16.0 / 255.0
"""Brightness below which a block says nothing of the lighting."""
LEAST_GAIN, MOST_GAIN = 0.5, 2.0
MEDIAN_ERROR = 1.86
"""Standard error of a median of one normal value, in median absolute deviations: 1.4826 sqrt(pi / 2)."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of all k views of a frame, in a grid (m, n) with p pixels each.

    Attributes
    ----------
    samples
        (k, m, n, p, c), 0 to 1.
    means
        Their means (k, m, n, c).
    differences
        What they differ by (k, m, n, p, c) from the frame before, in the light of now; None in the first.
    """

    samples: Float32
    means: Float32
    differences: Float32 | None = None

    @classmethod
    def of(cls, light_field: LightField) -> Blocks:
        """The blocks of a light field; a view smaller than SMALL_STRIDE_PX has none."""
        samples: Any = light_field.samples
        rows, cols, height, width, channels = samples.shape
        stride = SMALL_STRIDE_PX if height * width < SMALL_VIEW else STRIDE_PX
        down, across = height // stride, width // stride
        cut = samples[:, :, : down * stride, : across * stride]
        first = (stride - BLOCK_PX) // 2
        inner = slice(first, first + BLOCK_PX)
        parts = cut.reshape(rows * cols, down, stride, across, stride, channels)[:, :, inner, :, inner]
        parts = parts.transpose(0, 1, 3, 2, 4, 5).astype(np.float32) / full_brightness(light_field)
        found = parts.reshape(rows * cols, down, across, BLOCK_PX**2, channels)
        means = np.empty((rows * cols, down, across, channels), np.float32)
        _means(found, means)
        return cls(found, means)

    def after(self, before: Blocks, gains: Float32) -> Blocks:
        """The blocks with what they differ by from those of the frame before, at gains (k, m, c)."""
        return replace(self, differences=self.samples - gains[:, :, None, None] * before.samples)


def full_brightness(light_field: LightField) -> np.float32:
    """Sample of full brightness: 255 of 8 bits, and 1."""
    return np.float32(255.0 if light_field.samples.dtype == np.uint8 else 1.0)


@compiled
def _means(samples: Any, means: Any) -> None:
    views, down, across, pixels, channels = samples.shape
    for k in range(views):
        for m in range(down):
            for n in range(across):
                means[k, m, n] = 0.0
                for p in range(pixels):
                    for c in range(channels):
                        means[k, m, n, c] += samples[k, m, n, p, c]
                for c in range(channels):
                    means[k, m, n, c] /= np.float32(pixels)


def lighting(now: Float32, before: Float32) -> Float32:
    """Gains (k, m, c) that bring what was before to the brightness of now, of means (k, m, n, c) of blocks.

    Each row of blocks has its own: mains flicker differs between the rows of a rolling shutter. The median of a row
    leaves out what moves; a gain within twice its standard error of one is one.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where((now > DARK) & (before > DARK), now / before, np.float32(1.0))
    ratio = np.ascontiguousarray(np.moveaxis(ratio, 2, -1))
    gains = _medians(ratio)
    error = MEDIAN_ERROR / np.sqrt(ratio.shape[-1]) * _medians(np.abs(ratio - gains[..., None]))
    gains = np.where(np.abs(gains - 1.0) > 2.0 * error, gains, 1.0)
    # No frequency of a binomial filter is negative: what is corrected in a row does not grow in the next frame.
    wider = np.pad(gains, ((0, 0), (1, 1), (0, 0)), mode="edge")
    smooth = 0.25 * wider[:, :-2] + 0.5 * wider[:, 1:-1] + 0.25 * wider[:, 2:]
    return np.clip(smooth, LEAST_GAIN, MOST_GAIN).astype(np.float32)


def _medians(values: Float32) -> Float32:
    """Medians (...) of values (..., n), the upper of the middle two."""
    middle = values.shape[-1] // 2
    return np.asarray(np.partition(values, middle, axis=-1)[..., middle])


def row_gains(gains: Float32, height: int) -> Float32:
    """Gains (k, v, c) of all rows of pixels, of those (k, m, c) of rows of blocks."""
    down = gains.shape[1]
    place = (np.arange(height, dtype=np.float32) + np.float32(0.5)) * np.float32(down / height) - np.float32(0.5)
    place = np.clip(place, 0, down - 1)
    above = np.minimum(place.astype(np.int64), max(down - 2, 0))
    part = (place - above.astype(np.float32))[:, None]
    below = np.minimum(above + 1, down - 1)
    return np.ascontiguousarray(gains[:, above] + part * (gains[:, below] - gains[:, above]))
