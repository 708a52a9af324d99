"""Convex polygons."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray


def clipped(polygon: FloatArray, heights: FloatArray) -> FloatArray:
    """The part of a convex polygon (n, 2) on the positive side of a line, by heights (n,) of its corners over it.

    (0, 2) where there is none.
    """
    points, kept = _cut(polygon, heights)
    return points[kept]


def each_clipped(polygons: FloatArray, heights: FloatArray) -> FloatArray:
    """The parts (m, most, 2) of convex polygons (m, n, 2) on the positive sides of lines, by heights (m, n) as above.

    Those with fewer corners than the most, which is 3 to n + 1, repeat their last, before and after; where nothing is
    left, all corners are zero.
    """
    points, kept = _cut(polygons, heights)
    count = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")
    place = np.minimum(np.arange(max(count.max(), 3)), np.maximum(count - 1, 0)[:, None])
    parts = np.take_along_axis(points, np.take_along_axis(order, place, axis=1)[..., None], axis=1)
    return np.asarray(np.where((count > 0)[:, None, None], parts, 0.0))


def _cut(polygons: FloatArray, heights: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Corners (..., 2 n, 2) that parts of polygons (..., n, 2) may have, in order, and the mask of those they have."""
    previous, before = np.roll(polygons, 1, axis=-2), np.roll(heights, 1, axis=-1)
    inside = heights > 0.0
    crosses = (before > 0.0) != inside
    drop = np.where(crosses, before - heights, 1.0)
    crossings = previous + (polygons - previous) * before[..., None] / drop[..., None]
    points = np.stack([crossings, polygons], axis=-2).reshape(*polygons.shape[:-2], -1, 2)
    return points, np.stack([crosses, inside], axis=-1).reshape(*heights.shape[:-1], -1)
