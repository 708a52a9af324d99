"""4-D filters of light fields in the frequency domain.

Views are padded by the maximum shift between two views in the passband, so that nothing wraps around. Samples beyond
the borders, missing samples, and the missing part of those with weights below 1 start from a guess and are replaced by
the filter's result from the others, in a few passes: expectation maximisation for missing data (Dempster, Laird and
Rubin, Journal of the Royal Statistical Society B 39, 1977).

At every frequency, the views form a vector v with covariance P S + N: S is the coherence of the passband, P the power
in the passband, and N the power of noise and everything else, which is independent between views. Both are measured
from the spectra in rings of equal frequency: for n views, E[v* v] = n P + n N and E[v* S v] = tr(S S) P + n N. The
linear estimate with the minimum squared error is then P S (P S + N)^-1 v (Wiener).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.filters.passband import Passband
from mirrorcam.optics.light_field.light_field import LightField

Float32 = NDArray[np.float32]
PASSES = 3
OUTLIER_PASSES = 12
OUTLIER_SIGMAS = 14.0
"""Residual, in robust standard deviations, at which a sample's weight falls to a quarter."""
MIN_VARIANCE = (1.0 / 255.0) ** 2
"""Minimum variance of residuals: below a grey level, residuals do not exceed rounding."""
MEDIAN_OF_SQUARES = {1: 0.455, 3: 2.366}
"""Medians of chi-squared distributions, by degrees of freedom."""
MARGIN_PX = 8
OPPONENT_FROM_RGB = (np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]]) / np.sqrt([[3], [2], [6]])).astype(np.float32)
"""Rotation from RGB to brightness and two colour differences: surfaces vary more in brightness, noise does not."""
Complex64 = NDArray[np.complex64]
RINGS = 48
MAX_BYTES = 60_000_000
"""Maximum bytes of coherences in memory at a time."""
MIN_EXCESS = 0.1
"""Minimum tr(S S) / n - 1 of a ring at which signal and noise can be separated."""
MIN_NOISE = 1e-5
"""Minimum noise relative to the signal's power, because coherences are singular."""
MAX_NOISE = 1e5


@dataclass(frozen=True, eq=False)
class Filtered:
    """A filtered light field.

    Attributes
    ----------
    light_field
        The result, with the geometry, weights and sample type of the input.
    outside
        RMS per sample, 0 to 1, of what contradicts the passband: noise, objects at other depths, occlusions and
        reflections.
    left_out
        Fraction of the samples with a weight below one half.
    """

    light_field: LightField
    outside: float
    left_out: float


def filter_light_field(light_field: LightField, passband: Passband, *, leave_out: bool = False) -> Filtered:
    """Keep the part of all views that lies in a passband, given the noise measured in the light field.

    Parameters
    ----------
    light_field
        Samples of views at any positions. Views in front of or behind the others are treated as coplanar: the result is
        then off by up to |z_i| |1 / Z - 1 / Z0| times the distance from the principal point.
    passband
        The passband, for these views.
    leave_out
        Whether samples far from the filter's result are treated as missing: rain, snow and particles in front of the
        depths that pass.

    Returns
    -------
    Filtered
        Every view, filtered; zero where the input has no sample.
    """
    grid, channels = light_field.samples.shape[:2], light_field.samples.shape[-1]
    is_bytes = light_field.samples.dtype == np.uint8
    samples: Any = light_field.samples.reshape(-1, *light_field.samples.shape[2:]).astype(np.float32)
    weights = np.minimum(light_field.weights.reshape(samples.shape[:3]), np.float32(1.0))
    rotation = OPPONENT_FROM_RGB if channels == 3 else np.ones((1, 1), np.float32)
    scale = np.float32(255.0 if is_bytes else 1.0)
    filtered, power, used = _filter(samples / scale @ rotation.T, weights, passband, leave_out)
    result: Any = np.clip(filtered @ rotation, 0.0, 1.0).reshape(*grid, *samples.shape[1:]) * scale
    result = np.where(light_field.valid[..., None], np.rint(result) if is_bytes else result, 0.0)
    present = weights > 0
    return Filtered(
        LightField.of(light_field, result.astype(light_field.samples.dtype), light_field.weights),
        float(np.sqrt(power.noise_of_sample / channels)),
        float((used[present] < 0.5 * weights[present]).mean()) if present.any() else 0.0,
    )


def _filter(samples: Float32, weights: Float32, passband: Passband, leave_out: bool) -> tuple[Float32, Power, Float32]:
    """Return filtered samples (n, v, u, c), the power of passband and rest, and the samples' weights (n, v, u)."""
    pads, crop = _padding(samples.shape[1:3], passband)
    original = _pad(samples, weights, pads)
    available = used = np.pad(weights, pads[:3])[..., None]
    frequencies = frequencies_of(*original.shape[1:3])
    phase_factors = np.exp(1j * passband.phases(frequencies)).astype(np.complex64)[..., None]
    filled = filtered = original
    last = (OUTLIER_PASSES if leave_out else PASSES) - 1
    for number in range(last + 1):
        if number:
            used = available * _inlier_weights(original, filtered, available) if leave_out else available
            filled = used * original + (1 - used) * filtered
        spectra = scipy.fft.rfft2(filled, axes=(1, 2), norm="ortho") * phase_factors
        vectors = np.moveaxis(spectra, 0, 2).reshape(-1, spectra.shape[0], spectra.shape[3])
        power = measure_power(vectors, passband, frequencies.reshape(-1, 2), float(used.mean()))
        passed = filtered_spectra(vectors, passband, frequencies.reshape(-1, 2), power)
        if number == last:
            # Remove noise only; missing samples were filled with the common part of the views.
            noise_fraction = power.noise_fractions[rings_of(frequencies.reshape(-1, 2))].astype(np.float32)
            passed = vectors + noise_fraction[:, None] * (passed - vectors)
        spectra = np.moveaxis(passed.reshape(*spectra.shape[1:3], *vectors.shape[1:]), 2, 0) * phase_factors.conj()
        filtered = scipy.fft.irfft2(spectra, original.shape[1:3], axes=(1, 2), norm="ortho").astype(np.float32)
    return filtered[:, *crop], power, used[:, *crop, 0]


def _padding(size: tuple[int, ...], passband: Passband) -> tuple[list[tuple[int, int]], tuple[slice, slice]]:
    """Return the padding of samples (n, v, u) for `np.pad`, and the location of the original samples in the result."""
    min_padding = int(np.ceil(passband.max_shift_px)) + MARGIN_PX
    sides = [scipy.fft.next_fast_len(side + 2 * min_padding, real=True) for side in size]
    padding = [(min_padding, side - length - min_padding) for side, length in zip(sides, size, strict=True)]
    rows, columns = (slice(min_padding, min_padding + length) for length in size)
    return [(0, 0), *padding], (rows, columns)


def _pad(samples: Float32, weights: Float32, pads: list[tuple[int, int]]) -> Float32:
    """Fill missing samples with a guess: the mean of views at a pixel, and beyond borders a ramp to the overall mean.

    Both ends of the padding have the same colour, so that wrapping around creates no edge.
    """
    weight = weights[..., None]
    total = weight.sum(axis=0)
    mean = (weight * samples).sum(axis=(0, 1, 2)) / max(float(weight.sum()), 1e-6)
    guess = np.where(total > 1e-3, (weight * samples).sum(axis=0) / np.maximum(total, 1e-3), mean)
    filled = weight * samples + (1 - weight) * guess
    ramps = [
        np.pad(filled[..., c], pads, mode="linear_ramp", end_values=float(mean[c])) for c in range(samples.shape[-1])
    ]
    return np.stack(ramps, axis=-1).astype(np.float32)


def _inlier_weights(original: Float32, filtered: Float32, available: Float32) -> Float32:
    """Return weights of samples (n, v, u, 1), 0 to 1, by their distance from the filtered ones."""
    squares = np.square(original - filtered).sum(axis=-1)
    smooth = np.stack([cv2.GaussianBlur(view, (0, 0), 1.0) for view in squares])
    variance = np.median(squares[available[..., 0] > 0.5]) / MEDIAN_OF_SQUARES[original.shape[-1]]
    ratio = smooth / np.float32(max(float(variance), MIN_VARIANCE) * OUTLIER_SIGMAS**2)
    return (1.0 / np.square(1.0 + np.square(ratio)))[..., None].astype(np.float32)


@dataclass(frozen=True, eq=False)
class Power:
    """Power per view in a passband and outside it (rings, components), and numbers of frequencies (rings,)."""

    signal: FloatArray
    noise: FloatArray
    counts: NDArray[np.int64]

    @property
    def ratios(self) -> FloatArray:
        """Ratio of noise to signal (rings, components)."""
        no_signal = np.full_like(self.noise, MAX_NOISE)
        ratios = np.divide(self.noise, self.signal, out=no_signal, where=self.signal > 0)
        return np.clip(ratios, MIN_NOISE, MAX_NOISE)

    @property
    def noise_fractions(self) -> FloatArray:
        """Fraction (rings, components) of noise in the differences between views, as `ratios` are limited from below.

        Below `MIN_NOISE`, the views truly differ: at low frequencies, because their borders enclose different parts of
        the scene.
        """
        noise_fraction = np.divide(
            self.noise, MIN_NOISE * self.signal, out=np.ones_like(self.noise), where=self.signal > 0
        )
        return np.clip(noise_fraction, 0.0, 1.0)

    @property
    def noise_of_sample(self) -> float:
        """Mean square of the noise in a sample, summed over its components."""
        return float((self.counts @ self.noise).sum() / self.counts.sum())


def frequencies_of(height: int, width: int) -> FloatArray:
    """Return the frequencies (height, width // 2 + 1, 2), (wu, wv) in rad per px, of `scipy.fft.rfft2`."""
    wu = 2.0 * np.pi * np.fft.rfftfreq(width)
    wv = 2.0 * np.pi * np.fft.fftfreq(height)
    return np.stack(np.meshgrid(wu, wv), axis=-1)


def rings_of(frequencies: FloatArray) -> NDArray[np.int64]:
    """Return the ring (...) of each frequency (..., 2)."""
    length = np.linalg.norm(frequencies, axis=-1) / (np.sqrt(2.0) * np.pi)
    return np.minimum((length * RINGS).astype(np.int64), RINGS - 1)


def measure_power(spectra: Complex64, passband: Passband, frequencies: FloatArray, original_fraction: float) -> Power:
    """Measure the power in a passband and outside it, of spectra (m, n, c) at frequencies (m, 2).

    `original_fraction` is the fraction of original samples; filled-in samples have no noise.
    """
    rings, views = rings_of(frequencies), spectra.shape[1]
    sums = np.zeros((RINGS, 2, spectra.shape[2]))
    traces, counts = np.zeros(RINGS), np.bincount(rings, minlength=RINGS)
    for part in _slices(len(frequencies), views):
        coherence = passband.coherence(frequencies[part]).astype(np.float32)
        vectors = spectra[part]
        total = (np.abs(vectors) ** 2).sum(axis=1)
        passed = (vectors.conj() * (coherence @ vectors)).real.sum(axis=1)
        np.add.at(sums, rings[part], np.stack([total, passed], axis=1))
        traces += np.bincount(rings[part], np.square(coherence).sum(axis=(1, 2)), RINGS)
    divisors = np.maximum(counts, 1)
    mean, excess = sums / divisors[:, None, None], (traces / divisors) / views - 1.0
    separable = excess > MIN_EXCESS
    signal = (mean[:, 1] - mean[:, 0]) / views / np.where(separable, excess, 1.0)[:, None]
    noise = np.clip(mean[:, 0] / views - np.maximum(signal, 0.0), 0.0, None) / max(original_fraction, 1e-3)
    noise = _interpolate(noise, separable & (counts > 0))
    return Power(np.maximum(mean[:, 0] / views - noise * original_fraction, 0.0), noise, counts)


def filtered_spectra(spectra: Complex64, passband: Passband, frequencies: FloatArray, power: Power) -> Complex64:
    """Apply the Wiener filter of a passband to spectra (m, n, c)."""
    ratios = power.ratios[rings_of(frequencies)].astype(np.float32)
    views, components = spectra.shape[1:]
    identity = np.eye(views, dtype=np.float32)
    filtered = np.zeros_like(spectra)
    for part in _slices(len(frequencies), views):
        coherence = passband.coherence(frequencies[part]).astype(np.float32)
        for c in range(components):
            # Real and imaginary part are two right-hand sides of one real system.
            rhs = np.ascontiguousarray(spectra[part, :, c])[..., None].view(np.float32)
            solved = coherence @ np.linalg.solve(coherence + ratios[part, c, None, None] * identity, rhs)
            filtered[part, :, c] = np.ascontiguousarray(solved).view(np.complex64)[..., 0]
    return filtered


def _slices(count: int, views: int) -> list[slice]:
    step = max(1, MAX_BYTES // (views * views * 8))
    return [slice(start, start + step) for start in range(0, count, step)]


def _interpolate(noise: FloatArray, separated: NDArray[np.bool_]) -> FloatArray:
    """Fill noise (rings, c) that the views cannot separate from the signal, by interpolation between other rings."""
    if not separated.any():
        return np.zeros_like(noise)
    rings, available = np.arange(len(noise)), np.flatnonzero(separated)
    return np.stack([np.interp(rings, available, column[available]) for column in noise.T], axis=-1)
