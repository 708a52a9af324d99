"""Super-resolution: the picture with finer pixels that best explains shifted views of one plane.

A view's pixel integrates the light of the plane over its area, i.e. a weighted sum of finer pixels. The result
minimises the squared differences from all samples, in units of their noise, plus squared gradients, in units of typical
scenes (Elad and Feuer, Restoration of a single superresolution image from several blurred, noisy, and undersampled
measured images, IEEE Transactions on Image Processing 6(12), 1997), by conjugate gradients. The noise is the residual
of a first, weakly smoothed picture. Absolute instead of squared differences remove objects that few views show (Farsiu,
Robinson, Elad and Milanfar, Fast and robust multiframe super resolution, IEEE Transactions on Image Processing 13(10),
2004).

A finer pixel also integrates light over its area: the picture equals a picture by a camera with smaller pixels, without
further sharpening. Where the views' residuals exceed noise, they do not show the plane, and the initial picture is
kept.
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
"""Conjugate gradient steps for the picture that gives the noise, steps per round, and number of rounds."""
TYPICAL_GRADIENT = 0.05
"""Typical RMS gradient of scenes, in grey levels (white is 1) per pixel of a view."""
EDGE_GRADIENT = 0.03
"""Gradient, in light per pixel of a view, above which the penalty is linear, as at edges (Huber)."""
FIRST_SMOOTHNESS, MIN_SMOOTHNESS, MAX_SMOOTHNESS = 1e-3, 1e-4, 0.1
"""Ratio of the variances of noise and gradients: for the first picture, and the range of its estimate."""
SQUARED_SIGMAS = 2.0
"""With absolute differences, multiple of the noise below which the penalty is quadratic."""
MIN_NOISE = 1.0 / 255.0
MIN_LIGHT_PER_LEVEL = 0.3
"""Minimum derivative of light with respect to grey level: near black, rounding exceeds noise."""
IN_FOCUS_FRACTION = 0.2
"""Assumed minimum fraction of the samples that show the plane, for measuring noise."""
UNEXPLAINED = 6.0
"""Variance, relative to noise, above which samples do not show the plane."""
EPSILON = 1e-6
MIN_FREE_FRACTION = 0.25
"""Minimum fraction of samples that determine noise rather than the picture."""
AVERAGE_PX = 2.5
"""Radius, in pixels of a view, over which residuals are averaged."""
GROUPS = 4
"""Number of partial sums of views: the same on every machine, for the same rounding."""
EXTRA_TAPS, KAISER = 4, 4.0
"""Additional taps of the pixel kernel, and the parameter of its Kaiser window."""
PHASES = 256


def super_resolve(
    views: Sequence[Float32],
    weights: Sequence[Float32],
    fine_from_view: Sequence[FloatArray],
    start: Float32,
    scale: float,
    *,
    absolute: bool = False,
) -> Float32:
    """Compute the picture with finer pixels that best explains the views.

    Parameters
    ----------
    views
        Light (v, u, c) of each view, float32.
    weights
        Weight (v, u) of each sample, float32.
    fine_from_view
        Homographies (3, 3) from pixels (u, v, 1) of each view to pixels of the picture, with w > 0 where visible.
    start
        Initial picture (h, w, c), float32.
    scale
        Finer pixels per pixel of a view.
    absolute
        Whether to minimise absolute instead of squared differences.

    Returns
    -------
    ndarray
        Picture (h, w, c), float32.
    """
    margin = pixel_taps(scale).shape[1] // 2 + 1
    pads = [(0, 0), (margin, margin), (margin, margin)]
    first = np.pad(np.moveaxis(start, -1, 0), pads, mode="edge").astype(np.float32)
    margin_shift = np.eye(3)
    margin_shift[:2, 2] = margin
    predicted = [np.ascontiguousarray(np.moveaxis(view, -1, 0)) for view in views]
    with ThreadPoolExecutor(max(1, cv2.getNumThreads())) as pool:
        fit = _Fit(predicted, list(weights), [margin_shift @ matrix for matrix in fine_from_view], scale, pool)
        noise = fit.noise(fit.solve(first, fit.weights, FIRST_SMOOTHNESS, FIRST_STEPS, np.inf))
        smoothness = min(max((noise / TYPICAL_GRADIENT) ** 2, MIN_SMOOTHNESS), MAX_SMOOTHNESS)
        picture, sample_weights = first, fit.weights
        for index in range(ROUNDS):
            sample_weights = (
                fit.robust_weights(picture, max(SQUARED_SIGMAS * noise, MIN_NOISE)) if absolute else fit.weights
            )
            picture = fit.solve(picture, sample_weights, smoothness, STEPS, EDGE_GRADIENT if index else np.inf)
        picture = first + fit.explained_fraction(picture, first, sample_weights, noise) * (picture - first)
    return np.ascontiguousarray(np.moveaxis(picture[:, margin:-margin, margin:-margin], 0, -1))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Views (c, v, u), weights (v, u) and homographies (3, 3) to pixels of a picture (c, h, w), fitted in threads."""

    views: list[Float32]
    weights: list[Float32]
    matrices: list[FloatArray]
    scale: float
    pool: ThreadPoolExecutor

    def solve(
        self, start: Float32, sample_weights: list[Float32], smoothness: float, steps: int, threshold: float
    ) -> Float32:
        """Return the least-squares picture for `sample_weights`, by conjugate gradients from `start`.

        Gradients of `start` above `threshold`, in light per pixel of a view, are penalised linearly.
        """
        weight = np.float32(smoothness * self.scale**2)
        edges = huber_weights(start, np.float32(threshold / self.scale))

        def normal(picture: Float32) -> Float32:
            predicted = self._back_project_all(lambda index: self._predict(picture, index), sample_weights, picture)
            return predicted + weight * half_gradient(picture, edges)

        x = start.copy()
        r = self._back_project_all(lambda index: self.views[index], sample_weights, start) - normal(x)
        p, rr = r.copy(), _dot(r, r)
        for _ in range(steps):
            if rr == 0.0:
                break
            ap = normal(p)
            alpha = np.float32(rr / _dot(p, ap))
            x += alpha * p
            r -= alpha * ap
            rr_before, rr = rr, _dot(r, r)
            p = r + np.float32(rr / rr_before) * p
        return x

    def noise(self, picture: Float32) -> float:
        """Return the standard deviation of grey levels from a fitted picture, where it explains them well."""

        def local_means(index: int) -> Float32:
            squares, size = self._squares(picture, index), (2 * round(AVERAGE_PX) + 1,) * 2
            valid = ((self.weights[index] > 0) & (squares > 0)).astype(np.float32)
            fraction = cv2.blur(valid, size)
            return np.asarray(
                (cv2.blur(squares * valid, size) / np.maximum(fraction, EPSILON))[valid > 0], dtype=np.float32
            )

        averages = np.concatenate(list(self.pool.map(local_means, range(len(self.views)))))
        if not len(averages):
            return 0.0
        return float(np.sqrt(np.quantile(averages, IN_FOCUS_FRACTION) / self._free_fraction(picture)))

    def _free_fraction(self, picture: Float32) -> float:
        """Return the fraction of the samples that determine noise: the finer pixels, as unknowns, use up the rest."""
        samples = sum(float(weight.sum()) for weight in self.weights)
        return max(1.0 - picture[0].size / max(samples, 1.0), MIN_FREE_FRACTION)

    def robust_weights(self, picture: Float32, threshold: float) -> list[Float32]:
        """Return weights (v, u) of samples with which squares equal absolute differences above `threshold`."""

        def of_view(index: int) -> Float32:
            differences = np.sqrt(self._squares(picture, index))
            return np.asarray(self.weights[index] * (threshold / np.maximum(differences, threshold)), dtype=np.float32)

        return list(self.pool.map(of_view, range(len(self.views))))

    def explained_fraction(
        self, picture: Float32, start: Float32, sample_weights: list[Float32], noise: float
    ) -> Float32:
        """Return the fraction (h, w) of the residual of `start` near each pixel, beyond noise, that `picture` explains.

        It is the adjusted coefficient of determination, corrected for noise: with one unknown per finer pixel, any data
        are partly explained. Views that do not show the plane of the picture explain little of each other.
        """
        size = (2 * round(AVERAGE_PX * self.scale) + 1,) * 2

        def local_sum(predicted: Callable[[int], Float32]) -> Float32:
            return np.asarray(
                cv2.blur(self._back_project_all(predicted, sample_weights, picture[:1])[0], size), dtype=np.float32
            )

        def residual(picture: Float32) -> Float32:
            return local_sum(lambda index: self._squares(picture, index)[None])

        free = np.float32(self._free_fraction(picture))
        after, before = residual(picture) / free, residual(start)
        sample_count = local_sum(lambda index: np.ones_like(self.views[index][:1]))
        gain = np.maximum(before - after, 0.0)
        loss = np.maximum(after - np.float32(UNEXPLAINED * noise**2) * sample_count, 0.0)
        return np.divide(gain, gain + loss, out=np.ones_like(gain), where=loss > 0)

    def _predict(self, picture: Float32, index: int) -> Float32:
        prediction = np.full_like(self.views[index], np.nan)
        project(picture, self.matrices[index], pixel_taps(self.scale), prediction)
        return prediction

    def _squares(self, picture: Float32, index: int) -> Float32:
        """Return the mean square (v, u) over colours of a view's difference from its prediction, in grey levels."""
        view = self.views[index]
        residual = np.nan_to_num(view - self._predict(picture, index))
        local_mean = np.asarray(cv2.blur(view.mean(axis=0), (3, 3)), dtype=np.float32)
        unit = np.maximum(light_per_level(local_mean), np.float32(MIN_LIGHT_PER_LEVEL))
        return np.asarray(np.square(residual).mean(axis=0) / np.square(unit), dtype=np.float32)

    def _back_project_all(
        self, predicted: Callable[[int], Float32], sample_weights: list[Float32], like: Float32
    ) -> Float32:
        """Return the sum over the views of the back-projection (c, h, w) of their weighted data."""

        def of_group(group: int) -> Float32:
            out = np.zeros_like(like)
            for index in range(group, len(self.views), GROUPS):
                part = predicted(index) * sample_weights[index]
                back_project(part, self.matrices[index], pixel_taps(self.scale), out)
            return out

        groups = self.pool.map(of_group, range(min(GROUPS, len(self.views))))
        return np.asarray(functools.reduce(np.add, groups), dtype=np.float32)


def _dot(a: Float32, b: Float32) -> float:
    return float(np.sum(a * b, dtype=np.float64))


def half_gradient(picture: Float32, weights: tuple[Float32, Float32]) -> Float32:
    """Return half the gradient (c, h, w) of the weighted sum of squared differences between adjacent pixels.

    `weights` are those of the differences downwards (h - 1, w) and to the right (h, w - 1).
    """
    changes = np.zeros_like(picture)
    down, right = (weights[axis - 1] * np.diff(picture, axis=axis) for axis in (1, 2))
    changes[:, :-1] -= down
    changes[:, 1:] += down
    changes[:, :, :-1] -= right
    changes[:, :, 1:] += right
    return changes


def huber_weights(picture: Float32, threshold: np.float32) -> tuple[Float32, Float32]:
    """Return Huber weights of differences downwards (h - 1, w) and to the right (h, w - 1)."""
    down, right = (np.sqrt(np.square(np.diff(picture, axis=axis)).mean(axis=0)) for axis in (1, 2))
    if np.isinf(threshold):
        return np.ones_like(down), np.ones_like(right)
    limit = np.float32(threshold)
    return threshold / np.maximum(down, limit), threshold / np.maximum(right, limit)


@cache
def pixel_taps(scale: float) -> Float32:
    """Return the weights (phases + 1, taps) of finer pixels in a pixel of a view, along one axis.

    Row k is for a view's pixel at k / phases between the finer pixels `taps` // 2 - 1 and `taps` // 2. Averaging over
    `scale` or over one finer pixel is a sinc in frequency: the kernel is the ratio of both, with a Kaiser window.
    """
    frequency = (np.arange(512) + 0.5) / 1024.0
    response = np.sinc(scale * frequency) / np.sinc(frequency)
    taps = 2 * int(np.ceil(scale)) + EXTRA_TAPS
    offsets = np.arange(taps) - (taps // 2 - 1) - (np.arange(PHASES + 1) / PHASES)[:, None]
    window = np.i0(KAISER * np.sqrt(1.0 - np.square(2.0 * offsets / taps)))
    weights = (np.cos(2.0 * np.pi * frequency * offsets[..., None]) * response).mean(axis=-1) * window
    return np.asarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float32)


@compiled
def _first_tap(u: int, v: int, matrix: FloatArray, taps: int, height: int, width: int) -> tuple[int, int, int, int]:
    """Return column, row and phases of the first tap of a view's pixel; -1 where it lies outside the picture."""
    w = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]
    x = (matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]) / w - (taps // 2 - 1)
    y = (matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2]) / w - (taps // 2 - 1)
    if not (w > 0.0 and 0.0 <= x < width - taps and 0.0 <= y < height - taps):
        return -1, -1, 0, 0
    left, top = int(x), int(y)
    return left, top, int((x - left) * PHASES + 0.5), int((y - top) * PHASES + 0.5)


@compiled
def project(picture: Float32, matrix: FloatArray, table: Float32, predicted: Float32) -> None:
    """Write a view's prediction (c, v, u) from a picture (c, h, w); pixels outside the picture are not written."""
    channels, height, width = picture.shape
    taps = table.shape[1]
    row = np.zeros(taps, np.float32)
    for v in range(predicted.shape[1]):
        for u in range(predicted.shape[2]):
            left, top, phase_u, phase_v = _first_tap(u, v, matrix, taps, height, width)
            if left < 0:
                continue
            taps_u, taps_v = table[phase_u], table[phase_v]
            for c in range(channels):
                row[:] = 0.0
                for j in range(taps):
                    line = picture[c, top + j, left : left + taps]
                    for i in range(taps):
                        row[i] += taps_v[j] * line[i]
                value = np.float32(0.0)
                for i in range(taps):
                    value += taps_u[i] * row[i]
                predicted[c, v, u] = value


@compiled
def back_project(data: Float32, matrix: FloatArray, table: Float32, out: Float32) -> None:
    """Add to a picture (c, h, w) the transpose of `project`, applied to a view's data (c, v, u)."""
    channels, height, width = out.shape
    taps = table.shape[1]
    for v in range(data.shape[1]):
        for u in range(data.shape[2]):
            left, top, phase_u, phase_v = _first_tap(u, v, matrix, taps, height, width)
            if left < 0:
                continue
            taps_u, taps_v = table[phase_u], table[phase_v]
            for c in range(channels):
                value = data[c, v, u]
                for j in range(taps):
                    line = out[c, top + j, left : left + taps]
                    part = value * taps_v[j]
                    for i in range(taps):
                        line[i] += part * taps_u[i]
