"""Noise of a video of light fields by brightness class, measured from frame to frame in small blocks of each view.

Noise is the change where nothing moves. First differences of frames contain noise and motion; second differences cancel
slow motion. In each brightness class, a low quantile of many blocks is used, so that most of the picture may move. The
spread of blocks shows how much of the noise is independent: interpolation and JPEG correlate pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField, Samples

Float32 = NDArray[np.float32]
BINS, LEVELS = 16, 256
"""Number of brightness classes for measuring noise, and of entries in the lookup tables."""
MIN_BLOCKS = 12
LOW_QUANTILES, NORMAL = (0.1, 0.25), (-1.2816, -0.6745)
"""Quantiles of the blocks of a class, the second of which gives the noise, and those of the normal distribution."""
MIN_SPREAD, MAX_SPREAD = 0.03, 0.16
"""Limits of the spread of blocks, for 250 and for 9 independent values."""
MAX_RATIO = 2.0
"""Maximum ratio of a class's noise to its expectation from the others."""
SMALLER_BIAS = 0.9
"""Bias of the smaller of first and second differences, as a multiple of the spread."""
ROUNDING = 1.0 / 12.0 / 255.0**2
"""Variance of rounding to 8 bits, the minimum noise; for floating-point samples, the minimum is MIN_VARIANCE."""
MIN_VARIANCE = 1e-10
MIN_TRUST = 1e-3
SLOW_RATE, FAST_RATE, MAX_DROP_RATIO = 1.0 / 16.0, 0.5, 0.7
"""Update rate of the noise, a higher rate if it falls below MAX_DROP_RATIO times the old noise, and that ratio."""
BLOCK_PX = 5
STRIDE_PX, SMALL_STRIDE_PX, SMALL_VIEW_PIXELS = 16, 8, 20_000
"""Spacing of the blocks, and spacing in views of fewer pixels than SMALL_VIEW_PIXELS."""
DARK = 16.0 / 255.0
"""Brightness below which a block carries no information on the lighting."""
MIN_GAIN, MAX_GAIN = 0.5, 2.0
MEDIAN_ERROR = 1.86
"""Standard error of the median of one normal value, in median absolute deviations: 1.4826 sqrt(pi / 2)."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Variance of a sample's noise in BINS classes of brightness from 0 to 1.

    Attributes
    ----------
    colours, brightness
        Variance (BINS,) summed over the channels, and of their mean.
    spread
        For each of them, the standard deviation of the cube root of a block's variance over the noise.
    trust
        Confidence, 0 to 1, that they contain no motion.
    """

    colours: Float32
    brightness: Float32
    spread: tuple[float, float]
    trust: float = 1.0

    def information(self) -> Float32:
        """Return the inverse variances (2, LEVELS) of both, for brightness from 0 to 1."""
        levels, centres = np.linspace(0.0, 1.0, LEVELS), (np.arange(BINS) + 0.5) / BINS
        trust = max(self.trust, MIN_TRUST)
        curves = [np.interp(levels, centres, curve) * trust for curve in (self.colours, self.brightness)]
        return (1.0 / np.array(curves)).astype(np.float32)

    def updated(self, new: Noise) -> Noise:
        """Update the noise with the noise of a new frame."""
        # Take the new value entirely if only this frame certainly has no motion.
        trust_gain = (new.trust - self.trust) / max(new.trust, MIN_TRUST)
        slow_rate = max(trust_gain, SLOW_RATE * new.trust)

        def update(old: Float32, current: Float32) -> Float32:
            rate = np.where(
                current > MAX_DROP_RATIO * old, np.float32(slow_rate), np.float32(max(trust_gain, FAST_RATE))
            )
            return np.asarray(old + rate * (current - old))

        spread = [old + slow_rate * (current - old) for old, current in zip(self.spread, new.spread, strict=True)]
        return Noise(
            update(self.colours, new.colours),
            update(self.brightness, new.brightness),
            (spread[0], spread[1]),
            max(self.trust, new.trust),
        )

    @property
    def pixels_per_independent(self) -> float:
        """Number of correlated pixels that count as one independent pixel, at least 1."""
        return max(1.0, BLOCK_PX**2 * 4.5 * self.spread[1] ** 2)

    def limits(self, deviations: float) -> tuple[float, float]:
        """Return limits for the channels and for brightness of a block's variance over the noise.

        They are exceeded as rarely as a normal value exceeds `deviations`. The cube root of chi-squared is nearly
        normal: E. B. Wilson and M. M. Hilferty, "The distribution of chi-square", PNAS 17, 1931.
        """
        colours, brightness = (_quantile(spread, deviations) for spread in self.spread)
        return colours, brightness


def chi_square(dof: int, deviations: float) -> float:
    """Return the quantile of chi-squared that is exceeded as rarely as a normal value exceeds `deviations`."""
    return dof * _quantile(float(np.sqrt(2.0 / (9.0 * dof))), deviations)


@compiled
def _energies(first: Float32, previous: Float32, gains: Float32, out: Float32) -> None:
    """Fill variances (2, k, m, n) of noise in blocks: summed over the channels, and of their mean."""
    views, block_rows, block_cols, pixels, channels = first.shape
    for k in range(views):
        for m in range(block_rows):
            for n in range(block_cols):
                first_sum, second_sum = np.float32(0.0), np.float32(0.0)
                first_mean, second_mean = np.float32(0.0), np.float32(0.0)
                for p in range(pixels):
                    total, second_total = np.float32(0.0), np.float32(0.0)
                    for c in range(channels):
                        a = first[k, m, n, p, c]
                        first_sum += a * a
                        total += a
                        if len(previous) > 0:
                            b = a - gains[k, m, c] * previous[k, m, n, p, c]
                            second_sum += b * b
                            second_total += b
                    first_mean += total * total
                    second_mean += second_total * second_total
                # First differences have twice the variance of a sample, second differences (1, -2, 1) six times.
                if len(previous) > 0:
                    first_sum = min(first_sum, second_sum / np.float32(3.0))
                    first_mean = min(first_mean, second_mean / np.float32(3.0))
                half = np.float32(0.5) / np.float32(pixels)
                out[0, k, m, n] = half * first_sum
                out[1, k, m, n] = half * first_mean / np.float32(channels * channels)


def measure_noise(current: Blocks, before: Blocks, gains: Float32, min_variance: float, trust: float) -> Noise:
    """Measure the noise of a frame's blocks relative to those before, at least `min_variance`, given gains (k, m, c).

    `trust` is the confidence that not everything moves.
    """
    first = current.differences
    assert first is not None
    block_energies = np.empty((2, *first.shape[:3]), np.float32)
    previous = np.empty((0, *first.shape[1:]), np.float32) if before.differences is None else before.differences
    _energies(first, previous, gains, block_energies)
    level = np.clip(current.means.mean(axis=-1) * BINS, 0, BINS - 1).astype(np.int64).ravel()
    channels = first.shape[-1]
    curves, spreads = [], []
    for energies, part in zip(block_energies, (channels, 1.0 / channels), strict=True):
        curve, spread = _by_level(energies.ravel(), level, len(previous) > 0)
        curves.append(np.maximum(curve, np.float32(min_variance * part)))
        spreads.append(spread)
    return Noise(curves[0], curves[1], (spreads[0], spreads[1]), trust)


def _quantile(spread: float, deviations: float) -> float:
    """Return the quantile of a block's variance over the noise, from that of the normal distribution."""
    return float((1.0 - spread**2 + deviations * spread) ** 3)


def _low_quantile(values: Any, fraction: float) -> Any:
    """Return the value below which a fraction of the values lies."""
    number = int(fraction * len(values))
    return np.partition(values, number)[number]


def _expected(classes: NDArray[np.int64], noise: FloatArray, count: NDArray[np.int64]) -> FloatArray:
    """Return the expected noise of each class from the others: the median over the blocks, since something may move.

    Shot noise grows at most in proportion to brightness, and falls no faster with a gamma curve.
    """
    bright = classes + 0.5
    ratio = bright[:, None] / bright
    expected = noise * np.maximum(ratio, 1.0 / ratio)
    order = np.argsort(expected, axis=1, kind="stable")
    cumulative = np.cumsum(count[order], axis=1) / count.sum()
    median_rank = np.argmax(cumulative >= 0.5, axis=1)
    return np.asarray(np.take_along_axis(expected, order, axis=1)[np.arange(len(classes)), median_rank])


def _by_level(energies: Float32, level: NDArray[np.int64], smaller_of_two: bool) -> tuple[Float32, float]:
    """Return the noise (BINS,) from the energies (n,) of blocks in each class, and their spread.

    Classes with few blocks are interpolated. With `smaller_of_two`, energies are the smaller of two differences'.
    """
    count = np.bincount(level, minlength=BINS)
    classes = np.flatnonzero(count >= min(MIN_BLOCKS, count.max()))
    noise = np.array([_low_quantile(energies[level == number], LOW_QUANTILES[1]) for number in classes])
    curve = np.interp(
        np.arange(BINS), classes, np.minimum(noise, MAX_RATIO * _expected(classes, noise, count[classes]))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nan_to_num(energies / curve[level], posinf=0.0)
    low, high = np.cbrt([_low_quantile(relative, fraction) for fraction in LOW_QUANTILES])
    spread = float((high - low) / (NORMAL[1] * low - NORMAL[0] * high)) if high > 0 else MIN_SPREAD
    spread = min(max(spread, MIN_SPREAD), MAX_SPREAD)
    chance = _quantile(spread, NORMAL[1]) * (1.0 - (SMALLER_BIAS * spread if smaller_of_two else 0.0))
    return (curve / chance).astype(np.float32), spread


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
        Differences (k, m, n, p, c) from the previous frame, scaled to the lighting of this one; None in the first.
    """

    samples: Float32
    means: Float32
    differences: Float32 | None = None

    @classmethod
    def of(cls, light_field: LightField) -> Blocks:
        """Extract the blocks of a light field; views smaller than SMALL_STRIDE_PX have none."""
        samples: Any = light_field.samples
        rows, cols, height, width, channels = samples.shape
        stride = SMALL_STRIDE_PX if height * width < SMALL_VIEW_PIXELS else STRIDE_PX
        block_rows, block_cols = height // stride, width // stride
        pixels = np.empty((rows * cols, block_rows, block_cols, BLOCK_PX**2, channels), np.float32)
        means = np.empty((rows * cols, block_rows, block_cols, channels), np.float32)
        _extract(samples.reshape(rows * cols, height, width, channels), stride, white_level(light_field), pixels, means)
        return cls(pixels, means)

    def with_differences(self, previous: Blocks, gains: Float32) -> Blocks:
        """Add the differences from the previous frame's blocks, scaled by gains (k, m, c)."""
        return replace(self, differences=self.samples - gains[:, :, None, None] * previous.samples)


def white_level(light_field: LightField) -> np.float32:
    """Return the sample value of white: 255 for 8 bits, else 1."""
    return np.float32(255.0 if light_field.samples.dtype == np.uint8 else 1.0)


@compiled
def _extract(samples: Samples, stride: int, white_level: float, pixels: Float32, means: Float32) -> None:
    """Fill the pixels (k, m, n, p, c) of blocks of views (k, v, u, c), one in each square of side `stride`, and means.

    The samples are divided by `white_level`; the means are (k, m, n, c).
    """
    views, block_rows, block_cols, count, channels = pixels.shape
    inner = (stride - BLOCK_PX) // 2
    for k in range(views):
        for m in range(block_rows):
            for n in range(block_cols):
                for c in range(channels):
                    total = np.float32(0.0)
                    for p in range(count):
                        y, x = m * stride + inner + p // BLOCK_PX, n * stride + inner + p % BLOCK_PX
                        pixels[k, m, n, p, c] = np.float32(samples[k, y, x, c]) / white_level
                        total += pixels[k, m, n, p, c]
                    means[k, m, n, c] = total / np.float32(count)


def lighting_gains(current: Float32, previous: Float32) -> Float32:
    """Return gains (k, m, c) from the previous frame's brightness to this one's, from means (k, m, n, c) of blocks.

    Each row of blocks has its own gain: mains flicker differs between the rows of a rolling shutter. The median of a
    row ignores motion; a gain within twice its standard error of 1 is set to 1.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where((current > DARK) & (previous > DARK), current / previous, np.float32(1.0))
    ratio = np.ascontiguousarray(np.moveaxis(ratio, 2, -1))
    gains = _medians(ratio)
    error = MEDIAN_ERROR / np.sqrt(ratio.shape[-1]) * _medians(np.abs(ratio - gains[..., None]))
    gains = np.where(np.abs(gains - 1.0) > 2.0 * error, gains, 1.0)
    # A binomial filter has no negative frequency response: a row's correction does not grow in the next frame.
    padded = np.pad(gains, ((0, 0), (1, 1), (0, 0)), mode="edge")
    smoothed = 0.25 * padded[:, :-2] + 0.5 * padded[:, 1:-1] + 0.25 * padded[:, 2:]
    return np.clip(smoothed, MIN_GAIN, MAX_GAIN).astype(np.float32)


def _medians(values: Float32) -> Float32:
    """Return the medians (...) of values (..., n); the upper one of two middle values."""
    middle = values.shape[-1] // 2
    return np.asarray(np.partition(values, middle, axis=-1)[..., middle])


def row_gains(gains: Float32, height: int) -> Float32:
    """Interpolate gains (k, m, c) of rows of blocks to gains (k, v, c) of all rows of pixels."""
    block_rows = gains.shape[1]
    position = (np.arange(height, dtype=np.float32) + np.float32(0.5)) * np.float32(block_rows / height) - np.float32(
        0.5
    )
    position = np.clip(position, 0, block_rows - 1)
    above = np.minimum(position.astype(np.int64), max(block_rows - 2, 0))
    fraction = (position - above.astype(np.float32))[:, None]
    below = np.minimum(above + 1, block_rows - 1)
    return np.ascontiguousarray(gains[:, above] + fraction * (gains[:, below] - gains[:, above]))
