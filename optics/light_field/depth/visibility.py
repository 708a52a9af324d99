"""Which surfaces the other views see, by a depth map of the reference view."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.depth.sweep import Sweep

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

NOTHING = np.float32(-1e9)
"""Plane of what no pixel of the reference view is seen at: it hides nothing."""


@compiled
def _splat(planes: Any, scale: Any, across: Any, down: Any, out: Any) -> None:
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
