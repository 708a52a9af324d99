"""Power is measured as it was drawn, and filtering is the Wiener filter of that power, by another formula."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.light_field.filters import Passband
from mirrorcam.optics.light_field.filters.spectrum import (
    Power,
    filtered_spectra,
    frequencies_of,
    measured_power,
    rings_of,
)
from tests.optics.light_field.depth.surfaces import grid_views

PASSBAND = Passband.of(grid_views(), "hyperfan", 250.0, 400.0)
FREQUENCIES = frequencies_of(128, 128).reshape(-1, 2)


def test_power_of_signal_and_noise_is_told_apart() -> None:
    rng = np.random.default_rng(4)
    roots = np.linalg.cholesky(PASSBAND.coherence(FREQUENCIES) + 1e-9 * np.eye(9))

    def drawn(count: int) -> np.ndarray:
        return (
            rng.normal(size=(len(FREQUENCIES), 9, count)) + 1j * rng.normal(size=(len(FREQUENCIES), 9, count))
        ) / 2**0.5

    spectra = roots @ drawn(2) * np.sqrt([4.0, 0.5]) + drawn(2) * np.sqrt([1.0, 2.0])
    power = measured_power(spectra.astype(np.complex64), PASSBAND, FREQUENCIES, 1.0)
    many = power.counts > 100
    assert many.sum() > 30
    np.testing.assert_allclose(power.signal[many].mean(axis=0), [4.0, 0.5], rtol=0.03)
    np.testing.assert_allclose(power.noise[many].mean(axis=0), [1.0, 2.0], rtol=0.03)
    np.testing.assert_allclose(power.noise_of_sample, 3.0, rtol=0.03)


def test_filtering_is_the_linear_estimate_of_least_squared_error() -> None:
    rng = np.random.default_rng(5)
    few = FREQUENCIES[::997]
    signal, noise = 3.0, 0.7
    spectra = (rng.normal(size=(len(few), 9, 1)) + 1j * rng.normal(size=(len(few), 9, 1))).astype(np.complex64)
    rings = rings_of(FREQUENCIES).max() + 1
    power = Power(np.full((rings, 1), signal), np.full((rings, 1), noise), np.ones(rings, np.int64))
    # By eigenvectors of the covariance: each is kept by its share of signal.
    values, vectors = np.linalg.eigh(signal * PASSBAND.coherence(few))
    gains = values / (values + noise)
    expected = vectors @ (gains[..., None] * (np.swapaxes(vectors, 1, 2) @ spectra))
    np.testing.assert_allclose(filtered_spectra(spectra, PASSBAND, few, power), expected, atol=1e-5)
