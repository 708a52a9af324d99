"""Matching cost of planes across all views, with occlusion handled view by view.

Colours and brightness gradients are compared. Before occlusion is known, views at similar distance from the reference
view compete: a near object hides a place from the views in some directions only, so the better half of the directions
decides. Once a first depth is known, the views in which a nearer surface hides the place are left out. Loops run over
runs of adjacent pixels that search the same plane.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.depth.competition import TRUNCATION, UNITS, Work, decide
from mirrorcam.optics.light_field.depth.sweep import (
    DIRECTIONS,
    TILE_PX,
    PlaneMotion,
    Ranges,
    Sweep,
    Volume,
    whole_range,
)

UInt8 = NDArray[np.uint8]
UInt16 = NDArray[np.uint16]

Float32 = NDArray[np.float32]
Map = Callable[..., Any]
CHANNELS = 5
COLOUR, GRADIENT = 1.0, 2.0
"""Weights of the mean difference of three colours, and of the difference of each brightness gradient."""
CONTRAST_PX = 7
CONTRAST_GREY = 4.0
CONTRAST_FLOOR = 0.3
HIDING_PX = 1.5
"""Least difference in motion of the farthest view by which a nearer surface hides another."""
SMOOTHING_PX = 5
WEAK_GRADIENT = 1.5
"""Gradient of brightness, per px, below which costs are averaged over SMOOTHING_PX squared; none above twice it."""
BAND_ROWS = 16
MAX_RUN_PX = 512
"""Largest number of pixels of a row processed at once, a multiple of the tile's side: the work arrays fit the cache."""


def channels(colours: Float32) -> Float32:
    """Return the compared channels (5, v + 1, u + 1) of a picture (v, u, 3) from 0 to 255: colours and two gradients.

    The last row and column are repeated, so that each sample has a next one.
    """
    grey: Any = cv2.cvtColor(colours, cv2.COLOR_RGB2GRAY)
    gradients = [cv2.Sobel(grey, cv2.CV_32F, *order, ksize=1, scale=0.5) for order in ((1, 0), (0, 1))]
    return np.stack(
        [cv2.copyMakeBorder(each, 0, 1, 0, 1, cv2.BORDER_REPLICATE) for each in (*cv2.split(colours), *gradients)]
    )


def mean_slope(reference: Float32, side_px: int) -> Float32:
    """Mean over a square of the sum (v, u) of both absolute brightness gradients of `channels`."""
    across, down = reference[3:, :-1, :-1]
    return np.asarray(cv2.blur(np.abs(across) + np.abs(down), (side_px, side_px)))


def bands(rows: int) -> list[tuple[int, int]]:
    """First and last row, exclusive, of bands of a picture, to be processed in parallel."""
    return [(first, min(first + BAND_ROWS, rows)) for first in range(0, rows, BAND_ROWS)]


def _last_column_repeated(maps: Float32) -> Float32:
    """Repeat the last column of maps (K, v, u)."""
    return np.concatenate([maps, maps[:, :, -1:]], axis=2)


def matching_costs(
    reference: Float32,
    others: Float32,
    seen: NDArray[np.uint8],
    planes: Sweep,
    run: Map = map,
    nearest: Float32 | None = None,
    ranges: Ranges | None = None,
) -> Volume:
    """Compute the costs of a sweep's planes at each pixel of the reference view, in 1 / UNITS of a contrast.

    Parameters
    ----------
    reference
        `channels` of the reference view.
    others
        `channels` of the other views, (K, 5, v + 1, u + 1).
    seen
        (K, v, u), 1 where a view has samples within the pixel and the next ones, else 0.
    planes
        The sweep of these views.
    run
        `map`, or the `map` of a thread pool.
    nearest
        Plane (K, v, u) of the nearest surface in each view by a first depth, from `nearest_planes`.
    ranges
        Planes to search at each pixel; all by default.
    """
    slope = mean_slope(reference, CONTRAST_PX)
    shape = slope.shape
    pictures = ComparedViews(
        reference,
        others,
        np.array([COLOUR / 3.0] * 3 + [GRADIENT] * 2, np.float32),
        np.float32(CONTRAST_GREY) / (np.float32(CONTRAST_FLOOR * CONTRAST_GREY) + slope),
        seen,
        np.empty((0, shape[0], shape[1] + 1), np.float32) if nearest is None else _last_column_repeated(nearest),
        np.float32(HIDING_PX / planes.reach_px),
    )
    volume = Volume.empty(whole_range(shape, planes.planes) if ranges is None else ranges)
    list(run(lambda band: fill_costs(*band, pictures, planes.motion, volume.ranges, volume.costs), bands(shape[0])))
    weak = np.clip(np.float32(2.0) - mean_slope(reference, CONTRAST_PX + 2) / np.float32(WEAK_GRADIENT), 0.0, 1.0)
    if not weak.any():
        return volume
    result = Volume.empty(volume.ranges)
    reach = SMOOTHING_PX // 2
    list(run(lambda band: average_weak(*band, weak, reach, volume.ranges, volume.costs, result.costs), bands(shape[0])))
    return result


class ComparedViews(NamedTuple):
    """Views to compare.

    Attributes
    ----------
    reference, others
        `channels` of the reference view (5, v + 1, u + 1) and of the K others (K, 5, v + 1, u + 1).
    weights
        (5,), one per channel.
    contrast
        Factor (v, u) per pixel of the reference view.
    seen
        (K, v, u), 1 where a view has samples within the pixel and the next ones, else 0.
    nearest
        Plane (K, v, u + 1) of the nearest surface in each view, last column repeated; (0, v, u + 1) if unknown.
    hiding
        Least difference in planes by which a nearer surface hides another.
    """

    reference: Float32
    others: Float32
    weights: Float32
    contrast: Float32
    seen: NDArray[np.uint8]
    nearest: Float32
    hiding: np.float32


# Each loop runs over few arrays, and over slices, whose indices cannot be negative: this lets the compiler vectorise.


@compiled
def _differences(
    reference: Float32,
    y: int,
    other: Float32,
    y0: int,
    share: float,
    growth: float,
    start: float,
    weights: Float32,
    x: int,
    shift: int,
    line: Float32,
    cost: Float32,
) -> None:
    """Weighted absolute differences between pixels of row `y` from `x` on and a view between rows `y0` and `y0` + 1.

    The run's samples in the view are adjacent from column x + `shift` on; their fraction starts at `start` and grows by
    `growth` per pixel.
    """
    cost[:] = 0.0
    row = line[: len(cost) + 1]
    for channel in range(len(weights)):
        upper = other[channel, y0, x + shift : x + shift + len(row)]
        lower = other[channel, y0 + 1, x + shift : x + shift + len(row)]
        reference_row, weight = reference[channel, y, x : x + len(cost)], weights[channel]
        for i in range(len(row)):
            row[i] = upper[i] + share * (lower[i] - upper[i])
        for i in range(len(cost)):
            fraction = growth * np.float32(i) + start
            sampled = row[i] + fraction * (row[i + 1] - row[i])
            cost[i] += weight * abs(sampled - reference_row[i])


@compiled
def _truncate(cost: Float32, contrast: Float32) -> None:
    limit = np.float32(TRUNCATION)
    for x in range(len(cost)):
        cost[x] = min(cost[x] * contrast[x], limit)


@compiled
def _add(cost: Float32, sight: Float32, total: Float32, part: Float32) -> None:
    """Add costs (u,) to `total`, and 1 to `part`, where the view sees: sight (u,) is 0 or 1."""
    for x in range(len(cost)):
        total[x] += sight[x] * cost[x]
    for x in range(len(cost)):
        part[x] += sight[x]


@compiled
def _uncover(sight: Float32, seen: UInt8, surface: Float32, behind: float, growth: float, start: float) -> None:
    """Fill `sight` (u,): 1 where the view has samples and no surface in `surface` (u + 1,) is nearer than `behind`."""
    half = np.float32(0.5)
    for x in range(len(sight)):
        nearest = surface[x] if growth * np.float32(x) + start < half else surface[x + 1]
        sight[x] = np.float32(seen[x]) if nearest <= behind else np.float32(0.0)


@compiled
def _compare_row(
    y: int,
    plane: int,
    view: int,
    first: int,
    last: int,
    pictures: ComparedViews,
    motion: PlaneMotion,
    line: Float32,
    cost: Float32,
    sight: Float32,
    sees: Float32,
) -> None:
    """Fill costs (u,) of a view for a plane at pixels `first` to `last` of row `y`, and masks of samples and sight."""
    height, width = pictures.contrast.shape
    cost[:], sight[:], sees[:] = 0.0, 0.0, 0.0
    scale, across = motion.scale[plane, view], motion.across[plane, view]
    row = scale * np.float32(y) + motion.down[plane, view]
    if row < 0 or row > height - 1:
        return
    # Restrict to places scale x + across from 0 to width - 1.
    tolerance = np.float32(1e-4)
    x = max(first, int(np.ceil(-across / scale - tolerance)))
    end_x = min(last, int(np.floor((np.float32(width - 1) - across) / scale + tolerance)) + 1)
    y0 = int(np.floor(row))
    near_row = int(row + np.float32(0.5))
    share, growth = np.float32(row - np.float32(y0)), scale - np.float32(1.0)
    other = pictures.others[view]
    while x < end_x:
        # A run of pixels whose samples in the view are adjacent as well.
        shift = int(np.floor(growth * np.float32(x) + across + tolerance))
        end = end_x
        if growth > 0:
            end = min(end, int(np.floor((np.float32(shift + 1) - across) / growth)) + 1)
        elif growth < 0:
            end = min(end, int(np.floor((np.float32(shift) - across) / growth)) + 1)
        end = max(end, x + 1)
        start = growth * np.float32(x) + across - np.float32(shift)
        run_cost = cost[x - first : end - first]
        _differences(pictures.reference, y, other, y0, share, growth, start, pictures.weights, x, shift, line, run_cost)
        _truncate(run_cost, pictures.contrast[y, x:end])
        seen, run_sight = pictures.seen[view, y0, x + shift : end + shift], sight[x - first : end - first]
        for i in range(len(run_sight)):
            run_sight[i] = np.float32(seen[i])
        if len(pictures.nearest) > 0:
            surface = pictures.nearest[view, near_row, x + shift : end + shift + 1]
            behind = np.float32(plane) + pictures.hiding
            _uncover(sees[x - first : end - first], seen, surface, behind, growth, start)
        x = end


@compiled
def _block(
    top: int, bottom: int, plane: int, first: int, last: int, pictures: ComparedViews, motion: PlaneMotion, work: Work
) -> None:
    """Compute the costs `decided` of a plane at pixels `first` to `last` of rows `top` to `bottom`, row by row."""
    count, known = last - first, len(pictures.nearest) > 0
    pixels = (bottom - top) * count
    for kind in range(2 if known else 1):
        for sector in range(motion.rings[-1]):
            work.sums[kind, sector, :pixels] = 0.0
            work.weights[kind, sector, :pixels] = 0.0
    cost, sight, sees = work.cost[0, :pixels], work.cost[1, :pixels], work.cost[2, :pixels]
    for view in range(len(pictures.others)):
        for y in range(top, bottom):
            a, b = (y - top) * count, (y - top + 1) * count
            _compare_row(y, plane, view, first, last, pictures, motion, work.line, cost[a:b], sight[a:b], sees[a:b])
        sector = motion.sector[view]
        _add(cost, sight, work.sums[0, sector, :pixels], work.weights[0, sector, :pixels])
        if known:
            _add(cost, sees, work.sums[1, sector, :pixels], work.weights[1, sector, :pixels])
    decide(motion.rings, known, work, pixels)


@compiled
def fill_costs(
    first: int, last: int, pictures: ComparedViews, motion: PlaneMotion, ranges: Ranges, costs: UInt16
) -> None:
    """Fill the costs of rows `first` to `last` of the reference view over their ranges; `first` begins a tile."""
    width, sectors = pictures.contrast.shape[1], motion.rings[-1]
    max_pixels = TILE_PX * MAX_RUN_PX
    work = Work(
        np.zeros((2, sectors, max_pixels), np.float32),
        np.zeros((2, sectors, max_pixels), np.float32),
        np.empty((DIRECTIONS, max_pixels), np.float32),
        np.empty((8, max_pixels), np.float32),
        np.empty((3, max_pixels), np.float32),
        np.empty(MAX_RUN_PX + 1, np.float32),
        np.empty(max_pixels, np.float32),
    )
    for top in range(first, last, TILE_PX):
        bottom = min(top + TILE_PX, last)
        low, count = ranges.low[top], ranges.planes[top]
        for plane in range(low.min(), (low + count).max()):
            begin = 0
            while begin < width:
                if not low[begin] <= plane < low[begin] + count[begin]:
                    begin += TILE_PX
                    continue
                end = begin
                while end < min(begin + MAX_RUN_PX, width) and low[end] <= plane < low[end] + count[end]:
                    end += TILE_PX
                end = min(end, width)
                _block(top, bottom, plane, begin, end, pictures, motion, work)
                i = 0
                for y in range(top, bottom):
                    start = ranges.start[y]
                    for x in range(begin, end):
                        value = work.decided[i] * np.float32(UNITS) + np.float32(0.5)
                        costs[start[x] + plane - low[x]] = np.uint16(value)
                        i += 1
                begin = end


@compiled
def average_weak(first: int, last: int, weak: Float32, reach: int, ranges: Ranges, costs: UInt16, out: UInt16) -> None:
    """Blend the costs of rows `first` to `last` with their mean over a square, by the weakness (v, u) of the texture.

    Where a neighbour lacks a cost, at picture borders or outside its range, the pixel's own cost is used.
    """
    height, width = weak.shape
    squares = np.float32((2 * reach + 1) ** 2)
    sums = np.empty(ranges.planes.max(), np.float32)
    for y in range(first, last):
        for x in range(width):
            low, count, start = ranges.low[y, x], ranges.planes[y, x], ranges.start[y, x]
            own, result = costs[start : start + count], out[start : start + count]
            if not weak[y, x] > 0:
                result[:] = own
                continue
            total = sums[:count]
            total[:] = 0.0
            for dy in range(-reach, reach + 1):
                for dx in range(-reach, reach + 1):
                    j, i = min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)
                    a = max(low, ranges.low[j, i])
                    b = max(a, min(low + count, ranges.low[j, i] + ranges.planes[j, i]))
                    other_costs = costs[
                        ranges.start[j, i] + a - ranges.low[j, i] : ranges.start[j, i] + b - ranges.low[j, i]
                    ]
                    before, shared, after = total[: a - low], total[a - low : b - low], total[b - low :]
                    own_after = own[b - low :]
                    for place in range(len(before)):
                        before[place] += np.float32(own[place])
                    for place in range(len(shared)):
                        shared[place] += np.float32(other_costs[place])
                    for place in range(len(after)):
                        after[place] += np.float32(own_after[place])
            share = weak[y, x]
            for place in range(count):
                value = (np.float32(1.0) - share) * np.float32(own[place]) + share * total[place] / squares
                result[place] = np.uint16(value + np.float32(0.5))
