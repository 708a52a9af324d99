"""Semi-global aggregation of a cost volume along eight directions, following slanted surfaces and picture edges.

After Hirschmueller, PAMI 30(2), 2008; for slanted surfaces, Scharstein, Taniai and Sinha, 3DV 2017.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled, inlined
from mirrorcam.core.processes.threads import MapFunction
from mirrorcam.optics.light_field.depth.cost import bands
from mirrorcam.optics.light_field.depth.sweep import Ranges, Volume

UInt16 = NDArray[np.uint16]
Float32 = NDArray[np.float32]

PATH_DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))
"""Steps (v, u); each is followed by its opposite."""
EDGE_GREY = 10.0
"""Step of a colour, of 255, that lowers the penalty of a depth edge by a factor of e."""
EDGE_STEPS = 4
"""Steps of a colour per grey level that are distinguished."""
EDGE_FLOOR = 0.1
"""Fraction of the penalty that remains at the strongest edge."""
MIN_RATIO = 1.0
"""Minimum ratio of the penalty of a larger step to the penalty of a step to the next plane."""
SLANT_RADIUS_PX, SLANT_MEDIAN_PX = 3, 21
SLANT_MEAN_PX = (145, 49, 17, 9)
SLANT_PRIOR = 0.03
"""Fraction of certain pixels in a square at which they count as much as the next larger square."""
CERTAIN_MARGIN = 12.0
"""Margin, as a matching cost of eight views, above which a slant is certain."""
MAX_SLANT = 2.0
"""Maximum slant, in planes per pixel."""
MIN_SLANT = 0.02
"""Slant, in planes per pixel, below which a surface counts as fronto-parallel."""
SAME_PLANES = 2
"""Distance in planes up to which planes of equal cost are one candidate, not rivals."""
CANDIDATE_PLANES = 3
"""Number of planes of one candidate: those within half a pixel of disparity at the longest baseline."""
PATHS_PER_JOB = 32


class _Surface(NamedTuple):
    """Surfaces that paths follow along a line: slants (v, u) in planes per pixel along u and v, and penalties.

    A step to the next plane costs `next_plane`; a larger one from pixel (y, x) on, `jump[y + offset_v, x + offset_u]`.
    """

    slant_u: Any
    slant_v: Any
    next_plane: Any
    jump: Any
    offset_v: Any
    offset_u: Any


@compiled
def _jump_penalties(
    first: int, last: int, picture: Float32, dy: int, dx: int, penalty_of_step: UInt16, out: UInt16
) -> None:
    """Fill the penalties `out` (v, u) of jumps between a pixel and its neighbour at (-dy, -dx), by their colours."""
    width = out.shape[1]
    for y in range(first, last):
        for x in range(max(dx, 0), min(width + dx, width)):
            if y < dy:
                continue
            step = np.float32(0.0)
            for colour in range(3):
                step = max(step, abs(picture[y, x, colour] - picture[y - dy, x - dx, colour]))
            out[y, x] = penalty_of_step[
                min(int(step * np.float32(EDGE_STEPS) + np.float32(0.5)), len(penalty_of_step) - 1)
            ]


@inlined
def _step(
    path: UInt16,
    previous_count: int,
    offset: int,
    min_cost: int,
    penalty: int,
    next_plane: int,
    costs: UInt16,
    result: UInt16,
) -> None:
    """Fill the path costs `result` at the planes of a pixel from the path costs of the previous pixel.

    Plane i of this pixel is plane i + `offset` of the previous one, whose `previous_count` planes start at
    index 2 of `path`.
    """
    count = len(costs)
    first = min(max(-1 - offset, 0), count)
    last = max(min(previous_count + 1 - offset, count), first)
    # The sums fit in 16 bits, which lets the loop run over many planes at once.
    max_cost = np.uint16(min_cost + penalty)
    for plane in range(first):
        result[plane] = np.uint16(costs[plane] + penalty)
    previous, matched, inner = path[first + offset + 1 : last + offset + 3], costs[first:last], result[first:last]
    for plane in range(last - first):
        nearby = np.uint16(min(previous[plane], previous[plane + 2]) + next_plane)
        best = min(previous[plane + 1], nearby, max_cost)
        inner[plane] = np.uint16(matched[plane] + np.uint16(best - min_cost))
    for plane in range(last, count):
        result[plane] = np.uint16(costs[plane] + penalty)


@compiled
def _path(
    ranges: Ranges,
    costs: UInt16,
    total: UInt16,
    surface: _Surface,
    y: int,
    x: int,
    dy: int,
    dx: int,
    work: UInt16,
) -> None:
    """Add to `total` the costs of the cheapest paths along one line from a pixel on; `work` (2, n + 4) is a buffer."""
    height, width = ranges.low.shape
    path, result = work[0], work[1]
    subplane = np.float32(0.0)
    low, count, start = ranges.low[y, x], ranges.plane_count[y, x], ranges.start[y, x]
    matched, sums = costs[start : start + count], total[start : start + count]
    for plane in range(count):
        path[plane + 2] = matched[plane]
        sums[plane] += matched[plane]
    next_plane = np.uint16(surface.next_plane)
    y, x = y + dy, x + dx
    while 0 <= y < height and 0 <= x < width:
        subplane += surface.slant_u[y, x] * np.float32(dx) + surface.slant_v[y, x] * np.float32(dy)
        shift = int(np.floor(subplane + np.float32(0.5)))
        subplane -= np.float32(shift)
        previous = path[2 : count + 2]
        min_cost = previous[0]
        for plane in range(1, count):
            min_cost = min(min_cost, previous[plane])
        for pad in range(2):
            path[pad], path[count + 2 + pad] = np.uint16(60000), np.uint16(60000)
        jump_penalty = surface.jump[y - dy + surface.offset_v, x - dx + surface.offset_u]
        offset = ranges.low[y, x] - shift - low
        previous_count = count
        low, count, start = ranges.low[y, x], ranges.plane_count[y, x], ranges.start[y, x]
        matched, sums = costs[start : start + count], total[start : start + count]
        _step(path, previous_count, offset, min_cost, jump_penalty, next_plane, matched, result[2 : count + 2])
        path, result = result, path
        for plane in range(count):
            sums[plane] += path[plane + 2]
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
) -> None:
    """Follow lines `first` to `last` of one direction: those from the first row, then those from the first column."""
    height, width = ranges.low.shape
    work = np.empty((2, ranges.plane_count.max() + 4), np.uint16)
    for line in range(first, last):
        if dy == 0:
            y, x = line, 0 if dx > 0 else width - 1
        elif line < width:
            y, x = 0 if dy > 0 else height - 1, line
        else:
            x = 0 if dx > 0 else width - 1
            y = line - width + 1 if dy > 0 else height - 2 - (line - width)
        _path(ranges, costs, total, surface, y, x, dy, dx, work)


def _jumps(picture: Float32, dy: int, dx: int, next_plane: int, jump: int, run: MapFunction) -> UInt16:
    """Return the penalties (v, u) of jumps between each pixel and its neighbour at (-dy, -dx)."""
    steps = np.arange(255 * EDGE_STEPS + 1) / EDGE_STEPS
    fractions = EDGE_FLOOR + (1.0 - EDGE_FLOOR) * np.exp(steps / -EDGE_GREY)
    penalty_of_step = np.maximum(jump * fractions, MIN_RATIO * next_plane).astype(np.uint16)
    result = np.zeros(picture.shape[:2], np.uint16)
    list(run(lambda band: _jump_penalties(*band, picture, dy, dx, penalty_of_step, result), bands(len(result))))
    return result


def aggregate(
    volume: Volume,
    picture: Float32,
    slants: tuple[Float32, Float32],
    penalties: tuple[int, int],
    run: MapFunction = map,
    directions: int = len(PATH_DIRECTIONS),
) -> Volume:
    """Return the path costs of a volume of matching costs, summed over the directions.

    Parameters
    ----------
    volume
        Matching costs; eight times the sum of their maximum and the second penalty must fit into 16 bits.
    picture
        Colours (v, u, 3) of the reference view, 0 to 255; depth edges are cheaper at colour edges.
    slants
        Slants (v, u) of the surface in planes per pixel along u and v; paths follow them without a penalty.
    penalties
        Penalty of a step to an adjacent plane, and of a larger step (P1 and P2).
    run
        `map`, or the `map` of a thread pool.
    directions
        Number of PATH_DIRECTIONS that paths follow.
    """
    height, width = volume.ranges.low.shape
    total = np.zeros_like(volume.costs)
    next_plane, jump = penalties
    for number, (dy, dx) in enumerate(PATH_DIRECTIONS[:directions]):
        forward = number % 2 == 0
        if forward:
            jumps = _jumps(picture, dy, dx, next_plane, jump, run)
        surface = _Surface(*slants, np.uint16(next_plane), jumps, *((dy, dx) if forward else (0, 0)))
        lines = height if dy == 0 else width if dx == 0 else width + height - 1
        jobs = [(first, min(first + PATHS_PER_JOB, lines)) for first in range(0, lines, PATHS_PER_JOB)]

        def fill(job: tuple[int, int], dy: int = dy, dx: int = dx, surface: _Surface = surface) -> None:
            _paths(*job, dy, dx, volume.ranges, volume.costs, total, surface)

        list(run(fill, jobs))
    return Volume(volume.ranges, total)


@compiled
def _minima(first: int, last: int, ranges: Ranges, total: UInt16, max_margin: float, result: Float32) -> None:
    """Fill rows `first` to `last` of `result` (3, v, u): plane, margin and rivals."""
    one = np.float32(1.0)
    for y in range(first, last):
        for x in range(ranges.low.shape[1]):
            start, planes = ranges.start[y, x], ranges.plane_count[y, x]
            sums = total[start : start + planes]
            best = 0
            for plane in range(1, planes):
                if sums[plane] < sums[best]:
                    best = plane
            position, min_cost = np.float32(best), np.float32(sums[best])
            if 0 < best < planes - 1:
                before, after = np.float32(sums[best - 1]), np.float32(sums[best + 1])
                curvature = before + after - np.float32(2.0) * min_cost
                if curvature > 0:
                    position += np.float32(0.5) * (before - after) / curvature
            next_best, rival_sum = np.float32(65535.0), np.float32(0.0)
            for plane in range(planes):
                if abs(plane - best) > SAME_PLANES:
                    cost = np.float32(sums[plane])
                    next_best = min(next_best, cost)
                    excess = (cost - min_cost) / max_margin
                    rival_sum += max(one - excess * excess, np.float32(0.0)) ** 2
            result[0, y, x], result[1, y, x] = position + np.float32(ranges.low[y, x]), next_best - min_cost
            result[2, y, x] = rival_sum / np.float32(CANDIDATE_PLANES)


@dataclass(frozen=True, eq=False)
class LowestCost:
    """The planes of lowest cost.

    Attributes
    ----------
    planes
        Plane (v, u), with sub-plane interpolation.
    margin
        Cost difference (v, u) to the best plane more than SAME_PLANES away.
    rivals
        Number (v, u) of other candidates with about the same cost, as a sum of weights.
    """

    planes: Float32
    margin: Float32
    rivals: Float32


def lowest_cost(total: Volume, max_margin: float, run: MapFunction = map) -> LowestCost:
    """Return the planes of lowest summed path cost; candidates costing `max_margin` more are not rivals."""
    shape = total.ranges.low.shape
    result = np.empty((3, *shape), np.float32)
    list(run(lambda band: _minima(*band, total.ranges, total.costs, np.float32(max_margin), result), bands(shape[0])))
    return LowestCost(result[0], result[1], result[2])


def surface_slants(planes: Float32, margin: Float32) -> tuple[Float32, Float32]:
    """Return the slants (v, u) of the surfaces of a map (v, u), in planes per pixel along u and v.

    They are medians over a square. Where the map's margin (v, u), a matching cost of eight views, is low, the slant
    comes from more certain pixels around it, farther away the fewer of them are near.
    """
    certainty = np.square(np.clip(margin * np.float32(1.0 / CERTAIN_MARGIN), 0.0, 1.0))
    weights = [cv2.blur(certainty, (side, side), borderType=cv2.BORDER_REPLICATE) for side in SLANT_MEAN_PX]
    result = []
    for axis in (1, 0):
        gradient = _gradient(planes, axis)
        quantised = np.clip(gradient * np.float32(127.0 / MAX_SLANT) + np.float32(128.5), 0.0, 255.0).astype(np.uint8)
        median: Any = cv2.medianBlur(quantised, SLANT_MEDIAN_PX).astype(np.float32)
        median = (median - np.float32(128.0)) * np.float32(MAX_SLANT / 127.0) * certainty
        slant = np.zeros_like(planes)
        for side, weight in zip(SLANT_MEAN_PX, weights, strict=True):
            sums = cv2.blur(median, (side, side), borderType=cv2.BORDER_REPLICATE)
            slant = (sums + np.float32(SLANT_PRIOR) * slant) / (weight + np.float32(SLANT_PRIOR))
        slant[np.abs(slant) < MIN_SLANT] = 0.0
        result.append(np.asarray(slant, dtype=np.float32))
    return result[0], result[1]


def _gradient(planes: Float32, axis: int) -> Float32:
    """Difference per pixel (v, u) along an axis, over SLANT_RADIUS_PX to both sides, less at the borders."""
    count = planes.shape[axis]
    after, before = (np.clip(np.arange(count) + sign * SLANT_RADIUS_PX, 0, count - 1) for sign in (1, -1))
    spacing = (after - before).astype(np.float32)
    gradient = np.take(planes, after, axis) - np.take(planes, before, axis)
    return np.asarray(gradient / (spacing if axis == 1 else spacing[:, None]))
