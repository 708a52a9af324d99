"""Semi-global aggregation of a cost volume along eight directions, along surfaces that lean, up to the picture's edges.

After Hirschmueller, PAMI 30(2), 2008, and, for surfaces that lean, Scharstein, Taniai and Sinha, 3DV 2017.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.compiled import compiled
from mirrorcam.optics.light_field.depth.cost import TRUNCATION, UNITS, Volume, bands

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

WAYS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))
EDGE_GREY = 10.0
"""Step of a colour, of 255, that makes leaving a surface cheaper by a factor of e."""
EDGE_LEAST = 0.2
"""Part of the penalty that remains at the strongest edge."""
LEAST_RATIO = 1.5
"""Least ratio of the penalty of any step to that of a step to the next plane."""
SLOPE_REACH_PX, SLOPE_MEDIAN_PX, SLOPE_MEAN_PX = 3, 21, 9
STEEPEST = 2.0
"""Steepest lean, in planes a pixel."""
LEVEL = 0.02
"""Leans below that, in planes a pixel, count as none."""
SAME_PLANES = 2
"""Planes so near each other are one place, when it is asked whether another is as cheap."""
PLACE_PLANES = 3
"""Planes that are right together, to half a pixel of the farthest view's motion."""
MISMATCH_PX = 3
LINES = 32


@compiled
def _path(
    volume: Any,
    total: Any,
    picture: Any,
    lean_across: Any,
    lean_down: Any,
    y: Any,
    x: Any,
    dy: Any,
    dx: Any,
    next_plane: Any,
    any_plane: Any,
    path: Any,
    on: Any,
) -> None:
    """Add to `total` the costs of the cheapest paths along one line; `path` and `on` are work space (n + 2,)."""
    height, width, planes = volume.shape
    carried = np.float32(0.0)
    path[0], path[planes + 1] = np.uint16(60000), np.uint16(60000)
    for plane in range(planes):
        path[plane + 1] = volume[y, x, plane]
        total[y, x, plane] += volume[y, x, plane]
    y, x = y + dy, x + dx
    while 0 <= y < height and 0 <= x < width:
        carried += lean_across[y, x] * np.float32(dx) + lean_down[y, x] * np.float32(dy)
        shift = int(np.floor(carried + np.float32(0.5)))
        carried -= np.float32(shift)
        least = path[1]
        for plane in range(1, planes):
            least = min(least, path[plane + 1])
        edge = np.float32(0.0)
        for colour in range(3):
            edge = max(edge, abs(picture[y, x, colour] - picture[y - dy, x - dx, colour]))
        kept = np.float32(EDGE_LEAST) + np.float32(1.0 - EDGE_LEAST) * np.exp(edge * np.float32(-1.0 / EDGE_GREY))
        penalty = np.uint16(max(np.float32(LEAST_RATIO) * np.float32(next_plane), np.float32(any_plane) * kept))
        if shift == 0:
            for plane in range(planes):
                step = min(path[plane], path[plane + 2]) + next_plane
                best = min(path[plane + 1], step, least + penalty)
                on[plane + 1] = np.uint16(volume[y, x, plane] + np.uint16(best - least))
        else:
            for plane in range(planes):
                source = plane - shift
                best = least + penalty
                if 0 <= source < planes:
                    best = min(best, path[source + 1])
                if -1 <= source < planes + 1:
                    if source >= 1:
                        best = min(best, path[source] + next_plane)
                    if source <= planes - 2:
                        best = min(best, path[source + 2] + next_plane)
                on[plane + 1] = np.uint16(volume[y, x, plane] + np.uint16(best - least))
        for plane in range(planes):
            path[plane + 1] = on[plane + 1]
            total[y, x, plane] += on[plane + 1]
        y, x = y + dy, x + dx


@compiled
def _paths(
    first: Any,
    last: Any,
    dy: Any,
    dx: Any,
    volume: Any,
    total: Any,
    picture: Any,
    lean_across: Any,
    lean_down: Any,
    next_plane: Any,
    any_plane: Any,
) -> None:
    """All lines `first` to `last` of one direction: from the first row, then from the first column."""
    height, width, planes = volume.shape
    path, on = np.empty(planes + 2, np.uint16), np.empty(planes + 2, np.uint16)
    for line in range(first, last):
        if dy == 0:
            y, x = line, 0 if dx > 0 else width - 1
        elif line < width:
            y, x = 0 if dy > 0 else height - 1, line
        else:
            x = 0 if dx > 0 else width - 1
            y = line - width + 1 if dy > 0 else height - 2 - (line - width)
        _path(volume, total, picture, lean_across, lean_down, y, x, dy, dx, next_plane, any_plane, path, on)


def aggregate(
    volume: Volume,
    picture: Float32,
    leans: tuple[Float32, Float32],
    penalties: tuple[int, int],
    run: Map = map,
) -> Volume:
    """The summed path costs (v, u, n) of a cost volume (v, u, n).

    Parameters
    ----------
    volume
        Matching costs; eight times (the largest + the second penalty) must fit 16 bits.
    picture
        Colours (v, u, 3) of the reference view, 0 to 255: where they change, surfaces may end.
    leans
        Planes (v, u) that the surface rises per pixel, across and down: a path follows them free of charge.
    penalties
        Of a step to the next plane, and of one to any other.
    run
        `map`, or that of a pool of threads.
    """
    height, width, _ = volume.shape
    total = np.zeros_like(volume)
    next_plane, any_plane = (np.uint16(penalty) for penalty in penalties)
    for dy, dx in WAYS:
        lines = height if dy == 0 else width if dx == 0 else width + height - 1
        jobs = [(first, min(first + LINES, lines)) for first in range(0, lines, LINES)]

        def fill(job: tuple[int, int], dy: int = dy, dx: int = dx) -> None:
            _paths(*job, dy, dx, volume, total, picture, *leans, next_plane, any_plane)

        list(run(fill, jobs))
    return total


@compiled
def _least(
    first: Any, last: Any, total: Any, volume: Any, doubtful: Any, best: Any, margin: Any, rivals: Any, mismatch: Any
) -> None:
    planes, one = total.shape[2], np.float32(1.0)
    for y in range(first, last):
        for x in range(total.shape[1]):
            at = 0
            for plane in range(1, planes):
                if total[y, x, plane] < total[y, x, at]:
                    at = plane
            place, least = np.float32(at), np.float32(total[y, x, at])
            if 0 < at < planes - 1:
                before, after = np.float32(total[y, x, at - 1]), np.float32(total[y, x, at + 1])
                bend = before + after - np.float32(2.0) * least
                if bend > 0:
                    place += np.float32(0.5) * (before - after) / bend
            other, near = np.float32(65535.0), np.float32(0.0)
            for plane in range(planes):
                if abs(plane - at) > SAME_PLANES:
                    cost = np.float32(total[y, x, plane])
                    other = min(other, cost)
                    dearer = (cost - least) / doubtful
                    near += max(one - dearer * dearer, np.float32(0.0)) ** 2
            mismatch[y, x] = np.float32(volume[y, x, at])
            best[y, x], margin[y, x], rivals[y, x] = place, other - least, near / np.float32(PLACE_PLANES)


@dataclass(frozen=True, eq=False)
class Cheapest:
    """The planes of least cost.

    Attributes
    ----------
    planes
        Plane (v, u), to part of one.
    margin
        By how much (v, u) the next best is dearer that is farther than SAME_PLANES away.
    rivals
        Number (v, u) of other places that are about as cheap, as a sum of weights.
    mismatch
        Matching cost (v, u) there, as a part of the largest that there is.
    """

    planes: Float32
    margin: Float32
    rivals: Float32
    mismatch: Float32


def cheapest(total: Volume, volume: Volume, doubtful: float, run: Map = map) -> Cheapest:
    """The planes of least summed path cost (v, u, n) of a volume of matching costs (v, u, n).

    A place that is dearer by `doubtful` is no rival.
    """
    found = Cheapest(*(np.empty(total.shape[:2], np.float32) for _ in range(4)))
    parts = (found.planes, found.margin, found.rivals, found.mismatch)
    list(run(lambda band: _least(*band, total, volume, np.float32(doubtful), *parts), bands(total.shape[0])))
    found.mismatch[:] = cv2.blur(found.mismatch, (MISMATCH_PX, MISMATCH_PX)) * np.float32(1.0 / (TRUNCATION * UNITS))
    return found


def leans_of(planes: Float32) -> tuple[Float32, Float32]:
    """Planes (v, u) that the surfaces of a map (v, u) rise per pixel, across and down: medians over a square."""
    result = []
    for axis in (1, 0):
        ahead, behind = (np.roll(planes, shift, axis) for shift in (-SLOPE_REACH_PX, SLOPE_REACH_PX))
        rise = (ahead - behind) * np.float32(0.5 / SLOPE_REACH_PX)
        coded = np.clip(rise * np.float32(127.0 / STEEPEST) + np.float32(128.5), 0.0, 255.0).astype(np.uint8)
        median: Any = cv2.medianBlur(coded, SLOPE_MEDIAN_PX).astype(np.float32)
        lean = (median - np.float32(128.0)) * np.float32(STEEPEST / 127.0)
        lean = cv2.blur(lean, (SLOPE_MEAN_PX, SLOPE_MEAN_PX))
        lean[np.abs(lean) < LEVEL] = 0.0
        result.append(np.asarray(lean, dtype=np.float32))
    return result[0], result[1]
