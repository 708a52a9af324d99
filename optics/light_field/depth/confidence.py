"""Probability that a depth is right, by logistic regression on statistics of the search and of the match.

The log odds are a quadratic form of the statistics, because one bounds what another says: few rivals mean nothing where
the views do not correlate. `python -m benchmarks.light_field_depth confidence --train` fits the coefficients of
`confidence.json`. No training scene is without texture, where the form would extrapolate: there, the information bounds
the probability.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.depth.photometry import ViewPicture, filled, smoothed
from mirrorcam.optics.light_field.depth.refine import (
    NOISE_GREY,
    Match,
    brightness_gradients,
    depth_edges,
    information_fraction,
)

Float32 = NDArray[np.float32]

RIGHT_PX = 0.5
"""A depth is right if its error is below this, in px of disparity at the longest baseline."""
AVERAGE_PX, CORRELATION_PX, FAR_CORRELATION_PX = 7, 15, 41
MEDIAN_STRIDE_PX = 4
RIM_PX = 9
"""Side of the square over which a brightened pixel affects gradients, also of views at half size."""
MIN_WEIGHT = 1.0 / 255.0
BLOCK_PIXELS = 1024
MIN_ENERGY = 1e-3
MIN_RIVALS = 0.02
MIN_NOISE_RATIO = 0.1
MAX_EDGE_PX, MAX_END_PX = 20.0, 8.0
STATISTICS = (
    "correlation of brightness gradients with the other views, over CORRELATION_PX",
    "the same over FAR_CORRELATION_PX",
    "logarithm of the rivals of the last search",
    "logarithm of the rivals of the first search, over all planes",
    "logarithm of the mean residual",
    "logarithm of the mean information",
    "mean weight of the other views that match",
    "disparity to the nearer end of the search, px",
    "logarithm of the distance to a depth edge, px",
    "logarithm to base 2 of the number of other views",
    "1 for a search at half size, else 0",
    "median over the picture of the correlation over FAR_CORRELATION_PX",
    "logarithm of the noise relative to texture",
)


def statistics(
    disparity_px: Float32,
    match: Match,
    rivals: Float32,
    first_rivals: Float32,
    *,
    range_px: float,
    views: int,
    halved: bool,
    noise_ratio: float,
) -> Float32:
    """Return the STATISTICS (k, v, u) of a depth map.

    Parameters
    ----------
    disparity_px
        Depth map (v, u), as disparity at the longest baseline from the farthest plane on; its jumps mark depth edges.
    match
        The match of the views at this map.
    rivals, first_rivals
        Number (v, u) of other candidates of about the same cost in the last search, and in the first, over all planes.
    range_px
        Difference in disparity at the longest baseline between the nearest and the farthest plane.
    views
        Number of views without the reference view.
    halved
        Whether the planes were searched at half size.
    noise_ratio
        Noise of the views, see `ViewComparison.noise_ratio`.
    """
    edge_px: Any = cv2.distanceTransform((~depth_edges(disparity_px)).astype(np.uint8), cv2.DIST_L2, 3)
    weight = np.maximum(match.weight_sum, np.float32(MIN_ENERGY))
    residual = _mean(match.residual * weight) / _mean(weight)
    far_correlation = _correlation(match, FAR_CORRELATION_PX)
    return np.stack(
        [
            _correlation(match, CORRELATION_PX),
            far_correlation,
            np.log(rivals + np.float32(MIN_RIVALS)),
            np.log(first_rivals + np.float32(MIN_RIVALS)),
            np.log(residual + np.float32(MIN_ENERGY)),
            np.log(_mean(match.information) + np.float32(MIN_ENERGY)),
            _mean(match.weight_sum) / np.float32(views),
            np.clip(np.minimum(disparity_px, np.float32(range_px) - disparity_px), 0.0, MAX_END_PX),
            np.log1p(np.minimum(edge_px, np.float32(MAX_EDGE_PX))),
            np.full_like(disparity_px, np.log2(views)),
            np.full_like(disparity_px, halved),
            np.full_like(disparity_px, np.median(far_correlation[::MEDIAN_STRIDE_PX, ::MEDIAN_STRIDE_PX])),
            np.full_like(disparity_px, np.log(noise_ratio + MIN_NOISE_RATIO)),
        ]
    ).astype(np.float32)


def unbrightened(view: ViewPicture, weights: Float32, deviation_px: float) -> NDArray[np.uint8]:
    """Mask (v, u), as uint8, of the `interior` of a view whose texture is the scene's, not that of its brightening.

    Decoding divides samples by their `weights` (v, u). The gradients that this adds are the same in every scene, so
    they are no texture where they exceed the noise. `deviation_px` is that of the smoothing.
    """
    if weights.min() == weights.max():
        return view.interior
    recorded = np.maximum(filled(weights, weights > 0), np.float32(MIN_WEIGHT))
    added = view.brightness * np.hypot(*brightness_gradients(smoothed(np.log(recorded), deviation_px)))
    rim: Any = cv2.dilate((added > np.float32(NOISE_GREY)).astype(np.uint8), np.ones((RIM_PX, RIM_PX), np.uint8))
    return np.asarray(view.interior & (rim == 0))


def attainable_probability(match: Match, interior: NDArray[np.uint8], views: int) -> Float32:
    """Return the largest probability (v, u) that a depth is right to within RIGHT_PX; 0 without texture nearby.

    The error is at best normal, with the Cramer-Rao bound as its variance: the inverse of the information of all pixels
    within FAR_CORRELATION_PX, about as far as smooth surfaces carry depth from texture. Only the `interior` (v, u) of
    the reference view counts, as the border of its samples is no texture. `views` is the number of other views.
    """
    own = match.information * interior * np.float32(information_fraction(views))
    information = np.maximum(cv2.boxFilter(own, -1, (FAR_CORRELATION_PX,) * 2, normalize=False), np.float32(0.0))
    return np.asarray(erf(RIGHT_PX * np.sqrt(information / np.float32(2.0))), np.float32)


def _mean(values: Float32) -> Any:
    return cv2.blur(values, (AVERAGE_PX, AVERAGE_PX))


def _correlation(match: Match, side_px: int) -> Any:
    energies = cv2.blur(match.energies, (side_px, side_px))
    return cv2.blur(match.products, (side_px, side_px)) / np.maximum(energies, np.float32(MIN_ENERGY))


@dataclass(frozen=True, eq=False)
class LogOdds:
    """A quadratic form of statistics, each limited to the range that it had in training.

    Attributes
    ----------
    lowest, highest
        Limits (k,) of the statistics.
    constant, linear, quadratic
        Coefficients (), (k,) and (k, k) of the statistics as fractions of their ranges, -1 to 1.
    """

    lowest: Float32
    highest: Float32
    constant: float
    linear: Float32
    quadratic: Float32

    def scaled(self, statistics: Float32) -> Float32:
        """Return statistics (k, n) as fractions of their ranges, -1 to 1."""
        lowest, width = self.lowest[:, None], self._width[:, None]
        return np.clip((statistics - lowest) * (np.float32(2.0) / width) - np.float32(1.0), -1.0, 1.0)

    def probability(self, statistics: Float32) -> Float32:
        """Return the probability (v, u) that depths with statistics (k, v, u) are right to within RIGHT_PX."""
        out = np.empty(statistics.shape[1:], np.float32)
        coefficients = np.float32(self.constant), self.linear, self.quadratic
        _fill_probability(
            statistics.reshape(len(self.linear), -1), self.lowest, self._width, *coefficients, out.ravel()
        )
        return out

    @property
    def _width(self) -> Float32:
        return np.maximum(self.highest - self.lowest, np.float32(1e-6))


@compiled
def _fill_probability(
    statistics: Float32,
    lowest: Float32,
    width: Float32,
    constant: float,
    linear: Float32,
    quadratic: Float32,
    out: Float32,
) -> None:
    """Fill the probabilities (n,) of statistics (k, n), block by block: the work arrays fit the cache."""
    one, two = np.float32(1.0), np.float32(2.0)
    count, pixels = statistics.shape
    scaled = np.empty((count, BLOCK_PIXELS), np.float32)
    factor = np.empty(BLOCK_PIXELS, np.float32)
    for first in range(0, pixels, BLOCK_PIXELS):
        odds = out[first : first + BLOCK_PIXELS]
        odds[:] = constant
        for i in range(count):
            row, slope = scaled[i, : len(odds)], two / width[i]
            given, low = statistics[i, first : first + len(odds)], lowest[i]
            for x in range(len(odds)):
                row[x] = min(max((given[x] - low) * slope - one, -one), one)
        for i in range(count):
            row, sums = scaled[i, : len(odds)], factor[: len(odds)]
            sums[:] = linear[i]
            for j in range(i + 1):
                other, weight = scaled[j, : len(odds)], quadratic[i, j] * (one if i == j else two)
                for x in range(len(odds)):
                    sums[x] += weight * other[x]
            for x in range(len(odds)):
                odds[x] += sums[x] * row[x]
        for x in range(len(odds)):
            odds[x] = one / (one + np.exp(-odds[x]))


@cache
def log_odds() -> LogOdds:
    """Read the coefficients that training found."""
    stored = json.loads(files(__package__).joinpath("confidence.json").read_text("utf-8"))
    arrays = {name: np.array(stored[name], np.float32) for name in ("lowest", "highest", "linear", "quadratic")}
    return LogOdds(constant=float(stored["constant"]), **arrays)
