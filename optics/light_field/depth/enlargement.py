"""Enlargement of a map to twice its size: by interpolation, or guided by the picture, which keeps depth edges sharp."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.processes.threads import MapFunction
from mirrorcam.optics.light_field.depth.cost import bands

Float32 = NDArray[np.float32]
COLOUR_GREY = 20.0
"""Sum of differences over three channels, 0 to 255, that lowers a neighbour's weight by a factor of e."""


def doubled(small: Float32, shape: tuple[int, int] | None) -> Float32:
    """Return a map (v, u) at twice the size; an odd last row or column repeats the previous one."""
    full = cv2.resize(small, (2 * small.shape[1], 2 * small.shape[0]), interpolation=cv2.INTER_LINEAR)
    if shape is None:
        return np.asarray(full)
    bottom, right = shape[0] - full.shape[0], shape[1] - full.shape[1]
    return np.asarray(cv2.copyMakeBorder(full, 0, bottom, 0, right, cv2.BORDER_REPLICATE))


@compiled
def _enlarge(first: int, last: int, planes: Float32, half: Float32, full: Float32, jump: float, out: Float32) -> None:
    rows, columns = planes.shape
    near, far = np.float32(0.75), np.float32(0.25)
    for y in range(first, last):
        j = min(y // 2, rows - 1)
        j_next = min(max(j + 2 * (y % 2) - 1, 0), rows - 1)
        for x in range(out.shape[1]):
            i = min(x // 2, columns - 1)
            i_next = min(max(i + 2 * (x % 2) - 1, 0), columns - 1)
            a, b, c, d = planes[j, i], planes[j, i_next], planes[j_next, i], planes[j_next, i_next]
            if max(a, b, c, d) - min(a, b, c, d) < jump:
                out[y, x] = near * (near * a + far * b) + far * (near * c + far * d)
                continue
            lowest = np.float32(np.inf)
            for row in range(max(j - 1, 0), min(j + 2, rows)):
                for column in range(max(i - 1, 0), min(i + 2, columns)):
                    difference = np.float32(0.0)
                    for colour in range(3):
                        difference += abs(half[row, column, colour] - full[y, x, colour])
                    dv, du = np.float32(2 * row - y) + np.float32(0.5), np.float32(2 * column - x) + np.float32(0.5)
                    cost = difference / np.float32(COLOUR_GREY) + (dv * dv + du * du) * far
                    if cost < lowest:
                        lowest = cost
                        out[y, x] = planes[row, column]


def enlarged_by_picture(planes: Float32, half: Float32, full: Float32, jump: float, run: MapFunction = map) -> Float32:
    """Return a map (v, u) at twice its size: interpolated on surfaces, and cut along the picture at depth edges.

    Where adjacent values differ by `jump` or more, a pixel takes the value of the nearby pixel of most similar colour.

    Parameters
    ----------
    planes
        The map at half size.
    half, full
        Colours (v, u, 3) of the picture, 0 to 255, at half size and at the full size, which may be odd.
    jump
        Smallest difference of adjacent values at a depth edge.
    run
        `map`, or the `map` of a thread pool.
    """
    out = np.empty(full.shape[:2], np.float32)
    list(run(lambda band: _enlarge(*band, planes, half, full, np.float32(jump), out), bands(len(out))))
    return out
