"""Semi-global aggregation of a cost volume along eight directions, following slanted surfaces and picture edges.

After Hirschmueller, PAMI 30(2), 2008; for slanted surfaces, Scharstein, Taniai and Sinha, 3DV 2017.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.depth.cost import bands
from mirrorcam.optics.light_field.depth.sweep import Ranges, Volume

UInt16 = NDArray[np.uint16]
Float32 = NDArray[np.float32]
Map = Callable[..., Any]

PATH_DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))
EDGE_GREY = 10.0
"""Step of a colour, of 255, that lowers the penalty of a depth edge by a factor of e."""
EDGE_FLOOR = 0.2
"""Share of the penalty that remains at the strongest edge."""
MIN_RATIO = 1.5
"""Least ratio of the penalty of any step to the penalty of a step to the next plane."""
SLANT_REACH_PX, SLANT_MEDIAN_PX = 3, 21
SLANT_MEAN_PX = (145, 49, 17, 9)
SLANT_PRIOR = 0.03
"""Share of certain pixels in a square at which they count as much as a larger square."""
CERTAIN_MARGIN = 12.0
"""Margin, in contrasts of eight views, above which a slant is certain."""
MAX_SLANT = 2.0
"""Steepest slant, in planes per pixel."""
LEVEL_SLANT = 0.02
"""Slant, in planes per pixel, below which a surface counts as level."""
SAME_PLANES = 2
"""Distance in planes up to which equally cheap planes are one place, not rivals."""
PLACE_PLANES = 3
"""Planes within half a pixel of the farthest view's motion around a place."""
LINES = 32


class _Surface(NamedTuple):
    """Surfaces that paths follow: colours (v, u, 3), and slants (v, u) in planes per pixel, across and down."""

    picture: Any
    slant_across: Any
    slant_down: Any


class _Penalties(NamedTuple):
    next_plane: Any
    any_plane: Any


@compiled
def _step(
    path: UInt16, before: int, offset: int, least: int, penalty: int, next_plane: int, own: UInt16, on: UInt16
) -> None:
    """Fill the path costs `on` at the planes of a pixel from the path costs of the previous pixel.

    Plane i of this pixel is plane i + `offset` of the previous one, whose `before` planes start at index 2 of `path`.
    """
    count = len(own)
    first = min(max(-1 - offset, 0), count)
    last = max(min(before + 1 - offset, count), first)
    # The sums fit in 16 bits, which lets the loop run over many planes at once.
    highest = np.uint16(least + penalty)
    for plane in range(first):
        on[plane] = np.uint16(own[plane] + penalty)
    previous, own_costs, result = path[first + offset + 1 : last + offset + 3], own[first:last], on[first:last]
    for plane in range(last - first):
        nearby = np.uint16(min(previous[plane], previous[plane + 2]) + next_plane)
        best = min(previous[plane + 1], nearby, highest)
        result[plane] = np.uint16(own_costs[plane] + np.uint16(best - least))
    for plane in range(last, count):
        on[plane] = np.uint16(own[plane] + penalty)


@compiled
def _path(
    ranges: Ranges,
    costs: UInt16,
    total: UInt16,
    surface: _Surface,
    penalties: _Penalties,
    y: int,
    x: int,
    dy: int,
    dx: int,
    work: UInt16,
) -> None:
    """Add to `total` the costs of the cheapest paths along one line from a pixel on; `work` (2, n + 4) is scratch."""
    height, width = ranges.low.shape
    path, on = work[0], work[1]
    subplane = np.float32(0.0)
    low, count, start = ranges.low[y, x], ranges.planes[y, x], ranges.start[y, x]
    path[2 : count + 2] = costs[start : start + count]
    sums = total[start : start + count]
    for plane in range(count):
        sums[plane] += path[plane + 2]
    picture, next_plane = surface.picture, np.uint16(penalties.next_plane)
    y, x = y + dy, x + dx
    while 0 <= y < height and 0 <= x < width:
        subplane += surface.slant_across[y, x] * np.float32(dx) + surface.slant_down[y, x] * np.float32(dy)
        shift = int(np.floor(subplane + np.float32(0.5)))
        subplane -= np.float32(shift)
        known = path[2 : count + 2]
        least = known[0]
        for plane in range(1, count):
            least = min(least, known[plane])
        for pad in range(2):
            path[pad], path[count + 2 + pad] = np.uint16(60000), np.uint16(60000)
        edge = np.float32(0.0)
        for colour in range(3):
            edge = max(edge, abs(picture[y, x, colour] - picture[y - dy, x - dx, colour]))
        share = np.float32(EDGE_FLOOR) + np.float32(1.0 - EDGE_FLOOR) * np.exp(edge * np.float32(-1.0 / EDGE_GREY))
        jump_penalty = max(np.float32(MIN_RATIO) * np.float32(next_plane), np.float32(penalties.any_plane) * share)
        offset = ranges.low[y, x] - shift - low
        before = count
        low, count, start = ranges.low[y, x], ranges.planes[y, x], ranges.start[y, x]
        own, sums = costs[start : start + count], total[start : start + count]
        _step(path, before, offset, least, np.uint16(jump_penalty), next_plane, own, on)
        for plane in range(count):
            path[plane + 2] = on[plane]
            sums[plane] += on[plane]
        y, x = y + dy, x + dx


@compiled
def _paths(
    first: int,
    last: int,
    dy: int,
    dx: int,
    ranges: Ranges,
    costs: UInt16,
    total: UInt16,
    surface: _Surface,
    penalties: _Penalties,
) -> None:
    """Follow lines `first` to `last` of one direction: those from the first row, then those from the first column."""
    height, width = ranges.low.shape
    work = np.empty((2, ranges.planes.max() + 4), np.uint16)
    for line in range(first, last):
        if dy == 0:
            y, x = line, 0 if dx > 0 else width - 1
        elif line < width:
            y, x = 0 if dy > 0 else height - 1, line
        else:
            x = 0 if dx > 0 else width - 1
            y = line - width + 1 if dy > 0 else height - 2 - (line - width)
        _path(ranges, costs, total, surface, penalties, y, x, dy, dx, work)


def aggregate(
    volume: Volume,
    picture: Float32,
    slants: tuple[Float32, Float32],
    penalties: tuple[int, int],
    run: Map = map,
) -> Volume:
    """Return the path costs of a volume of matching costs, summed over the directions.

    Parameters
    ----------
    volume
        Matching costs; eight times (the largest + the second penalty) must fit 16 bits.
    picture
        Colours (v, u, 3) of the reference view, 0 to 255; depth edges are cheaper at colour edges.
    slants
        Slants (v, u) of the surface in planes per pixel, across and down; paths follow them without a penalty.
    penalties
        Penalty of a step to the adjacent plane, and of a step to any other.
    run
        `map`, or the `map` of a thread pool.
    """
    height, width = volume.ranges.low.shape
    total = np.zeros_like(volume.costs)
    surface = _Surface(picture, *slants)
    prices = _Penalties(*(np.uint16(penalty) for penalty in penalties))
    for dy, dx in PATH_DIRECTIONS:
        lines = height if dy == 0 else width if dx == 0 else width + height - 1
        jobs = [(first, min(first + LINES, lines)) for first in range(0, lines, LINES)]

        def fill(job: tuple[int, int], dy: int = dy, dx: int = dx) -> None:
            _paths(*job, dy, dx, volume.ranges, volume.costs, total, surface, prices)

        list(run(fill, jobs))
    return Volume(volume.ranges, total)


@compiled
def _minima(first: int, last: int, ranges: Ranges, total: UInt16, doubtful: float, found: Float32) -> None:
    """Fill rows `first` to `last` of `found` (3, v, u): plane, margin and rivals."""
    one = np.float32(1.0)
    for y in range(first, last):
        for x in range(ranges.low.shape[1]):
            start, planes = ranges.start[y, x], ranges.planes[y, x]
            sums = total[start : start + planes]
            best = 0
            for plane in range(1, planes):
                if sums[plane] < sums[best]:
                    best = plane
            position, least = np.float32(best), np.float32(sums[best])
            if 0 < best < planes - 1:
                before, after = np.float32(sums[best - 1]), np.float32(sums[best + 1])
                curvature = before + after - np.float32(2.0) * least
                if curvature > 0:
                    position += np.float32(0.5) * (before - after) / curvature
            other, rival_sum = np.float32(65535.0), np.float32(0.0)
            for plane in range(planes):
                if abs(plane - best) > SAME_PLANES:
                    cost = np.float32(sums[plane])
                    other = min(other, cost)
                    excess = (cost - least) / doubtful
                    rival_sum += max(one - excess * excess, np.float32(0.0)) ** 2
            found[0, y, x], found[1, y, x] = position + np.float32(ranges.low[y, x]), other - least
            found[2, y, x] = rival_sum / np.float32(PLACE_PLANES)


@dataclass(frozen=True, eq=False)
class Cheapest:
    """The planes of least cost.

    Attributes
    ----------
    planes
        Plane (v, u), with sub-plane interpolation.
    margin
        Cost difference (v, u) to the cheapest plane farther than SAME_PLANES away.
    rivals
        Number (v, u) of other places with about the same cost, as a sum of weights.
    """

    planes: Float32
    margin: Float32
    rivals: Float32


def cheapest(total: Volume, doubtful: float, run: Map = map) -> Cheapest:
    """Return the planes of least summed path cost.

    Places that cost at least `doubtful` more are no rivals.
    """
    shape = total.ranges.low.shape
    found = np.empty((3, *shape), np.float32)
    list(run(lambda band: _minima(*band, total.ranges, total.costs, np.float32(doubtful), found), bands(shape[0])))
    return Cheapest(found[0], found[1], found[2])


def slants_of(planes: Float32, margin: Float32) -> tuple[Float32, Float32]:
    """Return the slants (v, u) of the surfaces of a map (v, u), in planes per pixel, across and down.

    They are medians over a square. Where the map's margin (v, u), in contrasts of eight views, is low, the slant comes
    from more certain pixels around, at larger distances the fewer are near.
    """
    certainty = np.square(np.clip(margin * np.float32(1.0 / CERTAIN_MARGIN), 0.0, 1.0))
    weights = [cv2.blur(certainty, (side, side), borderType=cv2.BORDER_REPLICATE) for side in SLANT_MEAN_PX]
    result = []
    for axis in (1, 0):
        rise = _rise(planes, axis)
        coded = np.clip(rise * np.float32(127.0 / MAX_SLANT) + np.float32(128.5), 0.0, 255.0).astype(np.uint8)
        median: Any = cv2.medianBlur(coded, SLANT_MEDIAN_PX).astype(np.float32)
        median = (median - np.float32(128.0)) * np.float32(MAX_SLANT / 127.0) * certainty
        slant = np.zeros_like(planes)
        for side, weight in zip(SLANT_MEAN_PX, weights, strict=True):
            sums = cv2.blur(median, (side, side), borderType=cv2.BORDER_REPLICATE)
            slant = (sums + np.float32(SLANT_PRIOR) * slant) / (weight + np.float32(SLANT_PRIOR))
        slant[np.abs(slant) < LEVEL_SLANT] = 0.0
        result.append(np.asarray(slant, dtype=np.float32))
    return result[0], result[1]


def _rise(planes: Float32, axis: int) -> Float32:
    """Slope per pixel (v, u) along an axis, over SLANT_REACH_PX ahead and behind, less at the borders."""
    count = planes.shape[axis]
    ahead, behind = (np.clip(np.arange(count) + sign * SLANT_REACH_PX, 0, count - 1) for sign in (1, -1))
    spacing = (ahead - behind).astype(np.float32)
    rise = np.take(planes, ahead, axis) - np.take(planes, behind, axis)
    return np.asarray(rise / (spacing if axis == 1 else spacing[:, None]))
