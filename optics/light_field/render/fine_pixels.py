"""Pixels of a view as weighted sums of finer pixels of a picture, and the transpose of these sums."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.values import FloatArray

Float32 = NDArray[np.float32]

AROUND, KAISER = 4, 4.0
"""Finer pixels that count around one of a view, and the parameter of their window."""
PHASES = 256


@cache
def pixel_taps(scale: float) -> Float32:
    """Weights (phases + 1, taps) of finer pixels in one of a view, along one axis.

    Row k is for a pixel of the view at k / phases between the finer pixels `taps` // 2 - 1 and `taps` // 2. Means over
    `scale` and over one finer pixel are sinc of the frequency: the ratio of the two, under Kaiser's window.
    """
    frequency = (np.arange(512) + 0.5) / 1024.0
    response = np.sinc(scale * frequency) / np.sinc(frequency)
    taps = 2 * int(np.ceil(scale)) + AROUND
    away = np.arange(taps) - (taps // 2 - 1) - (np.arange(PHASES + 1) / PHASES)[:, None]
    window = np.i0(KAISER * np.sqrt(1.0 - np.square(2.0 * away / taps)))
    weights = (np.cos(2.0 * np.pi * frequency * away[..., None]) * response).mean(axis=-1) * window
    return np.asarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float32)


@compiled
def _first_tap(u: int, v: int, matrix: FloatArray, taps: int, height: int, width: int) -> tuple[int, int, int, int]:
    """Column and row of the first tap of what a view's pixel shows, and the phases there; -1 where it looks beyond."""
    w = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]
    x = (matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]) / w - (taps // 2 - 1)
    y = (matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2]) / w - (taps // 2 - 1)
    if not (w > 0.0 and 0.0 <= x < width - taps and 0.0 <= y < height - taps):
        return -1, -1, 0, 0
    left, top = int(x), int(y)
    return left, top, int((x - left) * PHASES + 0.5), int((y - top) * PHASES + 0.5)


@compiled
def project(picture: Float32, matrix: FloatArray, table: Float32, shown: Float32) -> None:
    """Write what a view shows of a picture (c, h, w) to (c, v, u); where it looks beyond it, nothing is written."""
    channels, height, width = picture.shape
    taps = table.shape[1]
    row = np.zeros(taps, np.float32)
    for v in range(shown.shape[1]):
        for u in range(shown.shape[2]):
            left, top, phase_across, phase_down = _first_tap(u, v, matrix, taps, height, width)
            if left < 0:
                continue
            across, down = table[phase_across], table[phase_down]
            for c in range(channels):
                row[:] = 0.0
                for j in range(taps):
                    line = picture[c, top + j, left : left + taps]
                    for i in range(taps):
                        row[i] += down[j] * line[i]
                value = np.float32(0.0)
                for i in range(taps):
                    value += across[i] * row[i]
                shown[c, v, u] = value


@compiled
def back_project(shown: Float32, matrix: FloatArray, table: Float32, added: Float32) -> None:
    """Add to a picture (c, h, w) the transpose of `project` of what a view shows (c, v, u)."""
    channels, height, width = added.shape
    taps = table.shape[1]
    for v in range(shown.shape[1]):
        for u in range(shown.shape[2]):
            left, top, phase_across, phase_down = _first_tap(u, v, matrix, taps, height, width)
            if left < 0:
                continue
            across, down = table[phase_across], table[phase_down]
            for c in range(channels):
                value = shown[c, v, u]
                for j in range(taps):
                    line = added[c, top + j, left : left + taps]
                    part = value * down[j]
                    for i in range(taps):
                        line[i] += part * across[i]
