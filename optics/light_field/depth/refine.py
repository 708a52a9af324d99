"""Refinement of a coarse map of inverse distance: edges to the pixel, surfaces to a small part of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.cost import TRUNCATION, UNSEEN, best_half, sides
from mirrorcam.optics.light_field.depth.geometry import Parallax, other_views, parallax
from mirrorcam.optics.light_field.depth.photometry import GAIN_STRIDE_PX, NO_SAMPLE, brightened, patches
from mirrorcam.optics.light_field.depth.semiglobal import Map
from mirrorcam.optics.light_field.light_field import Views

Float32 = NDArray[np.float32]

TRUNCATION_GREY = 10
"""Difference of brightness, of 255, that counts as `cost.TRUNCATION`."""
EDGE_RADIUS_PX = 1
EDGE_GREY = 4.5
"""Contrast that makes an edge of the picture when costs are gathered."""
PATCH_PX = 5
"""Side of the square over which one step is solved for."""
OUTLIER_GREY = 6.0
NOISE_SLOPE = 236.0 / 1024.0
"""Variance of a Scharr slope, per px, of noise of variance one."""
FAKE = 1.5
"""A slope is significant where its square exceeds the one expected of noise by this factor."""
RIDGE = 0.01
MEDIAN_PX = 5


@dataclass(frozen=True, eq=False)
class MatchStatistics:
    """Statistics of the match at an inverse distance (v, u), from the step towards it.

    Attributes
    ----------
    information
        Sum of squared slopes of brightness by inverse distance over views and patch, (grey mm)^2, less the sum that is
        expected of noise alone.
    variance
        Variance of the differences between views, grey^2.
    agreeing
        Number of other views that show the same there, as a sum of weights from 0 to 1.
    seeing
        Number of other views that have a sample there.
    """

    information: Float32
    variance: Float32
    agreeing: Float32
    seeing: Float32


def guided(values: Float32, guide: Float32, radius_px: int, spread: float, weights: Float32) -> Float32:
    """Weighted guided filter (v, u): locally, values become a linear function of the guide (He, PAMI 35(6), 2013).

    `spread` is the contrast of the guide that is kept as an edge.
    """
    size = (2 * radius_px + 1,) * 2

    def mean(array: Float32) -> Float32:
        return np.asarray(cv2.boxFilter(array, -1, size))

    total = mean(weights) + np.float32(1e-12)
    weighted = weights * guide
    mean_guide, mean_values = mean(weighted) / total, mean(weights * values) / total
    covariance = mean(weighted * values) / total - mean_guide * mean_values
    variance = np.maximum(mean(weighted * guide) / total - np.square(mean_guide), np.float32(0.0))
    slope = covariance / (variance + np.float32(spread * spread))
    offset = mean_values - slope * mean_guide
    return mean(slope) * guide + mean(offset)


class Refiner:
    """Refines maps (v, u) of inverse distance in the reference view of one geometry."""

    def __init__(self, views: Views, run: Map = map):
        self.run = run
        self.parallaxes = [parallax(views, index) for index in other_views(views)]
        self.groups = sides(views)
        self.columns = np.arange(views.width_px, dtype=np.float32)[None]
        self.rows = np.arange(views.height_px, dtype=np.float32)[:, None]

    def matched(self, pictures: Sequence[Float32], reference: Float32, found: Float32) -> list[Float32]:
        """The grey pictures of the other views, as bright as the reference view where they show the same."""
        every = slice(GAIN_STRIDE_PX // 2, None, GAIN_STRIDE_PX)
        columns, rows, known, ours = self.columns[:, every], self.rows[every], found[every, every], patches(reference)

        def one(view: Parallax, picture: Float32) -> Float32:
            return brightened(picture, *view.pixels(columns, rows, known), ours[every, every])

        return list(self.run(one, self.parallaxes, pictures))

    def _look(self, view: Parallax, picture: Float32, found: Float32) -> Float32:
        """Sample a view (v, u) at the places at inverse distances (v, u); negative where it does not see them."""
        across, down = view.pixels(self.columns, self.rows, found)
        shown: Any = cv2.remap(
            picture, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=NO_SAMPLE
        )
        return np.asarray(shown)

    def chosen(self, candidates: Sequence[Float32], pictures: Sequence[Float32], reference: Float32) -> Float32:
        """Choose among inverse distances (v, u), at each pixel, the one on which the best half of the views agrees."""
        numbers = range(len(pictures))

        def cost(job: tuple[int, int]) -> NDArray[np.uint8]:
            candidate, number = job
            shown = self._look(self.parallaxes[number], pictures[number], candidates[candidate])
            difference: Any = cv2.absdiff(shown, reference)
            np.minimum(difference, np.float32(TRUNCATION_GREY), out=difference)
            difference *= np.float32(TRUNCATION / TRUNCATION_GREY)
            difference[shown < 0] = UNSEEN
            return np.asarray(difference.astype(np.uint8))

        costs = list(
            self.run(cost, [(candidate, number) for candidate in range(len(candidates)) for number in numbers])
        )
        even = np.ones_like(reference)

        def gathered(candidate: int) -> Float32:
            best = best_half(costs[candidate * len(numbers) : (candidate + 1) * len(numbers)], self.groups)
            return guided(best.astype(np.float32), reference, EDGE_RADIUS_PX, EDGE_GREY, even)

        totals = list(self.run(gathered, range(len(candidates))))
        best, least = candidates[0], totals[0]
        for candidate, total in zip(candidates[1:], totals[1:], strict=True):
            best, least = np.where(total < least, candidate, best), np.minimum(total, least)
        return np.asarray(cv2.medianBlur(best, MEDIAN_PX))

    def stepped(
        self, found: Float32, pictures: Sequence[Float32], reference: Float32, longest: float
    ) -> tuple[Float32, MatchStatistics]:
        """One Gauss-Newton step of the inverse distances (v, u) towards equal brightness in all views.

        Views that differ over the whole patch, since something hides the place, lose their say (Geman-McClure weights).
        `longest` bounds the step.
        """
        size = (PATCH_PX, PATCH_PX)
        slope_across, slope_down = (
            np.asarray(cv2.Scharr(reference, cv2.CV_32F, *way, scale=1.0 / 32.0)) for way in ((1, 0), (0, 1))
        )

        def one(view: Parallax, picture: Float32) -> tuple[Float32, ...]:
            shown = self._look(view, picture, found)
            seen = (shown >= 0).astype(np.float32)
            residual = (shown - reference) * seen
            move_across, move_down = view.slopes(self.columns, self.rows, found)
            move_across *= slope_across
            move_down *= slope_down
            slope = move_across + move_down
            square = np.square(residual)
            unlike: Any = cv2.boxFilter(square, -1, size)
            unlike *= np.float32(1.0 / OUTLIER_GREY**2)
            unlike += np.float32(1.0)
            trust = seen / np.square(unlike)
            weighted = trust * slope
            motion = np.float32(view.focal_px**2 * (view.position_mm[0] ** 2 + view.position_mm[1] ** 2))
            return weighted * slope, weighted * residual, trust, trust * square, seen, trust * motion

        curvature, gradient, agreeing, squares, seeing, motion = (
            sum(part[1:], part[0]) for part in zip(*self.run(one, self.parallaxes, pictures), strict=True)
        )
        curvature, gradient = cv2.boxFilter(curvature, -1, size), cv2.boxFilter(gradient, -1, size)
        ridge = np.float32(RIDGE * float(np.median(curvature))) + np.finfo(np.float32).tiny
        step = np.clip(gradient / (curvature + ridge), np.float32(-longest), np.float32(longest))
        variance = cv2.boxFilter(squares, -1, size) / np.maximum(cv2.boxFilter(agreeing, -1, size), np.float32(1e-6))
        # A difference has the noise of two pictures.
        fake = cv2.boxFilter(motion, -1, size) * variance * np.float32(FAKE * NOISE_SLOPE / 2.0)
        information = np.maximum(curvature - fake, np.float32(0.0)) * np.float32(PATCH_PX**2)
        return found - step, MatchStatistics(information, variance, agreeing, seeing)


def enlarged(small: Float32, shape: tuple[int, int]) -> Float32:
    """A map of two by two pixels (v, u) at full size; an odd last row or column repeats the one before."""
    full = cv2.resize(small, (2 * small.shape[1], 2 * small.shape[0]), interpolation=cv2.INTER_LINEAR)
    below, right = shape[0] - full.shape[0], shape[1] - full.shape[1]
    return np.asarray(cv2.copyMakeBorder(full, 0, below, 0, right, cv2.BORDER_REPLICATE))
