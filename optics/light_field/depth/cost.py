"""Matching cost of planes across all views, with occlusion handled view by view.

Brightness, chroma and the gradients of brightness are compared. Before occlusion is known, views at similar distance
from the reference view compete: a near object hides a point from the views in some directions only, so the better half
of the directions decides. Once a first depth is known, the views in which a nearer surface hides the point are left
out. Loops run over runs of adjacent pixels that search the same plane.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.processes.threads import MapFunction
from mirrorcam.optics.light_field.depth.competition import TRUNCATION, UNITS, Work, decide
from mirrorcam.optics.light_field.depth.sweep import (
    DIRECTIONS,
    TILE_PX,
    PlaneMapping,
    Ranges,
    Sweep,
    Volume,
    full_range,
)

UInt8 = NDArray[np.uint8]
UInt16 = NDArray[np.uint16]

Float32 = NDArray[np.float32]
CHANNELS = 4
GRADIENT = 2.0
"""Weight of the difference of each brightness gradient, relative to those of brightness and chroma."""
CONTRAST_PX = 7
CONTRAST_GREY = 4.0
CONTRAST_FLOOR = 0.3
OCCLUSION_PX = 1.5
"""Minimum difference in disparity at the longest baseline by which a nearer surface hides another."""
SMOOTHING_PX = 5
WEAK_GRADIENT = 1.5
"""Brightness gradient, per px, below which costs are averaged over SMOOTHING_PX squared; none above twice that."""
BAND_ROWS = 16
MAX_RUN_PX = 512
"""Maximum number of pixels of a row processed at once, a multiple of the tile's side: the work arrays fit the cache."""


def channels(brightness: Float32, chroma: Float32) -> Float32:
    """Return the weighted channels (v + 1, 4 (u + 1)) of a picture, those of a pixel adjacent.

    They are brightness and chroma (v, u), and the two gradients of brightness. The last row and column are repeated, so
    that each sample has a successor.
    """
    scale = 0.5 * GRADIENT
    gradients = [cv2.Sobel(brightness, cv2.CV_32F, *order, ksize=1, scale=scale) for order in ((1, 0), (0, 1))]
    merged = cv2.merge([brightness, chroma, *gradients])
    result: Any = cv2.copyMakeBorder(merged, 0, 1, 0, 1, cv2.BORDER_REPLICATE)
    return np.asarray(result.reshape(len(result), -1))


def mean_gradient(reference: Float32, side_px: int) -> Float32:
    """Return means (v, u) over a square of the sum of both absolute brightness gradients of `channels`."""
    gradient_u, gradient_v = (reference[:-1, channel:-CHANNELS:CHANNELS] for channel in (2, 3))
    total = (np.abs(gradient_u) + np.abs(gradient_v)) * np.float32(1.0 / GRADIENT)
    return np.asarray(cv2.blur(total, (side_px, side_px)))


def bands(rows: int) -> list[tuple[int, int]]:
    """Return the first row and the end row (exclusive) of bands of a picture that are processed in parallel."""
    return [(first, min(first + BAND_ROWS, rows)) for first in range(0, rows, BAND_ROWS)]


def _repeat_last_column(maps: Float32) -> Float32:
    """Repeat the last column of maps (K, v, u)."""
    return np.concatenate([maps, maps[:, :, -1:]], axis=2)


def matching_costs(
    reference: Float32,
    others: Float32,
    valid: NDArray[np.uint8],
    sweep: Sweep,
    run: MapFunction = map,
    nearest: Float32 | None = None,
    ranges: Ranges | None = None,
) -> Volume:
    """Compute the costs of a sweep's planes at each pixel of the reference view, in multiples of 1 / UNITS.

    Parameters
    ----------
    reference
        `channels` of the reference view.
    others
        `channels` of the other views, (K, v + 1, 4 (u + 1)).
    valid
        (K, v, u), 1 where a view has samples in the pixel and its right and lower neighbours, else 0.
    sweep
        The sweep of these views.
    run
        `map`, or the `map` of a thread pool.
    nearest
        Plane (K, v, u) of the nearest surface in each view, at a first depth, from `nearest_planes`.
    ranges
        Planes to search at each pixel; all by default.
    """
    gradient = mean_gradient(reference, CONTRAST_PX)
    shape = gradient.shape
    views = ComparedViews(
        reference,
        others,
        np.float32(CONTRAST_GREY) / (np.float32(CONTRAST_FLOOR * CONTRAST_GREY) + gradient),
        valid,
        np.empty((0, shape[0], shape[1] + 1), np.float32) if nearest is None else _repeat_last_column(nearest),
        np.float32(OCCLUSION_PX / sweep.step_px),
    )
    volume = Volume.empty(full_range(shape, sweep.plane_count) if ranges is None else ranges)

    def fill(band: tuple[int, int]) -> None:
        fill_costs(*band, views, sweep.mapping, volume.ranges, *_work(sweep.mapping.rings[-1]), volume.costs)

    list(run(fill, bands(shape[0])))
    weakness = np.clip(
        np.float32(2.0) - mean_gradient(reference, CONTRAST_PX + 2) / np.float32(WEAK_GRADIENT), 0.0, 1.0
    )
    if not weakness.any():
        return volume
    result = Volume.empty(volume.ranges)
    radius = SMOOTHING_PX // 2
    list(
        run(
            lambda band: average_weak(*band, weakness, radius, volume.ranges, volume.costs, result.costs),
            bands(shape[0]),
        )
    )
    return result


class ComparedViews(NamedTuple):
    """Views to compare.

    Attributes
    ----------
    reference, others
        `channels` of the reference view (v + 1, 4 (u + 1)) and of the K others (K, v + 1, 4 (u + 1)).
    inverse_contrast
        Factor (v, u) on the differences at each pixel of the reference view.
    valid
        (K, v, u), 1 where a view has samples in the pixel and its right and lower neighbours, else 0.
    nearest
        Plane (K, v, u + 1) of the nearest surface in each view, last column repeated; (0, v, u + 1) if unknown.
    occlusion_gap
        Minimum difference in planes by which a nearer surface hides another.
    """

    reference: Float32
    others: Float32
    inverse_contrast: Float32
    valid: NDArray[np.uint8]
    nearest: Float32
    occlusion_gap: np.float32


class Rows(NamedTuple):
    """Rows (m,) of a block: numbers in the reference view, and where a view shows them.

    The samples lie at `fraction` between row `above` and the next; row `nearest` is the nearest one.
    """

    own: Any
    above: Any
    nearest: Any
    fraction: Any


class Run(NamedTuple):
    """Adjacent columns of a block whose samples in a view are adjacent as well.

    They are `width` columns from `first` on, or from `column` of the block on. The samples are `shift` columns farther
    right, and by a fraction of a pixel that starts at `start` and grows by `growth` per pixel.
    """

    first: Any
    width: Any
    column: Any
    shift: Any
    growth: Any
    start: Any


# Each loop runs over few arrays, and over slices, whose indices cannot be negative: this lets the compiler vectorise.


@compiled
def _differences(
    reference: Float32,
    other: Float32,
    inverse_contrast: Float32,
    rows: Rows,
    run: Run,
    lines: Float32,
    cost: Float32,
) -> None:
    """Fill costs (v, u): the absolute differences of a run of a block and its samples in a view."""
    limit, x, width = np.float32(TRUNCATION), run.first, run.width
    first, values = CHANNELS * (x + run.shift), CHANNELS * width
    sampled_rows, fraction = lines[0, : values + CHANNELS], lines[1, :values]
    left, right = lines[0, :values], lines[0, CHANNELS : values + CHANNELS]
    difference = lines[2, :values]
    for i in range(width):
        fraction[CHANNELS * i : CHANNELS * (i + 1)] = run.growth * np.float32(i) + run.start
    for number in range(len(cost)):
        y, y0, row_fraction = rows.own[number], rows.above[number], rows.fraction[number]
        above = other[y0, first : first + values + CHANNELS]
        below = other[y0 + 1, first : first + values + CHANNELS]
        own = reference[y, CHANNELS * x : CHANNELS * x + values]
        for i in range(len(sampled_rows)):
            sampled_rows[i] = above[i] + row_fraction * (below[i] - above[i])
        for i in range(len(difference)):
            difference[i] = abs(left[i] + fraction[i] * (right[i] - left[i]) - own[i])
        row_cost, contrast = cost[number, run.column : run.column + width], inverse_contrast[y, x : x + width]
        for i in range(len(row_cost)):
            j = np.uint32(CHANNELS * i)
            total = (difference[j] + difference[j + 1]) + (difference[j + 2] + difference[j + 3])
            row_cost[i] = min(total * contrast[i], limit)


@compiled
def _add(cost: Float32, mask: Float32, total: Float32, count: Float32) -> None:
    """Add costs (u,) to `total`, and 1 to `count`, where the mask (u,) is 1 rather than 0."""
    for x in range(len(cost)):
        total[x] += mask[x] * cost[x]
        count[x] += mask[x]


@compiled
def _fill_sampled(valid: UInt8, rows: Rows, run: Run, sampled: Float32) -> None:
    """Fill `sampled` (v, u) in a run: 1 where the view is `valid`, else 0."""
    first = run.first + run.shift
    for number in range(len(sampled)):
        row = valid[rows.above[number], first : first + run.width]
        row_sampled = sampled[number, run.column : run.column + run.width]
        for x in range(len(row)):
            row_sampled[x] = np.float32(row[x])


@compiled
def _fill_visible(surface: Float32, rows: Rows, run: Run, max_plane: float, sampled: Float32, visible: Float32) -> None:
    """Fill `visible` (v, u) in a run: `sampled` where no plane of the view's `surface` is nearer than `max_plane`."""
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    first, width = run.first + run.shift, run.width
    # The nearest sample is the left one up to some column and the right one from there on, or conversely.
    end_fraction = run.start + run.growth * np.float32(width - 1)
    turn, right_first = width, run.start >= half
    if right_first != (end_fraction >= half):
        turn = min(max(int(np.ceil((half - run.start) / run.growth)), 0), width)
    for number in range(len(visible)):
        row = surface[rows.nearest[number], first : first + width + 1]
        for part in range(2):
            begin, end = (0, turn) if part == 0 else (turn, width)
            offset = 1 if right_first == (part == 0) else 0
            nearest = row[begin + offset : end + offset]
            row_sampled = sampled[number, run.column + begin : run.column + end]
            row_visible = visible[number, run.column + begin : run.column + end]
            for x in range(len(row_visible)):
                row_visible[x] = row_sampled[x] * (one if nearest[x] <= max_plane else zero)


@compiled
def _compare_block(
    rows: Rows,
    plane: int,
    view: int,
    first: int,
    last: int,
    views: ComparedViews,
    mapping: PlaneMapping,
    lines: Float32,
    cost: Float32,
    sampled: Float32,
    visible: Float32,
) -> None:
    """Fill a view's costs (v, u) for a plane at pixels `first` to `last` of rows, and its two masks, which are 0."""
    width = views.inverse_contrast.shape[1]
    scale, offset_u = mapping.scale[plane, view], mapping.offset_u[plane, view]
    # Restrict to columns scale x + offset_u from 0 to width - 1.
    tolerance = np.float32(1e-4)
    x = max(first, int(np.ceil(-offset_u / scale - tolerance)))
    end_x = min(last, int(np.floor((np.float32(width - 1) - offset_u) / scale + tolerance)) + 1)
    growth = scale - np.float32(1.0)
    while x < end_x:
        # A run of adjacent columns whose samples in the view are adjacent as well.
        shift = int(np.floor(growth * np.float32(x) + offset_u + tolerance))
        end = end_x
        if growth > 0:
            end = min(end, int(np.floor((np.float32(shift + 1) - offset_u) / growth)) + 1)
        elif growth < 0:
            end = min(end, int(np.floor((np.float32(shift) - offset_u) / growth)) + 1)
        end = max(end, x + 1)
        start = growth * np.float32(x) + offset_u - np.float32(shift)
        run = Run(x, end - x, x - first, shift, growth, start)
        _differences(views.reference, views.others[view], views.inverse_contrast, rows, run, lines, cost)
        _fill_sampled(views.valid[view], rows, run, sampled)
        if len(views.nearest) > 0:
            max_plane = np.float32(plane) + views.occlusion_gap
            _fill_visible(views.nearest[view], rows, run, max_plane, sampled, visible)
        x = end


@compiled
def _block(
    top: int,
    bottom: int,
    plane: int,
    first: int,
    last: int,
    views: ComparedViews,
    mapping: PlaneMapping,
    rows: Rows,
    work: Work,
) -> None:
    """Compute the costs `decided` of a plane at pixels `first` to `last` of rows `top` to `bottom`, row by row."""
    count, occlusion_known = last - first, len(views.nearest) > 0
    pixels, max_row = (bottom - top) * count, np.float32(len(views.inverse_contrast) - 1)
    for kind in range(2 if occlusion_known else 1):
        for sector in range(mapping.rings[-1]):
            work.sums[kind, sector, :pixels] = 0.0
            work.weights[kind, sector, :pixels] = 0.0
    cost, sampled, visible = work.cost[0, :pixels], work.cost[1, :pixels], work.cost[2, :pixels]
    for view in range(len(views.others)):
        sampled[:], visible[:] = 0.0, 0.0
        # Rows whose samples are in the view are adjacent.
        begin = seen = 0
        for y in range(top, bottom):
            row = mapping.scale[plane, view] * np.float32(y) + mapping.offset_v[plane, view]
            if 0 <= row <= max_row:
                begin = y - top - seen
                rows.own[seen], rows.above[seen], rows.nearest[seen] = y, int(row), int(row + np.float32(0.5))
                rows.fraction[seen] = row - np.float32(int(row))
                seen += 1
        if seen > 0:
            a, b = begin * count, (begin + seen) * count
            _compare_block(
                rows,
                plane,
                view,
                first,
                last,
                views,
                mapping,
                work.lines,
                cost[a:b].reshape((seen, count)),
                sampled[a:b].reshape((seen, count)),
                visible[a:b].reshape((seen, count)),
            )
        sector = mapping.sector[view]
        _add(cost, sampled, work.sums[0, sector, :pixels], work.weights[0, sector, :pixels])
        if occlusion_known:
            _add(cost, visible, work.sums[1, sector, :pixels], work.weights[1, sector, :pixels])
    decide(mapping.rings, occlusion_known, work, pixels)


def _work(sectors: int) -> tuple[Work, Rows]:
    """Return work arrays of a thread for the longest run of pixels."""
    max_pixels = TILE_PX * MAX_RUN_PX
    work = Work(
        np.zeros((2, sectors, max_pixels), np.float32),
        np.zeros((2, sectors, max_pixels), np.float32),
        np.empty((DIRECTIONS, max_pixels), np.float32),
        np.empty((8, max_pixels), np.float32),
        np.zeros((3, max_pixels), np.float32),
        np.empty((3, CHANNELS * (MAX_RUN_PX + 1)), np.float32),
        np.empty(max_pixels, np.float32),
    )
    own, above, nearest = np.empty((3, TILE_PX), np.int64)
    return work, Rows(own, above, nearest, np.empty(TILE_PX, np.float32))


@compiled
def fill_costs(
    first: int,
    last: int,
    views: ComparedViews,
    mapping: PlaneMapping,
    ranges: Ranges,
    work: Work,
    rows: Rows,
    costs: UInt16,
) -> None:
    """Fill the costs of rows `first` to `last` of the reference view over their ranges; `first` begins a tile."""
    width = views.inverse_contrast.shape[1]
    for top in range(first, last, TILE_PX):
        bottom = min(top + TILE_PX, last)
        low, count = ranges.low[top], ranges.plane_count[top]
        first_plane, end_plane = low[0], low[0] + count[0]
        for x in range(0, width, TILE_PX):
            first_plane, end_plane = min(first_plane, low[x]), max(end_plane, low[x] + count[x])
        for plane in range(first_plane, end_plane):
            begin = np.int64(0)
            while begin < width:
                if not low[begin] <= plane < low[begin] + count[begin]:
                    begin += TILE_PX
                    continue
                end = begin
                while end < min(begin + MAX_RUN_PX, width) and low[end] <= plane < low[end] + count[end]:
                    end += TILE_PX
                end = min(end, width)
                _block(top, bottom, plane, begin, end, views, mapping, rows, work)
                i = 0
                for y in range(top, bottom):
                    start = ranges.start[y]
                    for x in range(begin, end):
                        value = work.decided[i] * np.float32(UNITS) + np.float32(0.5)
                        costs[start[x] + plane - low[x]] = np.uint16(value)
                        i += 1
                begin = end


@compiled
def average_weak(
    first: int, last: int, weakness: Float32, radius: int, ranges: Ranges, costs: UInt16, out: UInt16
) -> None:
    """Blend the costs of rows `first` to `last` with their mean over a square, by the texture's `weakness` (v, u).

    Where a neighbour lacks a cost, at picture borders or outside its range, the pixel's own cost is used.
    """
    height, width = weakness.shape
    square_pixels = np.float32((2 * radius + 1) ** 2)
    sums = np.empty(ranges.plane_count.max(), np.float32)
    for y in range(first, last):
        for x in range(width):
            low, count, start = ranges.low[y, x], ranges.plane_count[y, x], ranges.start[y, x]
            own, result = costs[start : start + count], out[start : start + count]
            if not weakness[y, x] > 0:
                for plane in range(count):
                    result[plane] = own[plane]
                continue
            total = sums[:count]
            total[:] = 0.0
            for dy in range(-radius, radius + 1):
                for dx in range(-radius, radius + 1):
                    j, i = min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)
                    a = max(low, ranges.low[j, i])
                    b = max(a, min(low + count, ranges.low[j, i] + ranges.plane_count[j, i]))
                    other_costs = costs[
                        ranges.start[j, i] + a - ranges.low[j, i] : ranges.start[j, i] + b - ranges.low[j, i]
                    ]
                    before, shared, after = total[: a - low], total[a - low : b - low], total[b - low :]
                    own_after = own[b - low :]
                    for plane in range(len(before)):
                        before[plane] += np.float32(own[plane])
                    for plane in range(len(shared)):
                        shared[plane] += np.float32(other_costs[plane])
                    for plane in range(len(after)):
                        after[plane] += np.float32(own_after[plane])
            weight = weakness[y, x]
            for plane in range(count):
                value = (np.float32(1.0) - weight) * np.float32(own[plane]) + weight * total[plane] / square_pixels
                result[plane] = np.uint16(value + np.float32(0.5))
