"""A plane sweep: where each view shows the reference view's pixels, which views are alternatives, and the cost volume.

Each pixel searches a range of planes of its own: near the depth known from a coarser pyramid level, or all planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.processes.threads import MapFunction
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth.parallax import other_views, parallax
from mirrorcam.optics.light_field.light_field import Views

Float32 = NDArray[np.float32]
DIRECTIONS = 16
"""Number of directions from the reference view: an occluder hides a point from adjacent directions."""
MAX_RINGS = 4
NO_SURFACE = np.float32(-1e9)
"""Plane of a pixel without a surface: it hides nothing."""
TILE_PX = 8
"""Side of a tile; all its pixels search the same range."""
NEIGHBOUR_PX = 4
"""Distance from a tile within which known depths are searched as well, so that depth edges can move."""
MARGIN_PLANES = 3
"""Planes searched beyond the known ones, nearer and farther."""
MIN_PLANES = 3
TRACKED_NEIGHBOUR_PX, TRACKED_MARGIN_PLANES = 2, 2
"""The same near depths that are nearly known: from the previous frame of a video, or an earlier search of a level."""
MAX_EXTRA_COSTS = 3.0
"""Ratio of all planes to those near known depths up to which all are searched: wires too thin for a coarser level."""


class PlaneMapping(NamedTuple):
    """Where K views show the planes of a sweep, and which views are alternatives if some are occluded.

    Plane i shows pixel (u, v) of the reference view at (scale u + offset_u, scale v + offset_v) of view k.

    Attributes
    ----------
    scale, offset_u, offset_v : ndarray of float32
        (n, K).
    sector : ndarray of int64
        (K,): views at a similar distance from the reference view form a ring; those of a ring in a similar direction, a
        sector.
    rings : ndarray of int64
        (r + 1,): first sector of each ring, and number of sectors.
    """

    scale: Float32
    offset_u: Float32
    offset_v: Float32
    sector: NDArray[np.int64]
    rings: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Sweep:
    """Planes perpendicular to the view axis, evenly spaced in inverse distance, for the K other views.

    Attributes
    ----------
    inverse_distances : ndarray
        (n,), 1/mm from the reference view.
    mapping : PlaneMapping
        Mapping of the planes into the views.
    step_px : float
        Step of disparity at the longest baseline from plane to plane.
    """

    inverse_distances: FloatArray
    mapping: PlaneMapping
    step_px: float

    @property
    def plane_count(self) -> int:
        """Number of planes."""
        return len(self.inverse_distances)

    @property
    def step(self) -> float:
        """Inverse distance from one plane to the next, 1/mm."""
        return float(self.inverse_distances[1] - self.inverse_distances[0])

    def inverse_distance(self, planes: Float32) -> Float32:
        """Inverse distances, 1/mm, of fractional plane indices."""
        return np.asarray(planes * np.float32(self.step) + np.float32(self.inverse_distances[0]))

    def planes(self, inverse_distance: Float32) -> Float32:
        """Fractional plane indices of inverse distances, 1/mm."""
        return np.asarray((inverse_distance - np.float32(self.inverse_distances[0])) * np.float32(1.0 / self.step))


def sweep(views: Views, inverse_distances: FloatArray) -> Sweep:
    """Build the sweep of the other views over evenly spaced inverse distances (n,), in 1/mm from the reference view."""
    others = other_views(views)
    matrices = np.array([[parallax(views, index).affine(q) for index in others] for q in inverse_distances])
    positions = np.array([views.positions_mm[index] for index in others])
    distance = np.abs(positions[:, :2]).max(axis=1)
    relative_distance = distance / distance.max()
    rings = min(MAX_RINGS, len(np.unique(np.round(relative_distance, 2))))
    angle = np.arctan2(positions[:, 1], positions[:, 0])
    ring = np.clip(np.ceil(relative_distance * rings - 1e-6).astype(np.int64) - 1, 0, rings - 1)
    direction = np.round(angle / (2.0 * np.pi / DIRECTIONS)).astype(np.int64) % DIRECTIONS
    sectors, sector = np.unique(ring * DIRECTIONS + direction, return_inverse=True)
    step = float(inverse_distances[1] - inverse_distances[0])
    scale, offset_u, offset_v = (
        np.ascontiguousarray(matrices[:, :, row, column], np.float32) for row, column in ((0, 0), (0, 2), (1, 2))
    )
    mapping = PlaneMapping(
        scale,
        offset_u,
        offset_v,
        sector.astype(np.int64),
        np.searchsorted(sectors, np.arange(rings + 1) * DIRECTIONS).astype(np.int64),
    )
    return Sweep(
        np.asarray(inverse_distances, dtype=np.float64), mapping, float(views.focal_px * distance.max() * step)
    )


@compiled
def _splat(planes: Float32, scale: Float32, offset_u: Float32, offset_v: Float32, out: Float32) -> None:
    """Project the nearest surface into each pixel (v, u) of a view, and fill gaps of a single pixel."""
    height, width = planes.shape
    last = len(scale) - 1
    for y in range(height):
        for x in range(width):
            plane = planes[y, x]
            low = min(max(int(np.floor(plane)), 0), last - 1)
            fraction = plane - np.float32(low)
            magnification = scale[low] + fraction * (scale[low + 1] - scale[low])
            column = magnification * np.float32(x) + offset_u[low] + fraction * (offset_u[low + 1] - offset_u[low])
            row = magnification * np.float32(y) + offset_v[low] + fraction * (offset_v[low + 1] - offset_v[low])
            u, v = int(np.floor(column + np.float32(0.5))), int(np.floor(row + np.float32(0.5)))
            if 0 <= u < width and 0 <= v < height and out[v, u] < plane:
                out[v, u] = plane
    for y in range(height):
        for x in range(1, width - 1):
            if out[y, x] == NO_SURFACE and out[y, x - 1] > NO_SURFACE and out[y, x + 1] > NO_SURFACE:
                out[y, x] = min(out[y, x - 1], out[y, x + 1])


def nearest_planes(planes: Float32, sweep: Sweep, run: MapFunction = map) -> Float32:
    """Return the plane (K, v, u) of the nearest surface in each view; NO_SURFACE without one.

    `planes` (v, u) are the fractional plane indices of the reference view's pixels.
    """
    mapping = sweep.mapping
    views = mapping.scale.shape[1]
    out = np.full((views, *planes.shape), NO_SURFACE, np.float32)

    def fill(view: int) -> None:
        maps = (np.ascontiguousarray(values[:, view]) for values in (mapping.scale, mapping.offset_u, mapping.offset_v))
        _splat(planes, *maps, out[view])

    list(run(fill, range(views)))
    return out


class Ranges(NamedTuple):
    """Planes to search at each pixel (v, u), constant per tile, and the location of their costs in one array.

    Attributes
    ----------
    low, plane_count
        First plane and number of planes, int32.
    start
        Index of the cost of the first plane, int64.
    """

    low: NDArray[np.int32]
    plane_count: NDArray[np.int32]
    start: NDArray[np.int64]

    @property
    def size(self) -> int:
        """Number of costs."""
        return int(self.start[-1, -1] + self.plane_count[-1, -1])

    @classmethod
    def of(cls, low: NDArray[np.int32], count: NDArray[np.int32]) -> Ranges:
        """Build ranges from first planes and numbers of planes (v, u)."""
        ends = np.cumsum(count.ravel(), dtype=np.int64).reshape(count.shape)
        return cls(np.ascontiguousarray(low), np.ascontiguousarray(count), ends - count)


def full_range(shape: tuple[int, int], plane_count: int) -> Ranges:
    """All planes at every pixel (v, u)."""
    return Ranges.of(np.zeros(shape, np.int32), np.full(shape, plane_count, np.int32))


def range_around(known_planes: Float32, plane_count: int) -> Ranges:
    """Return the ranges near known planes (v, u), constant per tile and limited to `plane_count` planes."""
    return _ranges(known_planes, known_planes, plane_count, NEIGHBOUR_PX, MARGIN_PLANES)


def tracked_range(planes: Sequence[Float32], plane_count: int, unknown: NDArray[np.bool_] | None = None) -> Ranges:
    """Return the ranges near all of several maps of planes (v, u), all of them nearly known, for videos.

    Tiles near pixels that are `unknown` (v, u) get all planes.
    """
    nearest, farthest = np.maximum.reduce(planes), np.minimum.reduce(planes)
    if unknown is not None:
        nearest = np.where(unknown, np.float32(plane_count), nearest)
        farthest = np.where(unknown, np.float32(0.0), farthest)
    return _ranges(nearest, farthest, plane_count, TRACKED_NEIGHBOUR_PX, TRACKED_MARGIN_PLANES)


def _ranges(nearest: Float32, farthest: Float32, plane_count: int, neighbour_px: int, margin: int) -> Ranges:
    """Return ranges that hold the planes (v, u) of all pixels of a tile and near it, and a margin.

    All planes, if these are at most MAX_EXTRA_COSTS times as many.
    """
    # OpenCV's kernels of even side reach one pixel farther up and left, so the anchor centres them on the tiles.
    height, width = nearest.shape
    rows, columns = -(-height // TILE_PX), -(-width // TILE_PX)
    bottom, right = rows * TILE_PX - height, columns * TILE_PX - width
    border = neighbour_px, bottom + neighbour_px, neighbour_px, right + neighbour_px
    kernel = np.ones((TILE_PX + 2 * neighbour_px,) * 2, np.uint8)

    def largest(values: Float32) -> Float32:
        padded = cv2.copyMakeBorder(values, *border, cv2.BORDER_REPLICATE)
        return np.asarray(cv2.dilate(padded, kernel, anchor=(0, 0))[::TILE_PX, ::TILE_PX][:rows, :columns])

    low = np.clip(np.floor(-largest(-farthest)) - margin, 0, plane_count - MIN_PLANES).astype(np.int32)
    high = np.clip(np.ceil(largest(nearest)) + (margin + 1), low + MIN_PLANES, plane_count).astype(np.int32)

    def per_pixel(tiles: NDArray[np.int32]) -> NDArray[np.int32]:
        return np.repeat(np.repeat(tiles, TILE_PX, axis=0), TILE_PX, axis=1)[:height, :width]

    ranges, everything = Ranges.of(per_pixel(low), per_pixel(high - low)), full_range((height, width), plane_count)
    return everything if everything.size <= MAX_EXTRA_COSTS * ranges.size else ranges


@dataclass(frozen=True, eq=False)
class Volume:
    """Costs (ranges.size,), uint16, over the planes of ranges."""

    ranges: Ranges
    costs: NDArray[np.uint16]

    @classmethod
    def empty(cls, ranges: Ranges) -> Volume:
        """Costs to be filled in."""
        return cls(ranges, np.empty(ranges.size, np.uint16))
