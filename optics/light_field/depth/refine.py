"""Refinement of a depth map to a small part of a pixel: all views together, over surfaces that may bend but not ripple.

Slopes of brightness in the views are fitted by Gauss-Newton steps; second differences of the map are held small where
no depth edge is (robust weights). Both give the information from which the uncertainty follows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.compiled import compiled
from mirrorcam.optics.light_field.depth.cost import bands
from mirrorcam.optics.light_field.depth.geometry import Parallax
from mirrorcam.optics.light_field.depth.sweep import Sweep
from mirrorcam.optics.light_field.depth.visibility import nearest_planes

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

NOISE_GREY = 0.25
"""Standard deviation, of 255, that a difference of slopes of brightness is taken to have."""
MISPLACED_PX = 0.1
"""Shift to which interpolation is exact: it makes slopes differ the more the finer the texture is."""
OUTLIER = 3.0
"""Multiple of it from which on a view probably shows something else."""
OUTLIER_PX = 3
HIDING_PX = 1.0
"""Motion of the farthest view by which a surface must be nearer to hide another."""
SMOOTH = 300.0
"""Inverse variance of second differences of a surface, 1/px^2 of the farthest view's motion."""
EDGE_PX = 0.15
"""Second difference, px of the farthest view's motion, from which on there is probably a depth edge."""
HELD = 1.0
"""Inverse variance with which a value is held where it was, 1/px^2."""
SOLVER_STEPS = 30
LONGEST_PX, LONGEST_BESIDE_PX = 1.0, 0.15
"""Longest way of a value from where it was, px of the farthest view's motion: elsewhere, and beside a depth edge."""
JUMP_PX = 0.6
"""Difference within 3x3 pixels, px of the farthest view's motion, that is a depth edge."""


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
    """

    information: Float32
    agreeing: Float32
    seeing: Float32
    residual: Float32


@compiled
def _cubic(t: Any, out: Any) -> None:
    """Weights (4,) of Catmull-Rom interpolation at `t` between the middle two samples."""
    half, one = np.float32(0.5), np.float32(1.0)
    out[0] = ((-half * t + one) * t - half) * t
    out[1] = (np.float32(1.5) * t - np.float32(2.5)) * t * t + one
    out[2] = ((np.float32(-1.5) * t + np.float32(2.0)) * t + half) * t
    out[3] = (half * t - half) * t * t


@compiled
def _sampled(
    first: Any,
    last: Any,
    columns: Any,
    rows: Any,
    move_across: Any,
    move_down: Any,
    pictures: Any,
    derivatives: Any,
    seen: Any,
    values: Any,
    slopes: Any,
) -> None:
    """Values (c, v, u) of pictures (c, v, u) at places (v, u), and their change with the plane; NaN where not seen."""
    count, height, width = pictures.shape
    across, down = np.empty(4, np.float32), np.empty(4, np.float32)
    for y in range(first, last):
        for x in range(columns.shape[1]):
            column, row = columns[y, x], rows[y, x]
            if not (column >= 0 and row >= 0 and column <= width - 1 and row <= height - 1):
                values[:, y, x], slopes[:, y, x] = np.nan, 0.0
                continue
            x0, y0 = int(column), int(row)
            if seen[y0, x0] == 0:
                values[:, y, x], slopes[:, y, x] = np.nan, 0.0
                continue
            tx, ty = column - np.float32(x0), row - np.float32(y0)
            _cubic(tx, across)
            _cubic(ty, down)
            x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
            w00, w01 = (np.float32(1.0) - tx) * (np.float32(1.0) - ty), tx * (np.float32(1.0) - ty)
            w10, w11 = (np.float32(1.0) - tx) * ty, tx * ty
            for c in range(count):
                value = np.float32(0.0)
                for j in range(4):
                    line = pictures[c, min(max(y0 - 1 + j, 0), height - 1)]
                    part = np.float32(0.0)
                    for i in range(4):
                        part += across[i] * line[min(max(x0 - 1 + i, 0), width - 1)]
                    value += down[j] * part
                values[c, y, x] = value
                slope = np.float32(0.0)
                for axis in range(2):
                    d = derivatives[c, axis]
                    rise = w00 * d[y0, x0] + w01 * d[y0, x1] + w10 * d[y1, x0] + w11 * d[y1, x1]
                    slope += rise * (move_across[y, x] if axis == 0 else move_down[y, x])
                slopes[c, y, x] = slope


@compiled
def _bends(values: Any, across: Any, down: Any, bend_across: Any, bend_down: Any) -> None:
    """Weighted second differences of a map (v, u); weights are zero in the first and last column or row."""
    height, width = values.shape
    for y in range(height):
        for x in range(width):
            value = np.float32(2.0) * values[y, x]
            bend_across[y, x], bend_down[y, x] = 0.0, 0.0
            if 0 < x < width - 1:
                bend_across[y, x] = across[y, x] * (values[y, x - 1] - value + values[y, x + 1])
            if 0 < y < height - 1:
                bend_down[y, x] = down[y, x] * (values[y - 1, x] - value + values[y + 1, x])


@compiled
def _applied(held: Any, values: Any, bend_across: Any, bend_down: Any, out: Any) -> None:
    """The normal matrix of values held with weights (v, u) and of weighted second differences, applied."""
    height, width = values.shape
    two = np.float32(2.0)
    for y in range(height):
        for x in range(width):
            total = -two * (bend_across[y, x] + bend_down[y, x])
            if x > 0:
                total += bend_across[y, x - 1]
            if x < width - 1:
                total += bend_across[y, x + 1]
            if y > 0:
                total += bend_down[y - 1, x]
            if y < height - 1:
                total += bend_down[y + 1, x]
            out[y, x] = held[y, x] * values[y, x] + total


def _solved(held: Float32, across: Float32, down: Float32, target: Float32, start: Float32) -> Float32:
    """Values (v, u) near `target` / `held` whose second differences are small (conjugate gradients, Jacobi scaling)."""
    work: Any = np.empty_like(start), np.empty_like(start)
    out = np.empty_like(start)

    def matrix(values: Float32) -> Float32:
        _bends(values, across, down, *work)
        _applied(held, values, *work, out)
        return out

    def beside(weights: Float32, axis: int) -> Float32:
        return np.roll(weights, 1, axis) + np.roll(weights, -1, axis)

    four = np.float32(4.0)
    scaling = 1.0 / (held + four * (across + down) + beside(across, 1) + beside(down, 0))
    values = start.copy()
    left = target - matrix(values)
    scaled = scaling * left
    way = scaled.copy()
    size = float(np.vdot(left, scaled))
    for _ in range(SOLVER_STEPS):
        moved = matrix(way)
        length = np.float32(size / max(float(np.vdot(way, moved)), 1e-30))
        values += length * way
        left -= length * moved
        np.multiply(scaling, left, out=scaled)
        before, size = size, float(np.vdot(left, scaled))
        way *= np.float32(size / max(before, 1e-30))
        way += scaled
    return values


def slopes_of(picture: Float32) -> Float32:
    """The two slopes of brightness (2, v, u) of a grey picture (v, u), per px (Scharr's)."""
    return np.stack([cv2.Scharr(picture, cv2.CV_32F, *way, scale=1.0 / 32.0) for way in ((1, 0), (0, 1))])


def jumps(moved: Float32) -> NDArray[np.bool_]:
    """Mask (v, u) of pixels at a depth edge, whose slopes of brightness are of two surfaces."""
    three = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.dilate(moved, three)) - np.asarray(cv2.erode(moved, three)) > np.float32(JUMP_PX)


@dataclass(frozen=True, eq=False)
class SlopePictures:
    """Slopes of brightness of a picture and their own slopes.

    Attributes
    ----------
    slopes
        (2, v, u), grey per px.
    derivatives
        (2, 2, v, u): of each slope, across and down.
    variance
        (v, u), grey^2 per px^2: of the difference of a slope between views, for noise and for interpolation.
    seen
        (v, u), uint8: 0 where there is no sample near.
    """

    slopes: Float32
    derivatives: Float32
    variance: Float32
    seen: NDArray[np.uint8]

    @classmethod
    def of(cls, grey: Float32, seen: NDArray[np.uint8]) -> SlopePictures:
        slopes = slopes_of(grey)
        derivatives = np.stack([slopes_of(slope) for slope in slopes])
        detail: Any = cv2.blur(np.square(derivatives).sum(axis=(0, 1)) * np.float32(0.5), (OUTLIER_PX, OUTLIER_PX))
        return cls(slopes, derivatives, np.float32(NOISE_GREY**2) + np.float32(MISPLACED_PX**2) * detail, seen)


class Refiner:
    """Refines maps (v, u) of planes of a sweep."""

    def __init__(self, sweep: Sweep, parallaxes: Sequence[Parallax], shape: tuple[int, int], run: Map = map):
        self.sweep, self.parallaxes, self.run = sweep, parallaxes, run
        self.columns = np.arange(shape[1], dtype=np.float32)[None]
        self.rows = np.arange(shape[0], dtype=np.float32)[:, None]

    def _one(
        self, planes: Float32, reference: SlopePictures, other: SlopePictures, view: Parallax, nearest: Float32
    ) -> tuple[Float32, ...]:
        """Information, gradient, weight, sight and weighted square residual (v, u) of one view."""
        sweep = self.sweep
        inverse = sweep.inverse_distance(planes)
        columns, rows = view.pixels(self.columns, self.rows, inverse)
        across, down = (way * np.float32(sweep.step) for way in view.slopes(self.columns, self.rows, inverse))
        values = np.empty_like(reference.slopes)
        rises = np.empty_like(values)
        for band in bands(planes.shape[0]):
            _sampled(*band, columns, rows, across, down, other.slopes, other.derivatives, other.seen, values, rises)
        own = reference.derivatives
        residual, rise = values - reference.slopes, rises + own[:, 0] * across + own[:, 1] * down
        rise *= np.float32(0.5)
        sight = np.isfinite(residual[0])
        residual[:, ~sight] = 0.0
        near_column = np.clip(np.rint(np.where(sight, columns, 0)), 0, planes.shape[1] - 1).astype(np.intp)
        near_row = np.clip(np.rint(np.where(sight, rows, 0)), 0, planes.shape[0] - 1).astype(np.intp)
        hidden = nearest[near_row, near_column] > planes + np.float32(HIDING_PX / sweep.reach_px)
        seeing = (sight & ~hidden).astype(np.float32)
        square = np.square(residual).sum(axis=0) / reference.variance
        unlike: Any = cv2.blur(square * seeing, (OUTLIER_PX, OUTLIER_PX))
        weight = seeing / np.square(1.0 + unlike * np.float32(1.0 / OUTLIER**2))
        say = weight / reference.variance
        information = say * np.square(rise).sum(axis=0)
        gradient = say * (rise * residual).sum(axis=0)
        return information, gradient, weight, sight.astype(np.float32), weight * square

    def match(
        self, planes: Float32, reference: SlopePictures, others: Sequence[SlopePictures]
    ) -> tuple[Match, Float32]:
        """The match at a map (v, u), and the gradient that goes with its information."""
        nearest = nearest_planes(planes, self.sweep, self.run)
        jobs = [(planes, reference, *each) for each in zip(others, self.parallaxes, nearest, strict=True)]
        information, gradient, agreeing, seeing, squares = (
            sum(part[1:], part[0]) for part in zip(*self.run(lambda job: self._one(*job), jobs), strict=True)
        )
        # Per px of the farthest view's motion.
        reach = np.float32(self.sweep.reach_px)
        residual = squares / np.maximum(agreeing, np.float32(1e-6))
        return Match(information / np.square(reach), agreeing, seeing, residual), gradient / reach

    def refined(
        self, planes: Float32, reference: SlopePictures, others: Sequence[SlopePictures], steps: int
    ) -> tuple[Float32, Match, Float32]:
        """The map (v, u) after some steps, the match there, and the weight (v, u), 0 to 1, of its being smooth."""
        reach = np.float32(self.sweep.reach_px)
        moved = planes * reach
        first = moved.copy()
        beside = jumps(moved)
        longest = np.where(beside, np.float32(LONGEST_BESIDE_PX), np.float32(LONGEST_PX))
        inside = np.float32(1.0) - beside
        for _ in range(steps):
            match, gradient = self.match(moved / reach, reference, others)
            across, down = self._smoothness(moved)
            say = inside / self._noise(match)
            held = match.information * say + np.float32(HELD)
            solved = _solved(held, across, down, held * moved - gradient * say, moved)
            moved = np.clip(solved, first - longest, first + longest)
        match, _ = self.match(moved / reach, reference, others)
        across, down = self._smoothness(moved)
        return moved / reach, match, np.minimum(across, down) * np.float32(1.0 / SMOOTH)

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
