"""Holes in maps of nearness that were carried from one view to another: filled from what lies behind."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


def filled(nearness: Float32, alike: float) -> Float32:
    """A map (v, u) of 1 / Z whose holes, NaN, hold what lies behind.

    A hole opens where something nearer has moved away from what it hid. So of the nearest pixels to its left, right,
    top and bottom, the farthest counts, and those that differ from it by less than `alike`, by how close they are.
    Towards a border of the picture, where one of two ends is missing, the nearest pixel goes on. A crack between pixels
    that have moved apart belongs to the farther. Raises ValueError for a map of nothing but holes.
    """
    if np.isnan(nearness).all():
        raise ValueError("a map of holes, expected some pixel to fill them from")
    nearness = _without_cracks(nearness)
    while (holes := np.isnan(nearness)).any():
        found = [_beside(nearness, axis, forward=way) for axis in (0, 1) for way in (True, False)]
        values = np.stack([value[holes] for value, _ in found])
        away = np.stack([distance[holes] for _, distance in found])
        there = ~np.isnan(values)
        lines = there.reshape(2, 2, -1)
        # An end that is missing is the picture's border.
        closed = (lines[:, 0] == lines[:, 1]).all(axis=0)
        farthest = np.where(there, values, np.inf).min(axis=0)
        nearest = np.where(there, away, np.inf).min(axis=0)
        chosen = there & np.where(closed, values <= farthest + alike, away <= nearest)
        counts = np.where(chosen, 1.0 / away, 0.0)
        total = counts.sum(axis=0)
        mean = np.divide((np.where(there, values, 0.0) * counts).sum(axis=0), total, where=total > 0, out=total.copy())
        nearness = nearness.copy()
        nearness[holes] = np.where(total > 0, mean, np.nan)
    return nearness


def _without_cracks(nearness: Float32) -> Float32:
    """The map with single pixels between two known ones filled by the farther."""
    for axis in (0, 1):
        length = nearness.shape[axis]
        if length < 3:
            continue
        before, here, after = (np.take(nearness, np.arange(k, length - 2 + k), axis=axis) for k in (0, 1, 2))
        nearness = nearness.copy()
        inner = (slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))
        nearness[inner] = np.where(np.isnan(here), np.minimum(before, after), here)
    return nearness


def _beside(nearness: Float32, axis: int, *, forward: bool) -> tuple[Float32, Float32]:
    """The last known value before each pixel along an axis, or the first after it, and how far it is; NaN without."""
    lines = np.moveaxis(nearness, axis, 1)
    lines = lines if forward else lines[:, ::-1]
    columns = np.arange(lines.shape[1])
    last = np.maximum.accumulate(np.where(np.isnan(lines), -1, columns), axis=1)
    value = np.take_along_axis(lines, np.maximum(last, 0), axis=1)
    value = np.where(last >= 0, value, np.float32(np.nan))
    distance = (columns - last).astype(np.float32)
    if not forward:
        value, distance = value[:, ::-1], distance[:, ::-1]
    return np.moveaxis(value, 1, axis), np.moveaxis(distance, 1, axis)
