"""Super-resolution: the picture in finer pixels that explains best what shifted views show of one plane.

A pixel of a view is the light of the plane over its area, that is a weighted sum of finer pixels. The result minimises
the squared differences from all samples, in units of their noise, plus squared slopes, in units of those of usual
scenes (Elad and Feuer, Restoration of a single superresolution image from several blurred, noisy, and undersampled
measured images, IEEE Transactions on Image Processing 6(12), 1997), by conjugate gradients. Noise is measured: it is
the residual of a first picture, hardly smoothed. Least absolute differences in place of squares leave out objects that
few views show (Farsiu, Robinson, Elad and Milanfar, Fast and robust multiframe super resolution, IEEE Transactions on
Image Processing 13(10), 2004).

A finer pixel, too, is the light over its area: the picture is that of a camera with smaller pixels, no sharper. Where
the residuals of views exceed noise, the views do not show the plane, and the picture stays as it was at the start.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.render.linear_light import light_per_level

Float32 = NDArray[np.float32]
FIRST_STEPS, STEPS, ROUNDS = 6, 8, 2
"""Of conjugate gradients, for the picture that noise is measured with and in each round of the picture itself."""
SLOPE = 0.05
"""Root mean square slope of scenes, in grey levels, 1 of white, per pixel of a view."""
STEEP = 0.03
"""Slope in light per pixel of a view from which on it counts by its size, not its square: edges (Huber)."""
FIRST, LEAST, MOST = 1e-3, 1e-4, 0.1
"""Variance of noise over that of slopes: of the picture that noise is measured with, and its range."""
SQUARED = 2.0
"""Of least absolute differences, those below this number of standard deviations of noise count as squares."""
LEAST_NOISE = 1.0 / 255.0
DARK = 0.3
"""Light per grey level, at least: of black, rounding is larger than noise."""
IN_FOCUS = 0.2
"""Share of the samples, at least, that are taken to show the plane, for measuring noise."""
UNEXPLAINED = 6.0
"""Variance over that of noise from which on samples do not show the plane."""
SOME = 1e-6
FEWEST_FREE = 0.25
"""Share of samples, at least, that determine noise, not the picture."""
AROUND_PX = 2.5
"""Pixels of a view around one, over which what is left over is averaged."""
GROUPS = 4
"""Sums of views that are made side by side: as many on every machine, for the same rounding."""
AROUND, KAISER = 4, 4.0
"""Finer pixels that count around one of a view, and the parameter of their window."""
PHASES = 256


def super_resolved(
    views: Sequence[Float32],
    weights: Sequence[Float32],
    fine_from_view: Sequence[FloatArray],
    start: Float32,
    scale: float,
    *,
    least_absolute: bool = False,
) -> Float32:
    """The picture in finer pixels that explains the views.

    Parameters
    ----------
    views
        Light (v, u, c) of each view, float32.
    weights
        How much each of its samples counts, (v, u), float32.
    fine_from_view
        Matrices (3, 3) from pixels (u, v, 1) of each view to those of the picture, with w > 0 where it is seen.
    start
        Picture (h, w, c), float32, from which the search starts.
    scale
        Finer pixels along one of a view.
    least_absolute
        Whether absolute differences count in place of squares.

    Returns
    -------
    ndarray
        Picture (h, w, c), float32.
    """
    margin = pixel_taps(scale).shape[1] // 2 + 1
    pads = [(0, 0), (margin, margin), (margin, margin)]
    first = np.pad(np.moveaxis(start, -1, 0), pads, mode="edge").astype(np.float32)
    moved = np.eye(3)
    moved[:2, 2] = margin
    shown = [np.ascontiguousarray(np.moveaxis(view, -1, 0)) for view in views]
    with ThreadPoolExecutor(max(1, cv2.getNumThreads())) as pool:
        fit = _Fit(shown, list(weights), [moved @ matrix for matrix in fine_from_view], scale, pool)
        noise = fit.noise(fit.solved(first, fit.weights, FIRST, FIRST_STEPS, np.inf))
        smoothness = min(max((noise / SLOPE) ** 2, LEAST), MOST)
        picture, counts = first, fit.weights
        for number in range(ROUNDS):
            counts = fit.counted(picture, max(SQUARED * noise, LEAST_NOISE)) if least_absolute else fit.weights
            picture = fit.solved(picture, counts, smoothness, STEPS, STEEP if number else np.inf)
        picture = first + fit.explained(picture, first, counts, noise) * (picture - first)
    return np.ascontiguousarray(np.moveaxis(picture[:, margin:-margin, margin:-margin], 0, -1))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Views (c, v, u), weights (v, u) and matrices (3, 3) to pixels of a picture (c, h, w), fitted by threads."""

    views: list[Float32]
    weights: list[Float32]
    matrices: list[FloatArray]
    scale: float
    pool: ThreadPoolExecutor

    def solved(self, start: Float32, counts: list[Float32], smoothness: float, steps: int, large: float) -> Float32:
        """The picture of least squares of samples that count differently, by conjugate gradients from a start.

        Slopes of the start beyond a large one, in light per pixel of a view, count by their size.
        """
        smooth, edges = np.float32(smoothness * self.scale**2), steps_count(start, np.float32(large / self.scale))

        def normal(picture: Float32) -> Float32:
            shown = self._gathered(lambda number: self._seen(picture, number), counts, picture)
            return shown + smooth * roughness(picture, edges)

        found = start.copy()
        rest = self._gathered(lambda number: self.views[number], counts, start) - normal(found)
        way, left = rest.copy(), _dot(rest, rest)
        for _ in range(steps):
            if left == 0.0:
                break
            changed = normal(way)
            length = np.float32(left / _dot(way, changed))
            found += length * way
            rest -= length * changed
            now = _dot(rest, rest)
            way = rest + np.float32(now / left) * way
            left = now
        return found

    def noise(self, picture: Float32) -> float:
        """Standard deviation of grey levels about a picture that was fitted to them, where it explains them well."""

        def around(number: int) -> Float32:
            squares, size = self._squares(picture, number), (2 * round(AROUND_PX) + 1,) * 2
            there = ((self.weights[number] > 0) & (squares > 0)).astype(np.float32)
            share = cv2.blur(there, size)
            return np.asarray((cv2.blur(squares * there, size) / np.maximum(share, SOME))[there > 0], dtype=np.float32)

        every = np.concatenate(list(self.pool.map(around, range(len(self.views)))))
        if not len(every):
            return 0.0
        return float(np.sqrt(np.quantile(every, IN_FOCUS) / self._free(picture)))

    def _free(self, picture: Float32) -> float:
        """Share of the samples that determine noise: the finer pixels, as unknowns, absorb the rest."""
        samples = sum(float(weight.sum()) for weight in self.weights)
        return max(1.0 - picture[0].size / max(samples, 1.0), FEWEST_FREE)

    def counted(self, picture: Float32, small: float) -> list[Float32]:
        """Weights (v, u) of samples whose squares stand for absolute differences beyond a small one."""

        def of_view(number: int) -> Float32:
            apart = np.sqrt(self._squares(picture, number))
            return np.asarray(self.weights[number] * (small / np.maximum(apart, small)), dtype=np.float32)

        return list(self.pool.map(of_view, range(len(self.views))))

    def explained(self, picture: Float32, start: Float32, counts: list[Float32], noise: float) -> Float32:
        """Share (h, w) that a picture explains of what a start leaves over around each pixel beyond noise.

        It is the adjusted coefficient of determination, less noise: as many unknowns as finer pixels explain a part of
        anything. Where views do not show the plane of the picture, they explain little of each other.
        """
        size = (2 * round(AROUND_PX * self.scale) + 1,) * 2

        def gathered(shown: Callable[[int], Float32]) -> Float32:
            return np.asarray(cv2.blur(self._gathered(shown, counts, picture[:1])[0], size), dtype=np.float32)

        def left(picture: Float32) -> Float32:
            return gathered(lambda number: self._squares(picture, number)[None])

        free = np.float32(self._free(picture))
        after, before = left(picture) / free, left(start)
        alike = gathered(lambda number: np.ones_like(self.views[number][:1]))
        gained = np.maximum(before - after, 0.0)
        missed = np.maximum(after - np.float32(UNEXPLAINED * noise**2) * alike, 0.0)
        return np.divide(gained, gained + missed, out=np.ones_like(gained), where=missed > 0)

    def _seen(self, picture: Float32, number: int) -> Float32:
        there = np.full_like(self.views[number], np.nan)
        project(picture, self.matrices[number], pixel_taps(self.scale), there)
        return there

    def _squares(self, picture: Float32, number: int) -> Float32:
        """Mean square (v, u) over colours of the difference of a view from what it shows of a picture, grey levels."""
        view = self.views[number]
        rest = np.nan_to_num(view - self._seen(picture, number))
        around = np.asarray(cv2.blur(view.mean(axis=0), (3, 3)), dtype=np.float32)
        unit = np.maximum(light_per_level(around), np.float32(DARK))
        return np.asarray(np.square(rest).mean(axis=0) / np.square(unit), dtype=np.float32)

    def _gathered(self, shown: Callable[[int], Float32], counts: list[Float32], like: Float32) -> Float32:
        """Sum over the views of what goes back to a picture of what they show, (c, h, w)."""

        def of_group(group: int) -> Float32:
            added = np.zeros_like(like)
            for number in range(group, len(self.views), GROUPS):
                part = shown(number) * counts[number]
                back_project(part, self.matrices[number], pixel_taps(self.scale), added)
            return added

        groups = self.pool.map(of_group, range(min(GROUPS, len(self.views))))
        return np.asarray(functools.reduce(np.add, groups), dtype=np.float32)


def _dot(one: Float32, other: Float32) -> float:
    return float(np.sum(one * other, dtype=np.float64))


def roughness(picture: Float32, counts: tuple[Float32, Float32]) -> Float32:
    """Half the gradient (c, h, w) of the sum of squared steps between neighbours (c, h, w), which count differently.

    `counts` are those of the steps down (h - 1, w) and to the right (h, w - 1).
    """
    changes = np.zeros_like(picture)
    down, right = (counts[axis - 1] * np.diff(picture, axis=axis) for axis in (1, 2))
    changes[:, :-1] -= down
    changes[:, 1:] += down
    changes[:, :, :-1] -= right
    changes[:, :, 1:] += right
    return changes


def steps_count(picture: Float32, small: np.float32) -> tuple[Float32, Float32]:
    """How much steps count, down (h - 1, w) and to the right (h, w - 1): those beyond a small one by their size."""
    down, right = (np.sqrt(np.square(np.diff(picture, axis=axis)).mean(axis=0)) for axis in (1, 2))
    if np.isinf(small):
        return np.ones_like(down), np.ones_like(right)
    return small / np.maximum(down, np.float32(small)), small / np.maximum(right, np.float32(small))


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
