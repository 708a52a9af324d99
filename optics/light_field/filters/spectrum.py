"""Filtering of spectra of views: the part that agrees with a passband is kept, weighed against the rest.

At every frequency the views hold a vector. Its covariance is P S + N: S is the coherence of the passband, P the power
of what lies in it, and N that of noise and of all else, which differs from view to view. Both are measured in rings of
equal frequency from the spectra themselves: of n views, E[v* v] = n P + n N and E[v* S v] = tr(S S) P + n N.
The linear estimate with the least squared error is then P S (P S + N)^-1 v (Wiener).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.filters.passband import Passband

Complex64 = NDArray[np.complex64]

RINGS = 48
AT_ONCE = 60_000_000
"""Bytes of coherences that are held at a time."""
TELLS = 0.1
"""Of tr(S S) / n - 1 of a ring, below which signal and noise look alike to the views."""
LEAST_NOISE = 1e-5
"""Of the signal's power: a coherence is singular."""
MOST_NOISE = 1e5


@dataclass(frozen=True, eq=False)
class Power:
    """Power per view of what lies in a passband, and of all else, (rings, components); `counts` of frequencies."""

    signal: FloatArray
    noise: FloatArray
    counts: NDArray[np.int64]

    @property
    def ratios(self) -> FloatArray:
        """Noise for each unit of signal (rings, components)."""
        most = np.full_like(self.noise, MOST_NOISE)
        ratios = np.divide(self.noise, self.signal, out=most, where=self.signal > 0)
        return np.clip(ratios, LEAST_NOISE, MOST_NOISE)

    @property
    def noisy(self) -> FloatArray:
        """Share (rings, components) that noise has of what views do not have in common, as `ratios` are at least.

        Where noise is less than `LEAST_NOISE`, views truly differ: at low frequencies, what lies before the borders of
        some and beyond those of others does.
        """
        share = np.divide(self.noise, LEAST_NOISE * self.signal, out=np.ones_like(self.noise), where=self.signal > 0)
        return np.clip(share, 0.0, 1.0)

    @property
    def noise_of_sample(self) -> float:
        """Mean square of noise in a sample, summed over its components."""
        return float((self.counts @ self.noise).sum() / self.counts.sum())


def frequencies_of(height: int, width: int) -> FloatArray:
    """Frequencies (height, width // 2 + 1, 2), as (wu, wv) in rad per px, of `scipy.fft.rfft2`."""
    across = 2.0 * np.pi * np.fft.rfftfreq(width)
    down = 2.0 * np.pi * np.fft.fftfreq(height)
    return np.stack(np.meshgrid(across, down), axis=-1)


def rings_of(frequencies: FloatArray) -> NDArray[np.int64]:
    """The ring (...) of each frequency (..., 2)."""
    length = np.linalg.norm(frequencies, axis=-1) / (np.sqrt(2.0) * np.pi)
    return np.minimum((length * RINGS).astype(np.int64), RINGS - 1)


def measured_power(spectra: Complex64, passband: Passband, frequencies: FloatArray, seen: float) -> Power:
    """Power in a passband and beside it of spectra (m, n, c) at frequencies (m, 2).

    `seen` is the share of samples that were there and not filled in: what is filled in has no noise.
    """
    rings, views = rings_of(frequencies), spectra.shape[1]
    sums = np.zeros((RINGS, 2, spectra.shape[2]))
    traces, counts = np.zeros(RINGS), np.bincount(rings, minlength=RINGS)
    for part in _parts(len(frequencies), views):
        coherence = passband.coherence(frequencies[part]).astype(np.float32)
        vectors = spectra[part]
        total = (np.abs(vectors) ** 2).sum(axis=1)
        passed = (vectors.conj() * (coherence @ vectors)).real.sum(axis=1)
        np.add.at(sums, rings[part], np.stack([total, passed], axis=1))
        traces += np.bincount(rings[part], np.square(coherence).sum(axis=(1, 2)), RINGS)
    some = np.maximum(counts, 1)
    mean, excess = sums / some[:, None, None], (traces / some) / views - 1.0
    tells = excess > TELLS
    signal = (mean[:, 1] - mean[:, 0]) / views / np.where(tells, excess, 1.0)[:, None]
    noise = np.clip(mean[:, 0] / views - np.maximum(signal, 0.0), 0.0, None) / max(seen, 1e-3)
    noise = _where_told(noise, tells & (counts > 0))
    return Power(np.maximum(mean[:, 0] / views - noise * seen, 0.0), noise, counts)


def filtered_spectra(spectra: Complex64, passband: Passband, frequencies: FloatArray, power: Power) -> Complex64:
    """Spectra (m, n, c) of which the passband is kept."""
    ratios = power.ratios[rings_of(frequencies)].astype(np.float32)
    views, components = spectra.shape[1:]
    identity = np.eye(views, dtype=np.float32)
    kept = np.zeros_like(spectra)
    for part in _parts(len(frequencies), views):
        coherence = passband.coherence(frequencies[part]).astype(np.float32)
        for c in range(components):
            # Real and imaginary part are two right sides of one real system.
            sides = np.ascontiguousarray(spectra[part, :, c])[..., None].view(np.float32)
            solved = coherence @ np.linalg.solve(coherence + ratios[part, c, None, None] * identity, sides)
            kept[part, :, c] = np.ascontiguousarray(solved).view(np.complex64)[..., 0]
    return kept


def _parts(count: int, views: int) -> list[slice]:
    step = max(1, AT_ONCE // (views * views * 8))
    return [slice(start, start + step) for start in range(0, count, step)]


def _where_told(noise: FloatArray, told: NDArray[np.bool_]) -> FloatArray:
    """Noise (rings, c), where views do not tell it from the signal as in the nearest rings where they do."""
    if not told.any():
        return np.zeros_like(noise)
    at, known = np.arange(len(noise)), np.flatnonzero(told)
    return np.stack([np.interp(at, known, each[known]) for each in noise.T], axis=-1)
