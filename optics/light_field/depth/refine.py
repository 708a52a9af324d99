"""Sub-pixel refinement of a depth map by all views jointly, and alignment of depth edges with picture edges.

Gauss-Newton steps fit the brightness gradients of the views. Robust weights penalise second differences of the map,
except at depth edges, so that surfaces may bend but not ripple. Both terms give the information from which the
uncertainty follows. Weighted medians move depth edges to picture edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.processes.threads import MapFunction
from mirrorcam.optics.light_field.depth.cost import bands
from mirrorcam.optics.light_field.depth.enlargement import COLOUR_GREY, doubled
from mirrorcam.optics.light_field.depth.parallax import Parallax
from mirrorcam.optics.light_field.depth.refine_kernels import (
    OCCLUSION_PX,
    SweepPinhole,
    Terms,
    View,
    add_terms,
    conjugate_gradients,
)
from mirrorcam.optics.light_field.depth.sweep import Sweep, nearest_planes

Float32 = NDArray[np.float32]
NOISE_GREY = 0.25
"""Assumed standard deviation of a difference of brightness gradients, in grey levels out of 255 per px."""
INTERPOLATION_PX = 0.1
"""Interpolation error as a shift: the error that it causes in gradients grows with the detail of the texture."""
DETAIL_PX = 3
SMOOTHNESS = 300.0
"""Inverse variance of second differences of a surface, in 1/px^2 of disparity at the longest baseline."""
EDGE_PX = 0.15
"""Second difference, in px of disparity at the longest baseline, above which a depth edge is likely."""
ANCHOR = 0.1
"""Inverse variance, 1/px^2, that ties a value to its previous one."""
MIN_WEIGHT_SUM = np.float32(1e-6)
SHARED_ERROR_EXPONENT = 0.8
"""Views share the errors of the reference view's gradients, so their information is less than the sum over them."""
MAX_CHANGE_PX, MAX_CHANGE_AT_EDGE_PX = 1.0, 0.15
"""Maximum total change of a value, in px of disparity at the longest baseline: off depth edges, and at them."""
GRID_POWER = 3.0
"""Power of a grid's spacing by which SMOOTHNESS falls, as second differences grow."""
BETWEEN_DERIVATIVE = np.array([-0.25, -0.25, 0.25, 0.25], np.float32)
BETWEEN_MEAN = np.array([0.125, 0.375, 0.375, 0.125], np.float32)
"""Kernels of gradients midway between pixels: derivative and mean, the latter across the derivative."""
JUMP_PX = 0.6
"""Range within 3x3 pixels, in px of disparity at the longest baseline, that marks a depth edge."""
RADIUS_PX = 3
JUMP_RADIUS_PX = 2
COLOUR_STEPS = 4
"""Steps of a difference of colours per grey level that are distinguished."""
BISECTIONS = 14
"""Bisections of the range of neighbours for their median."""


@dataclass(frozen=True, eq=False)
class Match:
    """Statistics (v, u) of how well the views match the reference view at a depth map.

    Attributes
    ----------
    information
        Inverse variance of a pixel's disparity from its own gradients, in 1/px^2 of disparity at the longest baseline.
    weight_sum, view_count
        Sum of weights of the other views that match the pixel, and number of those that see it.
    residual
        Weighted mean of the sum of the two squared, normalised gradient differences; its expected value is 2.
    products, energies
        Sums over the views, grey^2 per px^2. A view's product is the dot product of its gradient with the reference
        view's; its energy, the mean of their squares. The sums are equal where the views match; for unrelated views,
        that of the products is about zero.
    """

    information: Float32
    weight_sum: Float32
    view_count: Float32
    residual: Float32
    products: Float32
    energies: Float32

    def after_step(self, gradient: Float32, step: Float32) -> Match:
        """Return the match after a small step (v, u), px of disparity at the longest baseline, given the gradient."""
        change = (
            (np.float32(2.0) * gradient + self.information * step) * step / np.maximum(self.weight_sum, MIN_WEIGHT_SUM)
        )
        return replace(self, residual=np.maximum(self.residual + change, np.float32(0.0)))

    def enlarged(self, shape: tuple[int, int]) -> Match:
        """Return the match at twice the size; an odd last row or column of the new shape repeats the previous one."""
        return Match(*(doubled(getattr(self, field.name), shape) for field in fields(self)))


def _solved(
    anchors: Float32, weight_u: Float32, weight_v: Float32, target: Float32, start: Float32, iterations: int
) -> Float32:
    """Return the solution (v, u) of `conjugate_gradients` from `start`."""

    def neighbours(weights: Float32, axis: int) -> Float32:
        return np.roll(weights, 1, axis) + np.roll(weights, -1, axis)

    diagonal = anchors + np.float32(4.0) * (weight_u + weight_v) + neighbours(weight_u, 1) + neighbours(weight_v, 0)
    solution = start.copy()
    conjugate_gradients(anchors, weight_u, weight_v, np.float32(1.0) / diagonal, target, solution, iterations)
    return solution


def brightness_gradients(picture: Float32) -> list[Float32]:
    """Return the brightness gradients (v, u) of a grey picture (v, u) along u and v, per px (Scharr's kernel)."""
    return [np.asarray(cv2.Scharr(picture, cv2.CV_32F, *order, scale=1.0 / 32.0)) for order in ((1, 0), (0, 1))]


def information_fraction(views: int) -> float:
    """Return the fraction of the summed information that counts: 1 up to eight views, less for more."""
    return float((8.0 / max(views, 8)) ** SHARED_ERROR_EXPONENT)


def depth_edges(disparity: Float32, jump_px: float = JUMP_PX) -> NDArray[np.bool_]:
    """Mask (v, u) of pixels at a depth edge, whose gradients may mix two surfaces."""
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.dilate(disparity, kernel)) - np.asarray(cv2.erode(disparity, kernel)) > np.float32(jump_px)


@dataclass(frozen=True, eq=False)
class GradientPicture:
    """Brightness gradients of a picture, grey per px, and its valid pixels.

    Attributes
    ----------
    gradients
        Gradients (v, u, 2) along u and v.
    valid
        (v, u), uint8: 0 near a missing sample.
    """

    gradients: Float32
    valid: NDArray[np.uint8]

    @classmethod
    def of(cls, grey: Float32, valid: NDArray[np.uint8], spacing: int = 1) -> GradientPicture:
        """Return the gradients of a grey picture (v, u) for a grid `spacing` pixels apart, 1 or 2.

        For 2, they are those at pixels (u + .5, v + .5), where the points of the grid lie.
        """
        if spacing == 1:
            gradients = brightness_gradients(grey)
        else:
            # The anchor is left and above of the middle.
            kernels, anchor = (BETWEEN_DERIVATIVE, BETWEEN_MEAN), (1, 1)
            gradients = [
                np.asarray(cv2.sepFilter2D(grey, cv2.CV_32F, *pair, anchor=anchor), np.float32)
                for pair in (kernels, kernels[::-1])
            ]
        return cls(np.asarray(cv2.merge(gradients)), valid)

    def on_grid(self, spacing: int) -> _ReferenceGrid:
        """Return the gradients at the points of a grid; their variance comes from noise and interpolation."""
        height, width = (size // spacing for size in self.valid.shape)

        def thinned(values: Float32) -> Float32:
            return np.ascontiguousarray(values[..., ::spacing, ::spacing][..., :height, :width])

        components = [np.ascontiguousarray(self.gradients[..., axis]) for axis in range(2)]
        derivatives = np.stack([[thinned(values) for values in brightness_gradients(axis)] for axis in components])
        detail: Any = cv2.blur(np.square(derivatives).sum(axis=(0, 1)) * np.float32(0.5), (DETAIL_PX, DETAIL_PX))
        variance = np.float32(NOISE_GREY**2) + np.float32(INTERPOLATION_PX**2) * detail
        gradients = np.stack([thinned(values) for values in components], axis=-1)
        return _ReferenceGrid(gradients, derivatives, variance)


@dataclass(frozen=True, eq=False)
class _ReferenceGrid:
    """Gradients (j, i, 2) of the reference view on a grid.

    `derivatives` (2, 2, j, i) are those of each component along u and v; `variance` (j, i) is the variance of a
    difference of gradients between views.
    """

    gradients: Float32
    derivatives: Float32
    variance: Float32


class Refiner:
    """Refines maps (j, i) of fractional plane indices of a sweep, on a grid of pixels.

    Gradients are compared at full size, at one point of each block of `spacing` by `spacing` pixels.

    Parameters
    ----------
    sweep
        The sweep whose planes the maps refer to, at the size of the grid.
    parallaxes
        Parallax of each other view, at full size.
    run
        `map`, or the `map` of a thread pool.
    spacing
        Distance in pixels of the grid's points, 1 or 2.
    """

    def __init__(self, sweep: Sweep, parallaxes: Sequence[Parallax], run: MapFunction = map, spacing: int = 1):
        self.sweep, self.run, self.spacing = sweep, run, spacing
        self.step_px = np.float32(sweep.step_px * spacing)
        # Differences between adjacent points grow with the spacing.
        self.smoothness, self.edge_px = np.float32(SMOOTHNESS / spacing**GRID_POWER), np.float32(EDGE_PX * spacing)
        self.jump_px = JUMP_PX * spacing
        self.max_change_at_edge_px = np.float32(MAX_CHANGE_AT_EDGE_PX * spacing)
        self.pinholes = [SweepPinhole.of(view, sweep, spacing) for view in parallaxes]

    def match(
        self, planes: Float32, reference: GradientPicture, others: Sequence[GradientPicture]
    ) -> tuple[Match, Float32]:
        """Return the match at a map (v, u) of plane indices, and the gradient of its cost."""
        nearest = nearest_planes(planes, self.sweep, self.run)
        views = [View(other.gradients, other.valid, surface) for other, surface in zip(others, nearest, strict=True)]
        own = reference.on_grid(self.spacing)
        occlusion_gap = np.float32(OCCLUSION_PX) / self.step_px
        terms = Terms(*(np.zeros(planes.shape, np.float32) for _ in Terms._fields))

        def fill(band: tuple[int, int]) -> None:
            for pinhole, view in zip(self.pinholes, views, strict=True):
                add_terms(
                    *band, planes, own.gradients, own.derivatives, own.variance, pinhole, view, occlusion_gap, terms
                )

        list(self.run(fill, bands(planes.shape[0])))
        # Convert to px of disparity at the longest baseline.
        step_px = self.step_px
        residual = terms.squares / np.maximum(terms.weight_sum, MIN_WEIGHT_SUM)
        information, weight_sum = terms.information / np.square(step_px), terms.weight_sum
        match = Match(information, weight_sum, terms.view_count, residual, terms.products, terms.energies)
        return match, terms.gradient / step_px

    def refined(
        self,
        planes: Float32,
        reference: GradientPicture,
        others: Sequence[GradientPicture],
        steps: int,
        iterations: int,
        earlier: Float32 | None = None,
    ) -> tuple[Float32, Match, Float32]:
        """Refine a map (j, i) by `steps` Gauss-Newton steps, each solved by `iterations` of conjugate gradients.

        Where an `earlier` refined map is close, the steps start from it. Returns the map, its match, and the weight of
        its smoothness (j, i), 0 to 1.
        """
        step_px = self.step_px
        disparity = planes * step_px
        initial = disparity.copy()
        if earlier is not None:
            earlier_px = earlier * step_px
            disparity = np.where(np.abs(earlier_px - initial) < MAX_CHANGE_PX, earlier_px, initial)
        at_edge = depth_edges(initial, self.jump_px)
        max_change = np.where(at_edge, self.max_change_at_edge_px, np.float32(MAX_CHANGE_PX))
        off_edge = np.float32(1.0) - at_edge
        fraction = np.float32(information_fraction(len(others)))
        for _ in range(steps):
            match, gradient = self.match(disparity / step_px, reference, others)
            weight_u, weight_v = self._smoothness(disparity)
            weight = off_edge * fraction / self._noise(match)
            anchors = match.information * weight + np.float32(ANCHOR)
            target = anchors * disparity - gradient * weight
            solved = _solved(anchors, weight_u, weight_v, target, disparity, iterations)
            previous, disparity = disparity, np.clip(solved, initial - max_change, initial + max_change)
        weight_u, weight_v = self._smoothness(disparity)
        smoothness = np.minimum(weight_u, weight_v) * (np.float32(1.0) / self.smoothness)
        found = match.after_step(gradient, disparity - previous)
        # A point of the grid stands for all pixels of its block.
        found = replace(found, information=found.information * np.float32(self.spacing**2))
        return disparity / step_px, found, smoothness

    def _noise(self, match: Match) -> np.float32:
        """Median variance of the gradient differences, relative to the assumed variance; at least 1."""
        residuals = match.residual[match.weight_sum > 0]
        return np.float32(max(1.0, float(np.median(residuals)) / 2.0)) if residuals.size else np.float32(1.0)

    def _smoothness(self, disparity: Float32) -> tuple[Float32, Float32]:
        """Return weights (v, u) of the second differences along u and v."""
        result = []
        for axis in (1, 0):
            second_difference = np.roll(disparity, 1, axis) - 2.0 * disparity + np.roll(disparity, -1, axis)
            weight = self.smoothness / np.square(1.0 + np.square(second_difference * (np.float32(1.0) / self.edge_px)))
            ends = (slice(None), [0, -1]) if axis == 1 else ([0, -1], slice(None))
            weight[ends] = 0.0
            result.append(weight)
        return result[0], result[1]


def _median_weights() -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return weights of neighbours by the difference of their colours, and (j, i) by their offset."""
    offsets = np.arange(-RADIUS_PX, RADIUS_PX + 1)
    distance = (offsets[:, None] ** 2 + offsets**2) / RADIUS_PX**2
    colour = np.exp(np.arange(3 * 255 * COLOUR_STEPS + 2) / -(COLOUR_STEPS * COLOUR_GREY))
    # Their products, summed over the neighbours, fit in 31 bits.
    return (4096.0 * colour).astype(np.int32), (4096.0 * np.exp(-distance)).astype(np.int32)


COLOUR_WEIGHT, OFFSET_WEIGHT = _median_weights()


@compiled
def _medians(
    first: int,
    last: int,
    planes: Float32,
    picture: Float32,
    at_jump: NDArray[np.bool_],
    colour_weight: NDArray[np.int32],
    offset_weight: NDArray[np.int32],
    out: Float32,
) -> None:
    height, width = planes.shape
    max_count = (2 * RADIUS_PX + 1) ** 2
    values, weights = np.empty(max_count, np.float32), np.empty(max_count, np.int32)
    for y in range(first, last):
        for x in range(width):
            out[y, x] = planes[y, x]
            if not at_jump[y, x]:
                continue
            count, total = 0, 0
            low = high = planes[y, x]
            for j in range(max(y - RADIUS_PX, 0), min(y + RADIUS_PX + 1, height)):
                for i in range(max(x - RADIUS_PX, 0), min(x + RADIUS_PX + 1, width)):
                    difference = np.float32(0.0)
                    for colour in range(3):
                        difference += abs(picture[j, i, colour] - picture[y, x, colour])
                    entry = int(difference * np.float32(COLOUR_STEPS) + np.float32(0.5))
                    weight = colour_weight[entry] * offset_weight[j - y + RADIUS_PX, i - x + RADIUS_PX]
                    values[count], weights[count] = planes[j, i], weight
                    low, high = min(low, planes[j, i]), max(high, planes[j, i])
                    total += weight
                    count += 1
            # Bisection: the median is above `low`, or equal to it at first, and at most `high`.
            low -= np.float32(1.0)
            for _ in range(BISECTIONS):
                middle = np.float32(0.5) * (low + high)
                below = np.int32(0)
                for number in range(count):
                    below += weights[number] if values[number] <= middle else np.int32(0)
                if 2 * below >= total:
                    high = middle
                else:
                    low = middle
            median = np.float32(np.inf)
            for number in range(count):
                if values[number] > low:
                    median = min(median, values[number])
            out[y, x] = median


def align_to_picture_edges(planes: Float32, picture: Float32, jump: float, run: MapFunction = map) -> Float32:
    """Replace values near jumps by the weighted median of neighbours of similar colour (Ma et al., ICCV 2013).

    `picture` holds colours (v, u, 3), 0 to 255; a jump is a difference of more than `jump` within the neighbourhood.
    """
    out = np.empty_like(planes)
    neighbours = np.ones((2 * JUMP_RADIUS_PX + 1,) * 2, np.uint8)
    at_jump = np.asarray(cv2.dilate(planes, neighbours)) - np.asarray(cv2.erode(planes, neighbours)) >= np.float32(jump)
    tables = COLOUR_WEIGHT, OFFSET_WEIGHT
    list(run(lambda band: _medians(*band, planes, picture, at_jump, *tables, out), bands(planes.shape[0])))
    return out
