"""The planes of a sweep: where each view shows the pixels of the reference view, which views compete, and their costs.

Each pixel has costs of a range of planes of its own: near the depth known from a smaller picture, or all planes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth.parallax import other_views, parallax
from mirrorcam.optics.light_field.light_field import Views

Float32 = NDArray[np.float32]
DIRECTIONS = 16
"""Directions from the reference view that are distinguished: an occluder hides a place from neighbouring directions."""
MOST_RINGS = 4
Map = Callable[..., Any]
NOTHING = np.float32(-1e9)
"""Plane of what no pixel of the reference view is seen at: it hides nothing."""
TILE_PX = 8
"""Pixels of a tile of that side have the same range."""
AROUND_PX = 8
"""What is known within that distance of the tile is searched, too: edges are found anew."""
MARGIN_PLANES = 6
"""Planes that are searched nearer and farther than what is known."""
FEWEST_PLANES = 3


class PlaneMotion(NamedTuple):
    """Where K views show the planes of a sweep, and which of them compete.

    Plane i shows pixel (u, v) of the reference view at (scale u + across, scale v + down) of view k.

    Attributes
    ----------
    scale, across, down : ndarray of float32
        (n, K).
    sector : ndarray of int64
        (K,): views at like distance from the reference view form a ring, those of one ring in like direction a sector.
    rings : ndarray of int64
        (r + 1,): the first sector of each ring, and the number of sectors.
    """

    scale: Float32
    across: Float32
    down: Float32
    sector: NDArray[np.int64]
    rings: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Sweep:
    """Planes across the view axis, evenly spaced in inverse distance, seen by the K views other than the reference.

    Attributes
    ----------
    inverse_distances : ndarray
        (n,), 1/mm from the reference view.
    motion : Motion
        Where the views show the planes.
    reach_px : float
        Px that the farthest view moves from one plane to the next.
    """

    inverse_distances: FloatArray
    motion: PlaneMotion
    reach_px: float

    @property
    def planes(self) -> int:
        """Number of planes."""
        return len(self.inverse_distances)

    @property
    def step(self) -> float:
        """Inverse distance from one plane to the next, 1/mm."""
        return float(self.inverse_distances[1] - self.inverse_distances[0])

    def inverse_distance(self, planes: Float32) -> Float32:
        """Inverse distances of places between planes, counted from the first plane."""
        return np.asarray(planes * np.float32(self.step) + np.float32(self.inverse_distances[0]))


def sweep(views: Views, inverse_distances: FloatArray) -> Sweep:
    """The sweep of views over planes at inverse distances (n,) from the reference view, evenly spaced."""
    others = other_views(views)
    matrices = np.array([[parallax(views, index).affine(q) for index in others] for q in inverse_distances])
    positions = np.array([views.positions_mm[index] for index in others])
    far = np.abs(positions[:, :2]).max(axis=1)
    share = far / far.max()
    rings = min(MOST_RINGS, len(np.unique(np.round(share, 2))))
    angle = np.arctan2(positions[:, 1], positions[:, 0])
    ring = np.clip(np.ceil(share * rings - 1e-6).astype(np.int64) - 1, 0, rings - 1)
    direction = np.round(angle / (2.0 * np.pi / DIRECTIONS)).astype(np.int64) % DIRECTIONS
    sectors, sector = np.unique(ring * DIRECTIONS + direction, return_inverse=True)
    step = float(inverse_distances[1] - inverse_distances[0])
    scale, across, down = (
        np.ascontiguousarray(matrices[:, :, row, column], np.float32) for row, column in ((0, 0), (0, 2), (1, 2))
    )
    motion = PlaneMotion(
        scale,
        across,
        down,
        sector.astype(np.int64),
        np.searchsorted(sectors, np.arange(rings + 1) * DIRECTIONS).astype(np.int64),
    )
    return Sweep(np.asarray(inverse_distances, dtype=np.float64), motion, float(views.focal_px * far.max() * step))


@compiled
def _splat(planes: Float32, scale: Float32, across: Float32, down: Float32, out: Float32) -> None:
    """The nearest of the surfaces that land in each pixel (v, u) of a view, and single gaps between two closed."""
    height, width = planes.shape
    last = len(scale) - 1
    for y in range(height):
        for x in range(width):
            plane = planes[y, x]
            lower = min(max(int(np.floor(plane)), 0), last - 1)
            part = plane - np.float32(lower)
            stretch = scale[lower] + part * (scale[lower + 1] - scale[lower])
            column = stretch * np.float32(x) + across[lower] + part * (across[lower + 1] - across[lower])
            row = stretch * np.float32(y) + down[lower] + part * (down[lower + 1] - down[lower])
            u, v = int(np.floor(column + np.float32(0.5))), int(np.floor(row + np.float32(0.5)))
            if 0 <= u < width and 0 <= v < height and out[v, u] < plane:
                out[v, u] = plane
    for y in range(height):
        for x in range(1, width - 1):
            if out[y, x] == NOTHING and out[y, x - 1] > NOTHING and out[y, x + 1] > NOTHING:
                out[y, x] = min(out[y, x - 1], out[y, x + 1])


def nearest_planes(planes: Float32, sweep: Sweep, run: Map = map) -> Float32:
    """Plane (K, v, u), counted along a sweep, of the nearest surface in each view; NOTHING where there is none.

    `planes` (v, u) are those of the pixels of the reference view.
    """
    motion = sweep.motion
    views = motion.scale.shape[1]
    out = np.full((views, *planes.shape), NOTHING, np.float32)

    def fill(view: int) -> None:
        ways = (np.ascontiguousarray(way[:, view]) for way in (motion.scale, motion.across, motion.down))
        _splat(planes, *ways, out[view])

    list(run(fill, range(views)))
    return out


class Ranges(NamedTuple):
    """The planes that are searched at each pixel (v, u), tile by tile, and where their costs lie, one after the other.

    Attributes
    ----------
    low, planes
        First plane and number of planes, int32.
    start
        Index of the cost of the first plane, int64.
    """

    low: NDArray[np.int32]
    planes: NDArray[np.int32]
    start: NDArray[np.int64]

    @property
    def cells(self) -> int:
        """Number of costs."""
        return int(self.start[-1, -1] + self.planes[-1, -1])

    @classmethod
    def of(cls, low: NDArray[np.int32], count: NDArray[np.int32]) -> Ranges:
        """Ranges of given first planes and numbers of planes (v, u)."""
        ends = np.cumsum(count.ravel(), dtype=np.int64).reshape(count.shape)
        return cls(np.ascontiguousarray(low), np.ascontiguousarray(count), ends - count)


def whole_range(shape: tuple[int, int], planes: int) -> Ranges:
    """All planes at every pixel (v, u)."""
    return Ranges.of(np.zeros(shape, np.int32), np.full(shape, planes, np.int32))


def range_around(known: Float32, planes: int) -> Ranges:
    """The ranges near a map of planes (v, u), tile by tile, within the number of `planes` that there are."""
    side = TILE_PX + 2 * AROUND_PX
    # OpenCV's kernels of even sides reach one pixel farther up and left; tiles are sampled so that they are centred.
    height, width = known.shape
    rows, columns = -(-height // TILE_PX), -(-width // TILE_PX)
    grown = cv2.copyMakeBorder(
        known,
        AROUND_PX,
        rows * TILE_PX - height + AROUND_PX,
        AROUND_PX,
        columns * TILE_PX - width + AROUND_PX,
        cv2.BORDER_REPLICATE,
    )
    kernel = np.ones((side, side), np.uint8)
    nearest = cv2.dilate(grown, kernel, anchor=(0, 0))[::TILE_PX, ::TILE_PX][:rows, :columns]
    farthest = cv2.erode(grown, kernel, anchor=(0, 0))[::TILE_PX, ::TILE_PX][:rows, :columns]
    low = np.clip(np.floor(farthest) - MARGIN_PLANES, 0, planes - FEWEST_PLANES).astype(np.int32)
    high = np.clip(np.ceil(nearest) + (MARGIN_PLANES + 1), low + FEWEST_PLANES, planes).astype(np.int32)

    def each(tiles: NDArray[np.int32]) -> NDArray[np.int32]:
        return np.repeat(np.repeat(tiles, TILE_PX, axis=0), TILE_PX, axis=1)[:height, :width]

    return Ranges.of(each(low), each(high - low))


@dataclass(frozen=True, eq=False)
class Volume:
    """Costs (cells,), uint16, of the planes of ranges."""

    ranges: Ranges
    costs: NDArray[np.uint16]

    @classmethod
    def empty(cls, ranges: Ranges) -> Volume:
        """Costs to be filled in."""
        return cls(ranges, np.empty(ranges.cells, np.uint16))
