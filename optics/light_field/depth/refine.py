"""Sub-pixel refinement of a depth map by all views jointly, and alignment of depth edges with picture edges.

Gauss-Newton steps fit the brightness gradients of the views. Robust weights penalise second differences of the map,
except at depth edges, so that surfaces may bend but not ripple. Both terms give the information from which the
uncertainty follows. Weighted medians move depth edges to picture edges.
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
"""Assumed standard deviation, of 255, of a difference of brightness gradients."""
MISPLACED_PX = 0.1
"""Accuracy of interpolation as a shift: the error it causes in gradients grows with the detail of the texture."""
DETAIL_PX = 3
SMOOTH = 300.0
"""Inverse variance of second differences of a surface, 1/px^2 of the farthest view's motion."""
EDGE_PX = 0.15
"""Second difference, px of the farthest view's motion, above which a depth edge is likely."""
ANCHOR = 1.0
"""Inverse variance, 1/px^2, that anchors a value at its previous one."""
MIN_AGREEING = np.float32(1e-6)
SHARED_POWER = 0.8
"""Views share the errors of the reference view's gradients, so the information of many is less than its sum."""
MAX_CHANGE_PX, MAX_CHANGE_AT_EDGE_PX = 1.0, 0.15
"""Largest total change of a value, px of the farthest view's motion: off depth edges, and at them."""
JUMP_PX = 0.6
"""Range within 3x3 pixels, px of the farthest view's motion, that marks a depth edge."""
RADIUS_PX = 3
JUMP_RADIUS_PX = 2
COLOUR_GREY = 20.0
"""Sum of differences of three colours, of 255 each, that lowers a neighbour's weight by a factor of e."""


@dataclass(frozen=True, eq=False)
class Match:
    """Statistics (v, u) of how well the views match the reference view at a depth map.

    Attributes
    ----------
    information
        Inverse variance of a pixel's disparity from its own gradients, 1/px^2 of the farthest view's motion.
    agreeing, seeing
        Sum of weights of the other views that match the pixel, and number of those that see it.
    residual
        Weighted mean square of the two gradient differences, over their variances: 2 if these are true.
    products, energies
        Sums over the views of the products of both views' gradients, and of their mean squares, grey^2 per px^2. They
        are equal where the views match; for unrelated views, the products sum to about zero.
    """

    information: Float32
    agreeing: Float32
    seeing: Float32
    residual: Float32
    products: Float32
    energies: Float32

    def after(self, gradient: Float32, step: Float32) -> Match:
        """Return the match after a small step (v, u), px of the farthest view's motion, given its gradient."""
        change = (np.float32(2.0) * gradient + self.information * step) * step / np.maximum(self.agreeing, MIN_AGREEING)
        return replace(self, residual=np.maximum(self.residual + change, np.float32(0.0)))


def _conjugate_gradients(
    anchors: Float32, across: Float32, down: Float32, target: Float32, start: Float32, iterations: int
) -> Float32:
    """Solve A x = target for a map x (v, u), from `start`, by conjugate gradients with a Jacobi preconditioner.

    A is the diagonal `anchors` plus the weighted second differences across and down.
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


def brightness_gradients(picture: Float32) -> Float32:
    """Gradients of brightness (2, v, u) of a grey picture (v, u), across and down, per px (Scharr's kernel)."""
    return np.stack([cv2.Scharr(picture, cv2.CV_32F, *order, scale=1.0 / 32.0) for order in ((1, 0), (0, 1))])


def unshared(views: int) -> float:
    """Share of the summed information that counts: 1 up to eight views, less for more."""
    return float((8.0 / max(views, 8)) ** SHARED_POWER)


def jumps(disparity: Float32) -> NDArray[np.bool_]:
    """Mask (v, u) of pixels at a depth edge, whose gradients may mix two surfaces."""
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.dilate(disparity, kernel)) - np.asarray(cv2.erode(disparity, kernel)) > np.float32(JUMP_PX)


@dataclass(frozen=True, eq=False)
class GradientPicture:
    """Brightness gradients of a picture, grey per px, and its valid pixels.

    Attributes
    ----------
    gradients
        Gradients (v, u, 2), across and down.
    seen
        (v, u), uint8: 0 near a missing sample.
    """

    gradients: Float32
    seen: NDArray[np.uint8]

    @classmethod
    def of(cls, grey: Float32, seen: NDArray[np.uint8]) -> GradientPicture:
        return cls(np.ascontiguousarray(np.moveaxis(brightness_gradients(grey), 0, -1)), seen)

    @cached_property
    def derivatives(self) -> Float32:
        """Derivatives (2, 2, v, u) of each gradient component, across and down."""
        return np.stack([brightness_gradients(self.gradients[..., axis]) for axis in range(2)])

    @cached_property
    def variance(self) -> Float32:
        """Variance (v, u) of a gradient difference between views, from noise and interpolation."""
        detail: Any = cv2.blur(np.square(self.derivatives).sum(axis=(0, 1)) * np.float32(0.5), (DETAIL_PX, DETAIL_PX))
        return np.asarray(np.float32(NOISE_GREY**2) + np.float32(MISPLACED_PX**2) * detail)


class Refiner:
    """Refines maps (v, u) of planes of a sweep.

    Parameters
    ----------
    sweep
        The sweep that the planes belong to.
    parallaxes
        Parallax of each other view.
    run
        `map`, or the `map` of a thread pool.
    """

    def __init__(self, sweep: Sweep, parallaxes: Sequence[Parallax], run: Map = map):
        self.sweep, self.run = sweep, run
        self.pinholes = [SweepPinhole.of(view, sweep) for view in parallaxes]

    def match(
        self, planes: Float32, reference: GradientPicture, others: Sequence[GradientPicture]
    ) -> tuple[Match, Float32]:
        """Return the match at a map (v, u), and the gradient of its cost."""
        nearest = nearest_planes(planes, self.sweep, self.run)
        views = [View(each.gradients, each.seen, surface) for each, surface in zip(others, nearest, strict=True)]
        derivatives, variance = reference.derivatives, reference.variance
        hiding = np.float32(HIDING_PX / self.sweep.reach_px)
        terms = Terms(*(np.zeros(planes.shape, np.float32) for _ in Terms._fields))

        def fill(band: tuple[int, int]) -> None:
            for pinhole, view in zip(self.pinholes, views, strict=True):
                add_terms(*band, planes, reference.gradients, derivatives, variance, pinhole, view, hiding, terms)

        list(self.run(fill, bands(planes.shape[0])))
        # Convert to px of the farthest view's motion.
        reach = np.float32(self.sweep.reach_px)
        residual = terms.squares / np.maximum(terms.agreeing, MIN_AGREEING)
        information, agreeing = terms.information / np.square(reach), terms.agreeing
        found = Match(information, agreeing, terms.seeing, residual, terms.products, terms.energies)
        return found, terms.gradient / reach

    def refined(
        self,
        planes: Float32,
        reference: GradientPicture,
        others: Sequence[GradientPicture],
        steps: int,
        iterations: int,
    ) -> tuple[Float32, Match, Float32]:
        """Refine a map (v, u) by `steps` Gauss-Newton steps, each solved by `iterations` of conjugate gradients.

        Returns the map, the match at it, and the weight of its smoothness (v, u), 0 to 1.
        """
        reach = np.float32(self.sweep.reach_px)
        disparity = planes * reach
        initial = disparity.copy()
        at_edge = jumps(disparity)
        max_change = np.where(at_edge, np.float32(MAX_CHANGE_AT_EDGE_PX), np.float32(MAX_CHANGE_PX))
        off_edge = np.float32(1.0) - at_edge
        share = np.float32(unshared(len(others)))
        for _ in range(steps):
            match, gradient = self.match(disparity / reach, reference, others)
            across, down = self._smoothness(disparity)
            weight = off_edge * share / self._noise(match)
            anchors = match.information * weight + np.float32(ANCHOR)
            target = anchors * disparity - gradient * weight
            solved = _conjugate_gradients(anchors, across, down, target, disparity, iterations)
            previous, disparity = disparity, np.clip(solved, initial - max_change, initial + max_change)
        across, down = self._smoothness(disparity)
        smoothness = np.minimum(across, down) * np.float32(1.0 / SMOOTH)
        return disparity / reach, match.after(gradient, disparity - previous), smoothness

    def _noise(self, match: Match) -> np.float32:
        """Median variance of the gradient differences, relative to the assumed variance; at least 1."""
        residuals = match.residual[match.agreeing > 0]
        return np.float32(max(1.0, float(np.median(residuals)) / 2.0)) if residuals.size else np.float32(1.0)

    def _smoothness(self, disparity: Float32) -> tuple[Float32, Float32]:
        """Weights (v, u) of the second differences, across and down."""
        result = []
        for axis in (1, 0):
            second_difference = np.roll(disparity, 1, axis) - 2.0 * disparity + np.roll(disparity, -1, axis)
            weight = np.float32(SMOOTH) / np.square(1.0 + np.square(second_difference * np.float32(1.0 / EDGE_PX)))
            ends = (slice(None), [0, -1]) if axis == 1 else ([0, -1], slice(None))
            weight[ends] = 0.0
            result.append(weight)
        return result[0], result[1]


@compiled
def _medians(first: int, last: int, planes: Float32, picture: Float32, jump: float, out: Float32) -> None:
    height, width = planes.shape
    max_count = (2 * RADIUS_PX + 1) ** 2
    values, weights = np.empty(max_count, np.float32), np.empty(max_count, np.float32)
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
                    colour_difference = np.float32(0.0)
                    for colour in range(3):
                        colour_difference += abs(picture[j, i, colour] - picture[y, x, colour])
                    distance = np.float32((j - y) * (j - y) + (i - x) * (i - x)) / np.float32(RADIUS_PX * RADIUS_PX)
                    weight = np.exp(-colour_difference / np.float32(COLOUR_GREY) - distance)
                    slot = count - 1
                    while slot >= 0 and values[slot] > planes[j, i]:
                        values[slot + 1], weights[slot + 1] = values[slot], weights[slot]
                        slot -= 1
                    values[slot + 1], weights[slot + 1] = planes[j, i], weight
                    total += weight
                    count += 1
            cumulative = np.float32(0.0)
            for number in range(count):
                cumulative += weights[number]
                if cumulative >= np.float32(0.5) * total:
                    out[y, x] = values[number]
                    break


def follow_edges(planes: Float32, picture: Float32, jump: float, run: Map = map) -> Float32:
    """Replace values near jumps by the weighted median of neighbours of similar colour (Ma et al., ICCV 2013).

    `picture` holds colours (v, u, 3), 0 to 255; a jump is a difference of more than `jump` within the neighbourhood.
    """
    out = np.empty_like(planes)
    list(run(lambda band: _medians(*band, planes, picture, np.float32(jump), out), bands(planes.shape[0])))
    return out
