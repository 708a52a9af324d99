"""Noise of a video of light fields by brightness, measured from frame to frame.

Noise is what differs where nothing moves. The first difference of consecutive frames shows it, and what moves; the
second cancels slow motion. In each class of brightness a low quantile of many blocks counts, so that what moves may be
most of the picture. How blocks spread tells how much of the noise is independent: interpolation and JPEG join pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.temporal.blocks import BLOCK_PX, Blocks

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
        """The noise after a frame that says `new`."""
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
def _energies(first: Any, previous: Any, gains: Any, out: Any) -> None:
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
    """The noise (BINS,) that energies (n,) of blocks tell of each class, and their spread.

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
