"""Noise of a video of light fields by brightness, measured from frame to frame in small blocks of each view.

Noise is the change where nothing moves. The first difference of consecutive frames shows it, and motion; the second
cancels slow motion. In each class of brightness a low quantile of many blocks counts, so that most of the picture may
move. The spread of blocks shows how much of the noise is independent: interpolation and JPEG correlate pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField

Float32 = NDArray[np.float32]
BINS, LEVELS = 16, 256
"""Classes of brightness in which noise is measured, and entries of the tables that it is looked up in."""
FEWEST_BLOCKS = 12
LOW_QUANTILES, NORMAL = (0.1, 0.25), (-1.2816, -0.6745)
"""Quantiles of the blocks of a class, the second of which counts, and those of a normal distribution."""
LEAST_SPREAD, MOST_SPREAD = 0.03, 0.16
"""Ends of the spread of blocks: that of 250 and of 9 independent values."""
STEEP = 2.0
"""Factor by which noise of a class may exceed what the others make one expect."""
LESSER = 0.9
"""By how much the lesser of first and second differences is less than either, in spreads."""
ROUNDING = 1.0 / 12.0 / 255.0**2
"""Variance of rounding to 8 bits, which noise has at least; floating-point samples have LEAST."""
LEAST = 1e-10
LEAST_TRUST = 1e-3
SLOWLY, QUICKLY, LESS = 1.0 / 16.0, 0.5, 0.7
"""Share of a frame in the noise so far, and where it has less than a part of that: more may have been motion."""
BLOCK_PX = 5
STRIDE_PX, SMALL_STRIDE_PX, SMALL_VIEW = 16, 8, 20_000
"""Distance of the blocks, and that in views of fewer pixels."""
DARK = 16.0 / 255.0
"""Brightness below which a block gives no information on the lighting."""
LEAST_GAIN, MOST_GAIN = 0.5, 2.0
MEDIAN_ERROR = 1.86
"""Standard error of a median of one normal value, in median absolute deviations: 1.4826 sqrt(pi / 2)."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Variance of a sample's noise by brightness, in BINS classes from 0 to 1.

    Attributes
    ----------
    colours, brightness
        The sum (BINS,) over the channels, and that of their mean.
    spread
        Of either, the standard deviation of the cube root of the variance of a block, in that of noise.
    trust
        How sure it is, 0 to 1, that motion is no part of them.
    """

    colours: Float32
    brightness: Float32
    spread: tuple[float, float]
    trust: float = 1.0

    def information(self) -> Float32:
        """One over both (2, LEVELS), from brightness 0 to 1."""
        places, centres = np.linspace(0.0, 1.0, LEVELS), (np.arange(BINS) + 0.5) / BINS
        trust = max(self.trust, LEAST_TRUST)
        curves = [np.interp(places, centres, curve) * trust for curve in (self.colours, self.brightness)]
        return (1.0 / np.array(curves)).astype(np.float32)

    def followed(self, new: Noise) -> Noise:
        """The noise after a frame whose noise is `new`."""
        # All of it where only now it is sure that nothing moves.
        up = (new.trust - self.trust) / max(new.trust, LEAST_TRUST)
        slowly = max(up, SLOWLY * new.trust)

        def one(old: Float32, now: Float32) -> Float32:
            rate = np.where(now > LESS * old, np.float32(slowly), np.float32(max(up, QUICKLY)))
            return np.asarray(old + rate * (now - old))

        spread = [old + slowly * (now - old) for old, now in zip(self.spread, new.spread, strict=True)]
        return Noise(
            one(self.colours, new.colours),
            one(self.brightness, new.brightness),
            (spread[0], spread[1]),
            max(self.trust, new.trust),
        )

    @property
    def joined(self) -> float:
        """How many pixels are as good as one where noise joins them, 1 or more."""
        return max(1.0, BLOCK_PX**2 * 4.5 * self.spread[1] ** 2)

    def limits(self, deviations: float) -> tuple[float, float]:
        """What the variance of a block, in that of noise, exceeds as seldom as a normal value that many deviations.

        Of the channels and of brightness. The cube root of chi-squared is about normal: E. B. Wilson and
        M. M. Hilferty, "The distribution of chi-square", PNAS 17, 1931.
        """
        colours, brightness = (_quantile(spread, deviations) for spread in self.spread)
        return colours, brightness


def chi_square(values: int, deviations: float) -> float:
    """Quantile of chi-squared of some values, as seldom exceeded as a normal value that many deviations."""
    return values * _quantile(float(np.sqrt(2.0 / (9.0 * values))), deviations)


@compiled
def _energies(first: Float32, previous: Float32, gains: Float32, out: Float32) -> None:
    """Variances (2, k, m, n) of noise that blocks show: summed over the channels, and of their mean."""
    views, down, across, pixels, channels = first.shape
    for k in range(views):
        for m in range(down):
            for n in range(across):
                one, two = np.float32(0.0), np.float32(0.0)
                one_mean, two_mean = np.float32(0.0), np.float32(0.0)
                for p in range(pixels):
                    total, total_two = np.float32(0.0), np.float32(0.0)
                    for c in range(channels):
                        a = first[k, m, n, p, c]
                        one += a * a
                        total += a
                        if len(previous) > 0:
                            b = a - gains[k, m, c] * previous[k, m, n, p, c]
                            two += b * b
                            total_two += b
                    one_mean += total * total
                    two_mean += total_two * total_two
                # Differences of two samples have twice the variance, second ones (1, -2, 1) six times.
                if len(previous) > 0:
                    one = min(one, two / np.float32(3.0))
                    one_mean = min(one_mean, two_mean / np.float32(3.0))
                half = np.float32(0.5) / np.float32(pixels)
                out[0, k, m, n] = half * one
                out[1, k, m, n] = half * one_mean / np.float32(channels * channels)


def measured_noise(now: Blocks, before: Blocks, gains: Float32, least: float, trust: float) -> Noise:
    """The noise that the blocks of a frame show beside those before, `least` or more, at gains (k, m, c) of lighting.

    `trust` is how sure it is that not everything moves.
    """
    first = now.differences
    assert first is not None
    found = np.empty((2, *first.shape[:3]), np.float32)
    previous = np.empty((0, *first.shape[1:]), np.float32) if before.differences is None else before.differences
    _energies(first, previous, gains, found)
    level = np.clip(now.means.mean(axis=-1) * BINS, 0, BINS - 1).astype(np.int64).ravel()
    channels = first.shape[-1]
    curves, spreads = [], []
    for energies, part in zip(found, (channels, 1.0 / channels), strict=True):
        curve, spread = _by_level(energies.ravel(), level, len(previous) > 0)
        curves.append(np.maximum(curve, np.float32(least * part)))
        spreads.append(spread)
    return Noise(curves[0], curves[1], (spreads[0], spreads[1]), trust)


def _quantile(spread: float, deviations: float) -> float:
    """Quantile of blocks' variance, in that of noise, by the normal distribution's."""
    return float((1.0 - spread**2 + deviations * spread) ** 3)


def _low(values: Any, share: float) -> Any:
    """The value (n,) below which a share of the values lies."""
    number = int(share * len(values))
    return np.partition(values, number)[number]


def _expected(known: NDArray[np.int64], found: FloatArray, count: NDArray[np.int64]) -> FloatArray:
    """What the other classes make one expect of each, in which something may move: the median over the blocks.

    Noise of light grows in proportion to brightness at most, and with a gamma curve falls no faster.
    """
    bright = known + 0.5
    ratio = bright[:, None] / bright
    expected = found * np.maximum(ratio, 1.0 / ratio)
    order = np.argsort(expected, axis=1, kind="stable")
    share = np.cumsum(count[order], axis=1) / count.sum()
    middle = np.argmax(share >= 0.5, axis=1)
    return np.asarray(np.take_along_axis(expected, order, axis=1)[np.arange(len(known)), middle])


def _by_level(energies: Float32, level: NDArray[np.int64], second: bool) -> tuple[Float32, float]:
    """The noise (BINS,) by the energies (n,) of blocks in each class, and their spread.

    Classes of few blocks are between their neighbours. With `second`, energies are the lesser of two.
    """
    count = np.bincount(level, minlength=BINS)
    known = np.flatnonzero(count >= min(FEWEST_BLOCKS, count.max()))
    found = np.array([_low(energies[level == number], LOW_QUANTILES[1]) for number in known])
    curve = np.interp(np.arange(BINS), known, np.minimum(found, STEEP * _expected(known, found, count[known])))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nan_to_num(energies / curve[level], posinf=0.0)
    low, high = np.cbrt([_low(relative, share) for share in LOW_QUANTILES])
    spread = float((high - low) / (NORMAL[1] * low - NORMAL[0] * high)) if high > 0 else LEAST_SPREAD
    spread = min(max(spread, LEAST_SPREAD), MOST_SPREAD)
    chance = _quantile(spread, NORMAL[1]) * (1.0 - (LESSER * spread if second else 0.0))
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
def _means(samples: Float32, means: Float32) -> None:
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
