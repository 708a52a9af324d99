"""From a coarse map of inverse distance to a fine one: edges to the pixel, surfaces to a small part of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from optics.light_field.depth.cost import best_half, sides
from optics.light_field.depth.geometry import other_views, parallax
from optics.light_field.depth.photometry import GAIN_STRIDE_PX, Picture, brightened
from optics.light_field.light_field import Views

Float32 = NDArray[np.float32]
Map = Callable[..., object]

REACH_PX = 7
"""Side of the square of coarse pixels whose nearest and farthest depths a fine pixel may take."""
CONTRAST = 3
"""Differences of brightness count that many times towards the truncation of `best_half`."""
TRUNCATION_GREY = 25
EDGE_RADIUS_PX = 3
EDGE_GREY = 4.5
"""Contrast, of 255, that makes an edge of the picture when costs are gathered."""
PATCH_PX = 7
"""Side of the square over which one step is solved for."""
OUTLIER_GREY = 6.0
RIDGE = 0.01
SMOOTH_RADIUS_PX = 5
SMOOTH_STEPS = 0.7
"""Waves of a surface up to that part of a step of the sweep are smoothed, larger ones kept."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the pictures say of an inverse distance (v, u), from the last step towards it.

    Attributes:
        information: sum of squared slopes of brightness by inverse distance over views and patch, (grey mm)^2.
        variance: of the differences between views, grey^2.
        agreeing: how many other views show the same there, as a sum of weights from 0 to 1.
        seeing: how many other views look there.
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
    mean_guide, mean_values = mean(weights * guide) / total, mean(weights * values) / total
    weighted = weights * guide
    covariance = mean(weighted * values) / total - mean_guide * mean_values
    variance = np.maximum(mean(weighted * guide) / total - np.square(mean_guide), 0.0)
    slope = covariance / (variance + np.float32(spread * spread))
    offset = mean_values - slope * mean_guide
    return mean(slope) * guide + mean(offset)


class Refiner:
    """Refines maps of one geometry; per frame, `Refiner.frame` holds its pictures."""

    def __init__(self, views: Views, run: Map = map):
        self.run = run
        self.parallaxes = [parallax(views, index) for index in other_views(views)]
        self.groups = sides(views)
        self.columns = np.arange(views.width_px, dtype=np.float32)[None]
        self.rows = np.arange(views.height_px, dtype=np.float32)[:, None]

    def matched(self, pictures: Sequence[Picture], reference: Picture, inverse_distance: Float32) -> list[Picture]:
        """The encoded pictures of the other views, as bright as the reference view where they show the same."""
        every = slice(GAIN_STRIDE_PX // 2, None, GAIN_STRIDE_PX)
        columns, rows, known = self.columns[:, every], self.rows[every], inverse_distance[every, every]

        def one(number: int) -> Picture:
            across, down = self.parallaxes[number].pixels(columns, rows, known)
            return brightened(pictures[number], across, down, reference)

        return list(self.run(one, range(len(pictures))))  # type: ignore[call-overload]

    def chosen(
        self, candidates: Sequence[Float32], pictures: Sequence[Picture], reference: Picture, grey: Float32
    ) -> Float32:
        """Of several inverse distances (v, u), at each pixel the one on which the best half of the views agrees."""

        def cost(job: tuple[int, int]) -> NDArray[np.uint8]:
            number, candidate = job
            across, down = self.parallaxes[number].pixels(self.columns, self.rows, candidates[candidate])
            seen = np.asarray(cv2.remap(pictures[number], across, down, cv2.INTER_LINEAR))
            difference: Any = cv2.cvtColor(cv2.absdiff(seen, reference), cv2.COLOR_RGBA2GRAY)
            np.minimum(difference, np.uint8(TRUNCATION_GREY), out=difference)
            difference *= np.uint8(CONTRAST)
            np.copyto(difference, np.uint8(TRUNCATION_GREY * CONTRAST // 2), where=seen[..., 3] < 255)
            return np.asarray(difference)

        jobs = [(number, candidate) for candidate in range(len(candidates)) for number in range(len(pictures))]
        costs: list[NDArray[np.uint8]] = list(self.run(cost, jobs))  # type: ignore[call-overload]
        even = np.ones_like(grey)

        def gathered(candidate: int) -> Float32:
            own = costs[candidate * len(pictures) : (candidate + 1) * len(pictures)]
            return guided(best_half(own, self.groups).astype(np.float32), grey, EDGE_RADIUS_PX, EDGE_GREY, even)

        totals: list[Float32] = list(self.run(gathered, range(len(candidates))))  # type: ignore[call-overload]
        best, least = candidates[0], totals[0]
        for candidate, total in zip(candidates[1:], totals[1:], strict=True):
            better = total < least
            best, least = np.where(better, candidate, best), np.minimum(total, least)
        return np.asarray(cv2.medianBlur(best, 5))

    def stepped(
        self,
        inverse_distance: Float32,
        pictures: Sequence[Float32],
        weights: Sequence[Float32],
        grey: Float32,
        longest: float,
    ) -> tuple[Float32, Evidence]:
        """One Gauss-Newton step of the inverse distance (v, u) towards equal brightness in all views.

        Views that differ over the whole patch, since something hides the place, lose their say (Geman-McClure weights).
        `longest` bounds the step.
        """
        size = (PATCH_PX, PATCH_PX)
        slope_across = np.asarray(cv2.Scharr(grey, cv2.CV_32F, 1, 0, scale=1.0 / 32.0))
        slope_down = np.asarray(cv2.Scharr(grey, cv2.CV_32F, 0, 1, scale=1.0 / 32.0))

        def one(number: int) -> tuple[Float32, Float32, Float32, Float32, Float32]:
            view = self.parallaxes[number]
            across, down = view.pixels(self.columns, self.rows, inverse_distance)
            move_across, move_down = view.slopes(self.columns, self.rows, inverse_distance)
            residual = np.asarray(cv2.remap(pictures[number], across, down, cv2.INTER_LINEAR)) - grey
            seen = np.asarray(cv2.remap(weights[number], across, down, cv2.INTER_LINEAR)) > np.float32(1.0 - 1e-3)
            slope = slope_across * move_across + slope_down * move_down
            square = np.square(residual)
            unlike = np.asarray(cv2.boxFilter(square, -1, size)) * np.float32(1.0 / OUTLIER_GREY**2)
            trust = seen / np.square(np.float32(1.0) + unlike)
            weighted = trust * slope
            return weighted * slope, weighted * residual, trust, trust * square, seen.astype(np.float32)

        parts = list(self.run(one, range(len(pictures))))  # type: ignore[call-overload]
        curvature, gradient, agreeing, squares, seeing = (sum(part) for part in zip(*parts, strict=True))
        curvature, gradient = cv2.boxFilter(curvature, -1, size), cv2.boxFilter(gradient, -1, size)
        ridge = np.float32(RIDGE * float(np.median(curvature))) + np.finfo(np.float32).tiny
        step = np.clip(gradient / (curvature + ridge), -longest, longest).astype(np.float32)
        variance = cv2.boxFilter(squares, -1, size) / np.maximum(cv2.boxFilter(agreeing, -1, size), 1e-6)
        evidence = Evidence(curvature * np.float32(PATCH_PX**2), np.asarray(variance), agreeing, seeing)
        return inverse_distance - step, evidence


def enlarged(small: Float32, shape: tuple[int, int]) -> Float32:
    """A map of twice two pixels (v, u) at full size; an odd last row or column repeats the one before."""
    full = cv2.resize(small, (2 * small.shape[1], 2 * small.shape[0]), interpolation=cv2.INTER_LINEAR)
    below, right = shape[0] - full.shape[0], shape[1] - full.shape[1]
    return np.asarray(cv2.copyMakeBorder(full, 0, below, 0, right, cv2.BORDER_REPLICATE))
