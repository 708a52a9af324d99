"""Convex polygons."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.base.values import FloatArray


def clipped(polygon: FloatArray, heights: FloatArray) -> FloatArray:
    """The part of a convex polygon (n, 2) on the positive side of a line, by heights (n,) of its corners over it.

    (0, 2) where there is none.
    """
    kept: list[FloatArray] = []
    for k in range(len(polygon)):
        here, following = heights[k - 1], heights[k]
        if (here > 0.0) != (following > 0.0):
            kept.append(polygon[k - 1] + (polygon[k] - polygon[k - 1]) * here / (here - following))
        if following > 0.0:
            kept.append(polygon[k])
    return np.array(kept).reshape(-1, 2)
