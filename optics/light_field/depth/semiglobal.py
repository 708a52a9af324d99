"""Semi-global aggregation of a cost volume along four directions (Hirschmueller, PAMI 30(2), 2008)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Cost = NDArray[np.uint16]
Map = Callable[..., Any]


def _add_paths(volume: Cost, total: Cost, next_plane: int, any_plane: int, order: range) -> None:
    """Add to `total` the costs of the cheapest paths through `volume` (rows, planes, columns), row after row."""
    path, dearer, on = (np.empty_like(volume[0]) for _ in range(3))
    path[:] = volume[order[0]]
    total[order[0]] += path
    for row in order[1:]:
        least = path.min(axis=0)
        np.minimum(path, least + np.uint16(any_plane), out=on)
        np.add(path, np.uint16(next_plane), out=dearer)
        np.minimum(on[1:], dearer[:-1], out=on[1:])
        np.minimum(on[:-1], dearer[1:], out=on[:-1])
        on -= least
        np.add(on, volume[row], out=path)
        total[row] += path


def _turned(volume: Cost) -> Cost:
    """The volume (u, n, v) of one of (v, n, u)."""
    rows, planes, columns = volume.shape
    turned = np.empty((columns, planes, rows), np.uint16)
    for plane in range(planes):
        cv2.transpose(volume[:, plane], turned[:, plane])
    return turned


def aggregate(volume: Cost, next_plane: int, any_plane: int, run: Map = map) -> Cost:
    """The summed path costs (v, n, u) of a cost volume (v, n, u): along rows and columns, both ways.

    Parameters
    ----------
    volume
        Matching costs (v, n, u); four times (the largest + `any_plane`) must fit 16 bits.
    next_plane
        Penalty of a step to a neighbouring plane.
    any_plane
        Penalty of a step to any other plane.
    run
        `map`, or that of a pool of threads.
    """
    rows, _, columns = volume.shape
    across = _turned(volume)
    sums = [np.zeros_like(volume), np.zeros_like(volume), np.zeros_like(across), np.zeros_like(across)]
    volumes = (volume, volume, across, across)
    ways = (range(rows), range(rows - 1, -1, -1), range(columns), range(columns - 1, -1, -1))
    list(run(_add_paths, volumes, sums, (next_plane,) * 4, (any_plane,) * 4, ways))
    sums[2] += sums[3]
    total = _turned(sums[2])
    total += sums[0]
    total += sums[1]
    return total
