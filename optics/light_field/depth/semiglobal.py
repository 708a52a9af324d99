"""Semi-global aggregation of a cost volume along eight directions (Hirschmueller, PAMI 30(2), 2008)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Cost = NDArray[np.uint16]
Map = Callable[..., object]


def _step(cost: Cost, before: Cost, small: int, jump: Cost) -> Cost:
    """Path costs (k, n, m) one pixel on: own cost plus the cheapest way from the pixel before (k, n, m).

    `small` is the price of a neighbouring plane and `jump` (..., m) that of any other one.
    """
    least = before.min(axis=-2, keepdims=True)
    on = np.minimum(before, least + jump)
    dearer = before + np.uint16(small)
    np.minimum(on[..., 1:, :], dearer[..., :-1, :], out=on[..., 1:, :])
    np.minimum(on[..., :-1, :], dearer[..., 1:, :], out=on[..., :-1, :])
    on -= least
    on += cost
    return on


def _sweep(volume: Cost, total: Cost, small: int, jump: Cost, diagonals: bool, order: range) -> None:
    """Add to `total` the path costs of `volume` (rows, planes, columns) from row to row in the given order."""
    count = 3 if diagonals else 1
    paths = np.repeat(volume[order[0]][None], count, axis=0)
    total[order[0]] += np.uint16(count) * volume[order[0]]
    for row in order[1:]:
        before = paths
        if diagonals:
            before = np.empty_like(paths)
            before[0] = paths[0]
            before[1, :, 1:], before[1, :, 0] = paths[1, :, :-1], paths[1, :, 0]
            before[2, :, :-1], before[2, :, -1] = paths[2, :, 1:], paths[2, :, -1]
        paths = _step(volume[row], before, small, jump[row])
        for path in paths:
            total[row] += path


def aggregate(volume: Cost, small: int, jump: Cost, run: Map = map) -> Cost:
    """The summed path costs (v, n, u) of a cost volume (v, n, u): eight paths to each pixel.

    Args:
        volume: matching costs; eight times (the largest + the largest `jump`) must fit 16 bits.
        small: price of going on to a neighbouring plane.
        jump: price (v, u) of going on to any other plane, at least `small`; less where the picture has an edge.
        run: `map`, or the one of a pool of threads.
    """
    rows, planes, columns = volume.shape
    across = np.empty((columns, planes, rows), np.uint16)
    for plane in range(planes):
        across[:, plane] = cv2.transpose(volume[:, plane])
    turned = np.ascontiguousarray(jump.T)
    parts = [np.zeros_like(volume), np.zeros_like(volume), np.zeros_like(across), np.zeros_like(across)]
    list(
        run(  # type: ignore[call-overload]
            _sweep,
            (volume, volume, across, across),
            parts,
            (small,) * 4,
            (jump, jump, turned, turned),
            (True, True, False, False),
            (range(rows), range(rows - 1, -1, -1), range(columns), range(columns - 1, -1, -1)),
        )
    )
    parts[2] += parts[3]
    total = parts[0]
    total += parts[1]
    for plane in range(planes):
        back: Any = cv2.transpose(parts[2][:, plane])
        total[:, plane] += back
    return total
