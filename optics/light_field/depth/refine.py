"""Refinement of a depth map to a fraction of a pixel by all views together, and depth edges moved to the picture's.

Slopes of brightness in the views are fitted by Gauss-Newton steps; second differences of the map are kept small where
there is no depth edge (robust weights), so that surfaces may bend but not ripple. Both give the information from which
the uncertainty follows. Weighted medians move depth edges to the edges of the picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.depth.cost import bands
from mirrorcam.optics.light_field.depth.parallax import Parallax
from mirrorcam.optics.light_field.depth.refine_kernels import (
    HIDING_PX,
    SweepPinhole,
    Terms,
    View,
    add_terms,
    applied,
    bends,
)
from mirrorcam.optics.light_field.depth.sweep import Sweep, nearest_planes

Float32 = NDArray[np.float32]
Map = Callable[..., Any]
NOISE_GREY = 0.25
"""Standard deviation, of 255, that a difference of slopes of brightness is taken to have."""
MISPLACED_PX = 0.1
"""Shift to which interpolation is exact: it makes slopes differ the more the finer the texture is."""
DETAIL_PX = 3
SMOOTH = 300.0
"""Inverse variance of second differences of a surface, 1/px^2 of the farthest view's motion."""
EDGE_PX = 0.15
"""Second difference, px of the farthest view's motion, from which on there is probably a depth edge."""
ANCHOR = 1.0
"""Inverse variance with which a value is drawn to where it was, 1/px^2."""
LEAST_AGREEING = np.float32(1e-6)
SHARED_POWER = 0.8
"""Views share errors, those of the reference view's slopes: of many, the information counts for less than its sum."""
LONGEST_PX, LONGEST_AT_EDGE_PX = 1.0, 0.15
"""Largest change of a value, px of the farthest view's motion: away from depth edges, and at them."""
JUMP_PX = 0.6
"""Difference within 3x3 pixels, px of the farthest view's motion, that is a depth edge."""
RADIUS_PX = 3
JUMP_RADIUS_PX = 2
COLOUR_GREY = 20.0
"""Sum of the differences of three colours, of 255 each, at which a neighbour's weight falls by a factor of e."""


@dataclass(frozen=True, eq=False)
class Match:
    """Statistics (v, u) of the match of the views with the reference view at a depth map.

    Attributes
    ----------
    information
        Inverse variance of the place that the slopes of a pixel itself give, 1/px^2 of the farthest view's motion.
    agreeing, seeing
        Sums of weights of the other views that show the same there, and number of those that see it.
    residual
        Weighted mean square difference of the two slopes, in their variances: 2 where these are true.
    products, energies
        Sums over the views of the products of both views' slopes, and of the means of their squares, grey^2 per px^2:
        alike where views show the same; where what they show has nothing in common, products sum to nothing.
    """

    information: Float32
    agreeing: Float32
    seeing: Float32
    residual: Float32
    products: Float32
    energies: Float32

    def after(self, gradient: Float32, step: Float32) -> Match:
        """The match after a small step (v, u), px of the farthest view's motion, by the gradient that goes with it."""
        fewer = (
            (np.float32(2.0) * gradient + self.information * step) * step / np.maximum(self.agreeing, LEAST_AGREEING)
        )
        return replace(self, residual=np.maximum(self.residual + fewer, np.float32(0.0)))


def _solved(
    anchors: Float32, across: Float32, down: Float32, target: Float32, start: Float32, iterations: int
) -> Float32:
    """Solve A x = target for a map x (v, u), from `start`, by conjugate gradients with a Jacobi preconditioner.

    A is the diagonal `anchors` plus the second differences across and down, with their weights.
    """
    work: Any = np.empty_like(start), np.empty_like(start)
    product = np.empty_like(start)

    def times_a(values: Float32) -> Float32:
        bends(values, across, down, *work)
        applied(anchors, values, *work, product)
        return product

    def neighbours(weights: Float32, axis: int) -> Float32:
        return np.roll(weights, 1, axis) + np.roll(weights, -1, axis)

    four = np.float32(4.0)
    inverse_diagonal = 1.0 / (anchors + four * (across + down) + neighbours(across, 1) + neighbours(down, 0))
    x = start.copy()
    r = target - times_a(x)
    z = inverse_diagonal * r
    p = z.copy()
    rz = float(np.vdot(r, z))
    for _ in range(iterations):
        ap = times_a(p)
        alpha = np.float32(rz / max(float(np.vdot(p, ap)), 1e-30))
        x += alpha * p
        r -= alpha * ap
        np.multiply(inverse_diagonal, r, out=z)
        rz_before, rz = rz, float(np.vdot(r, z))
        p *= np.float32(rz / max(rz_before, 1e-30))
        p += z
    return x


def brightness_slopes(picture: Float32) -> Float32:
    """The two slopes of brightness (2, v, u) of a grey picture (v, u), per px (Scharr's)."""
    return np.stack([cv2.Scharr(picture, cv2.CV_32F, *order, scale=1.0 / 32.0) for order in ((1, 0), (0, 1))])


def unshared(views: int) -> float:
    """The part of the information of a number of views that counts: of more than eight, less than all."""
    return float((8.0 / max(views, 8)) ** SHARED_POWER)


def jumps(moved: Float32) -> NDArray[np.bool_]:
    """Mask (v, u) of pixels at a depth edge, whose slopes of brightness are of two surfaces."""
    three = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.dilate(moved, three)) - np.asarray(cv2.erode(moved, three)) > np.float32(JUMP_PX)


@dataclass(frozen=True, eq=False)
class SlopePicture:
    """Slopes of brightness (v, u, 2) of a picture, grey per px, across and down, and where there are samples.

    Attributes
    ----------
    slopes
        (v, u, 2).
    seen
        (v, u), uint8: 0 where there is no sample near.
    """

    slopes: Float32
    seen: NDArray[np.uint8]

    @classmethod
    def of(cls, grey: Float32, seen: NDArray[np.uint8]) -> SlopePicture:
        return cls(np.ascontiguousarray(np.moveaxis(brightness_slopes(grey), 0, -1)), seen)

    @cached_property
    def derivatives(self) -> Float32:
        """Slopes (2, 2, v, u) of each slope, across and down."""
        return np.stack([brightness_slopes(self.slopes[..., axis]) for axis in range(2)])

    @cached_property
    def variance(self) -> Float32:
        """Variance (v, u) of a difference of slopes between views, for noise and for interpolation."""
        detail: Any = cv2.blur(np.square(self.derivatives).sum(axis=(0, 1)) * np.float32(0.5), (DETAIL_PX, DETAIL_PX))
        return np.asarray(np.float32(NOISE_GREY**2) + np.float32(MISPLACED_PX**2) * detail)


class Refiner:
    """Refines maps (v, u) of planes of a sweep."""

    def __init__(self, sweep: Sweep, parallaxes: Sequence[Parallax], run: Map = map):
        self.sweep, self.run = sweep, run
        self.pinholes = [SweepPinhole.of(view, sweep) for view in parallaxes]

    def match(self, planes: Float32, reference: SlopePicture, others: Sequence[SlopePicture]) -> tuple[Match, Float32]:
        """The match at a map (v, u), and the gradient that goes with its information."""
        nearest = nearest_planes(planes, self.sweep, self.run)
        views = [View(each.slopes, each.seen, surface) for each, surface in zip(others, nearest, strict=True)]
        derivatives, variance = reference.derivatives, reference.variance
        hiding = np.float32(HIDING_PX / self.sweep.reach_px)
        terms = Terms(*(np.zeros(planes.shape, np.float32) for _ in Terms._fields))

        def fill(band: tuple[int, int]) -> None:
            for hole, view in zip(self.pinholes, views, strict=True):
                add_terms(*band, planes, reference.slopes, derivatives, variance, hole, view, hiding, terms)

        list(self.run(fill, bands(planes.shape[0])))
        # Per px of the farthest view's motion.
        reach = np.float32(self.sweep.reach_px)
        residual = terms.squares / np.maximum(terms.agreeing, LEAST_AGREEING)
        information, agreeing = terms.information / np.square(reach), terms.agreeing
        found = Match(information, agreeing, terms.seeing, residual, terms.products, terms.energies)
        return found, terms.gradient / reach

    def refined(
        self, planes: Float32, reference: SlopePicture, others: Sequence[SlopePicture], steps: int, iterations: int
    ) -> tuple[Float32, Match, Float32]:
        """Refine a map (v, u) by Gauss-Newton steps, each solved in a number of iterations of conjugate gradients.

        Returns the map, the match at it, and the weight of its smoothness (v, u), 0 to 1.
        """
        reach = np.float32(self.sweep.reach_px)
        moved = planes * reach
        first = moved.copy()
        at_edge = jumps(moved)
        longest = np.where(at_edge, np.float32(LONGEST_AT_EDGE_PX), np.float32(LONGEST_PX))
        off_edge = np.float32(1.0) - at_edge
        share = np.float32(unshared(len(others)))
        for _ in range(steps):
            match, gradient = self.match(moved / reach, reference, others)
            across, down = self._smoothness(moved)
            weight = off_edge * share / self._noise(match)
            anchors = match.information * weight + np.float32(ANCHOR)
            solved = _solved(anchors, across, down, anchors * moved - gradient * weight, moved, iterations)
            before, moved = moved, np.clip(solved, first - longest, first + longest)
        across, down = self._smoothness(moved)
        return moved / reach, match.after(gradient, moved - before), np.minimum(across, down) * np.float32(1.0 / SMOOTH)

    def _noise(self, match: Match) -> np.float32:
        """Variance of the differences of slopes in most of the picture, in those assumed; one at least."""
        usual = match.residual[match.agreeing > 0]
        return np.float32(max(1.0, float(np.median(usual)) / 2.0)) if usual.size else np.float32(1.0)

    def _smoothness(self, moved: Float32) -> tuple[Float32, Float32]:
        """Weights (v, u) of the second differences across and down."""
        result = []
        for axis in (1, 0):
            bend = np.roll(moved, 1, axis) - 2.0 * moved + np.roll(moved, -1, axis)
            weight = np.float32(SMOOTH) / np.square(1.0 + np.square(bend * np.float32(1.0 / EDGE_PX)))
            ends = (slice(None), [0, -1]) if axis == 1 else ([0, -1], slice(None))
            weight[ends] = 0.0
            result.append(weight)
        return result[0], result[1]


@compiled
def _medians(first: int, last: int, planes: Float32, picture: Float32, jump: float, out: Float32) -> None:
    height, width = planes.shape
    most = (2 * RADIUS_PX + 1) ** 2
    values, weights = np.empty(most, np.float32), np.empty(most, np.float32)
    for y in range(first, last):
        for x in range(width):
            low = high = out[y, x] = planes[y, x]
            for j in range(max(y - JUMP_RADIUS_PX, 0), min(y + JUMP_RADIUS_PX + 1, height)):
                for i in range(max(x - JUMP_RADIUS_PX, 0), min(x + JUMP_RADIUS_PX + 1, width)):
                    low, high = min(low, planes[j, i]), max(high, planes[j, i])
            if high - low < jump:
                continue
            count, total = 0, np.float32(0.0)
            for j in range(max(y - RADIUS_PX, 0), min(y + RADIUS_PX + 1, height)):
                for i in range(max(x - RADIUS_PX, 0), min(x + RADIUS_PX + 1, width)):
                    apart = np.float32(0.0)
                    for colour in range(3):
                        apart += abs(picture[j, i, colour] - picture[y, x, colour])
                    away = np.float32((j - y) * (j - y) + (i - x) * (i - x)) / np.float32(RADIUS_PX * RADIUS_PX)
                    weight = np.exp(-apart / np.float32(COLOUR_GREY) - away)
                    place = count - 1
                    while place >= 0 and values[place] > planes[j, i]:
                        values[place + 1], weights[place + 1] = values[place], weights[place]
                        place -= 1
                    values[place + 1], weights[place + 1] = planes[j, i], weight
                    total += weight
                    count += 1
            passed = np.float32(0.0)
            for number in range(count):
                passed += weights[number]
                if passed >= np.float32(0.5) * total:
                    out[y, x] = values[number]
                    break


def follow_edges(planes: Float32, picture: Float32, jump: float, run: Map = map) -> Float32:
    """A map (v, u) whose values beside jumps are those of neighbours of like colour (Ma et al., ICCV 2013).

    `picture` has colours (v, u, 3), 0 to 255; a jump is a difference of more than `jump` nearby.
    """
    out = np.empty_like(planes)
    list(run(lambda band: _medians(*band, planes, picture, np.float32(jump), out), bands(planes.shape[0])))
    return out
