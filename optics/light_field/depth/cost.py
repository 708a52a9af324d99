"""Matching cost of planes across all views, with what hides a place reasoned for each view.

Colours and slopes of brightness are compared. Before anything is known of what hides what, views at like distance
from the reference view compete: something near hides a place from the views of some directions only, so the better
half of the directions decides. Once a first depth is known, the views from which something nearer hides the place
are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.compiled import compiled
from mirrorcam.optics.light_field.depth.sweep import DIRECTIONS, Sweep

Float32 = NDArray[np.float32]
Volume = NDArray[np.uint16]
Map = Callable[..., Any]

UNITS = 64
"""Costs are stored in parts of one, one UNITS-th each."""
UNSEEN = 1e6
"""Cost of what no view of a sector sees: sorted last and then left out."""
TRUNCATION = 6.0
"""Largest difference, in contrasts, that counts as such: what is hidden may look like anything."""
COLOUR, SLOPE = 1.0, 2.0
"""Weights of the mean difference of three colours and of the difference of each of the two slopes of brightness."""
BETTER_SHARE, SEEING_SHARE = 0.5, 0.75
"""Share of the directions that decides: of all, and of those that see the place by a first depth."""
FEWER = 2.0
"""Surcharge, in contrasts, where half of that share decides alone."""
CONTRAST_PX = 7
CONTRAST_GREY = 4.0
CONTRAST_FLOOR = 0.3
HIDING_PX = 1.5
"""Motion of the farthest view by which a surface must be nearer to hide another."""
WEAK_PX = 5
WEAK_GREY = 1.5
"""Slope of brightness, per px, below which costs are averaged over a square of WEAK_PX; at twice that they are not."""
BAND_ROWS = 16


def channels(colours: Float32) -> Float32:
    """What is compared (5, v, u) of a picture (v, u, 3), 0 to 255: its colours and the two slopes of brightness."""
    grey: Any = cv2.cvtColor(colours, cv2.COLOR_RGB2GRAY)
    slopes = [cv2.Sobel(grey, cv2.CV_32F, *way, ksize=1, scale=0.5) for way in ((1, 0), (0, 1))]
    return np.ascontiguousarray(np.concatenate([np.moveaxis(colours, -1, 0), slopes]), dtype=np.float32)


def mean_slope(reference: Float32, side_px: int) -> Float32:
    """Mean sum (v, u) of both absolute slopes of brightness over a square, of `channels` of the reference view."""
    return np.asarray(cv2.blur(np.abs(reference[3]) + np.abs(reference[4]), (side_px, side_px)))


def bands(rows: int) -> list[tuple[int, int]]:
    """First and last row, exclusive, of bands of a picture, to be worked on side by side."""
    return [(first, min(first + BAND_ROWS, rows)) for first in range(0, rows, BAND_ROWS)]


@compiled
def _row_costs(
    reference: Any, other: Any, scale: Any, across: Any, y0: Any, share: Any, weights: Any, y: Any, out: Any
) -> tuple[int, int]:
    """Weighted absolute differences of row `y` of the reference to a view; return the range [x0, x1) that is seen.

    `other` is one sample wider and higher than the reference. Within a run of pixels the view's samples follow each
    other, too, with a share that changes from pixel to pixel.
    """
    width = len(out)
    # Places scale x + across from 0 to width - 1.
    x0 = max(int(np.ceil(-across / scale - np.float32(1e-4))), 0)
    x1 = min(int(np.floor((np.float32(width - 1) - across) / scale + np.float32(1e-4))) + 1, width)
    out[:] = 0.0
    grows = scale - np.float32(1.0)
    x = x0
    while x < x1:
        shift = int(np.floor(grows * np.float32(x) + across + np.float32(1e-4)))
        end = x1
        if grows > 0:
            end = min(end, int(np.floor((np.float32(shift + 1) - across) / grows)) + 1)
        elif grows < 0:
            end = min(end, int(np.floor((np.float32(shift) - across) / grows)) + 1)
        end = max(end, x + 1)
        start = grows * np.float32(x) + across - np.float32(shift)
        # Slices, whose indices cannot be negative, so that the loop runs many pixels at a time.
        sums = out[x:end]
        for channel in range(reference.shape[0]):
            upper = other[channel, y0, x + shift : end + shift + 1]
            lower = other[channel, y0 + 1, x + shift : end + shift + 1]
            own, weight = reference[channel, y, x:end], weights[channel]
            for place in range(len(sums)):
                part = grows * np.float32(place) + start
                left = upper[place] + share * (lower[place] - upper[place])
                right = upper[place + 1] + share * (lower[place + 1] - upper[place + 1])
                sums[place] += weight * abs(left + part * (right - left) - own[place])
        x = end
    return x0, x1


@compiled
def _sorted(costs: Any) -> None:
    """Sort costs (m, u) along their first axis in place, all columns side by side (odd-even transposition)."""
    count = len(costs)
    for turn in range(count):
        for number in range(turn % 2, count - 1, 2):
            lower, upper = costs[number], costs[number + 1]
            for x in range(costs.shape[1]):
                a, b = lower[x], upper[x]
                lower[x] = a if a < b else b
                upper[x] = b if a < b else a


@compiled
def _add_better(costs: Any, count: Any, share: Any, weight: Any, total: Any) -> None:
    """Add, times a weight (u,), the mean of the least share (u,) of `count` (u,) sorted costs (m, u)."""
    one, fewer = np.float32(1.0), np.float32(FEWER)
    for x in range(len(total)):
        take = max(share[x] * count[x], one)
        less = max(np.float32(0.5) * share[x] * count[x], one)
        mean, mean_of_less = np.float32(0.0), np.float32(0.0)
        for number in range(len(costs)):
            left = take - np.float32(number)
            mean += max(min(left, one), np.float32(0.0)) * costs[number, x]
            left = less - np.float32(number)
            mean_of_less += max(min(left, one), np.float32(0.0)) * costs[number, x]
        total[x] += weight[x] * min(mean / take, mean_of_less / less + fewer)


@compiled
def _decide(sums: Any, weights: Any, rings: Any, work: Any, ring_work: Any, out: Any) -> None:
    """Costs (u,) of a row of sums and weights (2, sectors, u): of all views, and of those that see it by a first depth.

    `rings` (r + 1,) has the first sector of each ring and the number of sectors.
    """
    out[:] = 0.0
    seeing, count, share, weight, every = ring_work[0], ring_work[1], ring_work[2], ring_work[3], ring_work[4]
    every[:] = 0.0
    for ring in range(len(rings) - 1):
        first, last = rings[ring], rings[ring + 1]
        seeing[:], count[:], weight[:] = 0.0, 0.0, 0.0
        for sector in range(first, last):
            for x in range(len(out)):
                seeing[x] += np.float32(1.0) if weights[1, sector, x] > 0 else np.float32(0.0)
        for x in range(len(out)):
            share[x] = np.float32(SEEING_SHARE) if seeing[x] >= 2 else np.float32(BETTER_SHARE)
        costs = work[: last - first]
        for sector in range(first, last):
            for x in range(len(out)):
                hides = seeing[x] >= 2
                part = weights[1, sector, x] if hides else weights[0, sector, x]
                total = sums[1, sector, x] if hides else sums[0, sector, x]
                costs[sector - first, x] = total / part if part > 0 else np.float32(UNSEEN)
                count[x] += np.float32(1.0) if part > 0 else np.float32(0.0)
                weight[x] += part
        _sorted(costs)
        for x in range(len(out)):
            every[x] += weight[x]
        _add_better(costs, count, share, weight, out)
    for x in range(len(out)):
        out[x] = out[x] / every[x] if every[x] > 0 else np.float32(0.5 * TRUNCATION)


@compiled
def _add_view(
    cost: Any, contrast: Any, seen: Any, scale: Any, start: Any, weight: Any, total: Any, part: Any, limit: Any
) -> None:
    """Truncate costs (u,) in contrasts, and add them where the view sees; `start`: its column at the first."""
    for x in range(len(cost)):
        here = weight if seen[np.uint32(scale * np.float32(x) + start)] != 0 else np.float32(0.0)
        value = cost[x] * contrast[x]
        value = value if value < limit else limit
        cost[x] = value
        total[x] += here * value
        part[x] += here


@compiled
def _add_seeing(
    cost: Any, seen: Any, surface: Any, behind: Any, scale: Any, start: Any, weight: Any, total: Any, part: Any
) -> None:
    """Add costs (u,) where the view sees and nothing nearer hides the place from it."""
    half = np.float32(0.5)
    for x in range(len(cost)):
        column = scale * np.float32(x) + start
        hidden = seen[np.uint32(column)] == 0 or surface[np.uint32(column + half)] > behind
        here = np.float32(0.0) if hidden else weight
        total[x] += here * cost[x]
        part[x] += here


@compiled
def _costs(
    first: Any,
    last: Any,
    reference: Any,
    others: Any,
    seen: Any,
    scale: Any,
    across: Any,
    down: Any,
    sector: Any,
    rings: Any,
    view_weight: Any,
    weights: Any,
    contrast: Any,
    nearest: Any,
    hiding: Any,
    volume: Any,
) -> None:
    """Fill rows `first` to `last` of a volume (v, u, n); `nearest` (K, v, u) or (0, v, u): surfaces that hide."""
    views, height, width = len(others), reference.shape[1], reference.shape[2]
    limit, half = np.float32(TRUNCATION), np.float32(0.5)
    sums = np.zeros((2, rings[-1], width), np.float32)
    parts = np.zeros_like(sums)
    work, ring_work = np.empty((DIRECTIONS, width), np.float32), np.empty((5, width), np.float32)
    cost, decided = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(first, last):
        for plane in range(volume.shape[2]):
            sums[:], parts[:] = 0.0, 0.0
            for view in range(views):
                row = scale[plane, view] * np.float32(y) + down[plane, view]
                if row < 0 or row > height - 1:
                    continue
                y0 = int(np.floor(row))
                share = np.float32(row - np.float32(y0))
                stretch, offset = scale[plane, view], across[plane, view]
                x0, x1 = _row_costs(reference, others[view], stretch, offset, y0, share, weights, y, cost)
                at = sector[view]
                _add_view(
                    cost[x0:x1],
                    contrast[y, x0:x1],
                    seen[view, y0],
                    stretch,
                    stretch * np.float32(x0) + offset,
                    view_weight[view],
                    sums[0, at, x0:x1],
                    parts[0, at, x0:x1],
                    limit,
                )
                if len(nearest) > 0:
                    _add_seeing(
                        cost[x0:x1],
                        seen[view, y0],
                        nearest[view, int(row + half)],
                        np.float32(plane) + hiding,
                        stretch,
                        stretch * np.float32(x0) + offset,
                        view_weight[view],
                        sums[1, at, x0:x1],
                        parts[1, at, x0:x1],
                    )
            _decide(sums, parts, rings, work, ring_work, decided)
            for x in range(width):
                volume[y, x, plane] = np.uint16(decided[x] * np.float32(UNITS) + half)


@compiled
def _across_sums(first: Any, last: Any, volume: Any, sums: Any) -> None:
    """Sums over WEAK_PX columns; at the sides the last column is repeated."""
    width, reach = volume.shape[1], WEAK_PX // 2
    for y in range(first, last):
        for x in range(width):
            sums[y, x, :] = 0
            for offset in range(-reach, reach + 1):
                sums[y, x, :] += volume[y, min(max(x + offset, 0), width - 1), :]


@compiled
def _averaged(first: Any, last: Any, sums: Any, weak: Any, volume: Any) -> None:
    """Blend costs with their mean over a square, the more the weaker the texture (v, u) is."""
    height, width, planes = volume.shape
    reach = WEAK_PX // 2
    for y in range(first, last):
        for x in range(width):
            if weak[y, x] > 0:
                share = weak[y, x] / np.float32(WEAK_PX * WEAK_PX)
                for plane in range(planes):
                    total = np.float32(0.0)
                    for offset in range(-reach, reach + 1):
                        total += np.float32(sums[min(max(y + offset, 0), height - 1), x, plane])
                    own = (np.float32(1.0) - weak[y, x]) * np.float32(volume[y, x, plane])
                    volume[y, x, plane] = np.uint16(own + share * total + np.float32(0.5))


def matching_costs(
    reference: Float32,
    others: Float32,
    seen: NDArray[np.uint8],
    planes: Sweep,
    run: Map = map,
    nearest: Float32 | None = None,
) -> Volume:
    """Cost (v, u, n) of each plane of a sweep at each pixel of the reference view, in UNITS-ths of a contrast.

    Parameters
    ----------
    reference
        `channels` (5, v, u) of the reference view.
    others
        Those of the other views, (K, 5, v, u).
    seen
        (K, v, u): 0 where a view has no sample within the pixel and the next ones.
    planes
        The sweep of these views.
    run
        `map`, or that of a pool of threads.
    nearest
        Plane (K, v, u) of the nearest surface that each view sees by a first depth, as `nearest_planes` has it.
    """
    height, width = reference.shape[1:]
    slope = mean_slope(reference, CONTRAST_PX)
    contrast = np.float32(CONTRAST_GREY) / (np.float32(CONTRAST_FLOOR * CONTRAST_GREY) + slope)
    weights = np.array([COLOUR / 3.0] * 3 + [SLOPE] * 2, np.float32)
    hiding = np.float32(HIDING_PX / planes.reach_px)
    surfaces = np.empty((0, height, width), np.float32) if nearest is None else nearest
    volume = np.empty((height, width, planes.planes), np.uint16)
    wider = np.pad(others, ((0, 0), (0, 0), (0, 1), (0, 1)), mode="edge")

    def fill(band: tuple[int, int]) -> None:
        _costs(
            *band,
            reference,
            wider,
            seen,
            planes.scale,
            planes.across,
            planes.down,
            planes.sector,
            planes.rings,
            planes.weight,
            weights,
            contrast,
            surfaces,
            hiding,
            volume,
        )

    list(run(fill, bands(height)))
    weak = np.clip(np.float32(2.0) - mean_slope(reference, CONTRAST_PX + 2) / np.float32(WEAK_GREY), 0.0, 1.0)
    if weak.any():
        sums = np.empty_like(volume)
        list(run(lambda band: _across_sums(*band, volume, sums), bands(height)))
        list(run(lambda band: _averaged(*band, sums, weak, volume), bands(height)))
    return volume
