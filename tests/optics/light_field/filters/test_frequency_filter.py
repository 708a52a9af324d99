"""Filters on light fields of textured planes with known clean views."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.filters import FilterKind, Passband, filter_light_field
from mirrorcam.optics.light_field.filters.frequency_filter import (
    Power,
    filtered_spectra,
    frequencies_of,
    measure_power,
    rings_of,
)
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

VIEWS = grid_views()
BEHIND_MM = VIEWS.reference_view_depth_mm
WALL = Surface(480.0, slope=(0.1, -0.2), seed=1)
CARD = Surface(400.0, bounds=(-16.0, -22.0, 8.0, 14.0), seed=2)
NEAR_MM, FAR_MM = 390.0 + BEHIND_MM, 520.0 + BEHIND_MM
PASSBAND = Passband.of(grid_views(), "hyperfan", 250.0, 400.0)
FREQUENCIES = frequencies_of(128, 128).reshape(-1, 2)


@pytest.fixture(scope="module")
def clean() -> LightField:
    return photograph(VIEWS, [WALL, CARD])[0]


def shown(light_field: LightField) -> Any:
    scale = 255.0 if light_field.samples.dtype == np.uint8 else 1.0
    return light_field.samples.astype(np.float64) / scale


def with_samples(light_field: LightField, samples: Any, weights: Any = None) -> LightField:
    return LightField.of(light_field, samples, light_field.weights if weights is None else weights)


def noisy(light_field: LightField, grey: float) -> LightField:
    noise = np.random.default_rng(0).normal(0.0, grey / 255.0, light_field.samples.shape)
    return with_samples(light_field, (shown(light_field) + noise).astype(np.float32))


def error(light_field: LightField, truth: LightField) -> float:
    """Root mean square error of all samples in grey levels."""
    return float(255.0 * np.sqrt(np.square(shown(light_field) - shown(truth)).mean()))


def fan(kind: FilterKind = "hyperfan", near_mm: float = NEAR_MM, far_mm: float = FAR_MM) -> Passband:
    return Passband.of(VIEWS, kind, *((None, None) if kind == "hypercone" else (near_mm, far_mm)))


@pytest.mark.parametrize(("kind", "left"), [("hyperfan", 0.45), ("dual-fan", 0.5), ("hypercone", 0.55)])
def test_noise_is_removed_and_measured(clean: LightField, kind: FilterKind, left: float) -> None:
    filtered = filter_light_field(noisy(clean, 20.0), fan(kind))
    assert error(filtered.light_field, clean) < left * 20.0
    np.testing.assert_allclose(255.0 * filtered.outside, 20.0, rtol=0.1)


def test_depths_between_the_two_pass(clean: LightField) -> None:
    assert error(filter_light_field(clean, fan()).light_field, clean) < 3.0


def test_a_clean_scene_with_differences_between_views_is_unchanged(clean: LightField) -> None:
    # Broad shadows in single views: stronger than noise, and consistent with no depth.
    u, v = VIEWS.pixel_grid()[..., 0], VIEWS.pixel_grid()[..., 1]
    samples = shown(clean)
    for number, index in enumerate(np.ndindex(3, 3)):
        shadow = np.exp(-(((u - 12.0 * number) / 40.0) ** 2) - ((v - 45.0) / 30.0) ** 2)
        samples[index] *= 1.0 - 0.08 * shadow[..., None]
    shaded = with_samples(clean, samples.astype(np.float32))
    # Less than the noise of one grey level and rounding, which the filter removes, with a margin.
    assert error(filter_light_field(shaded, fan()).light_field, shaded) < 1.5


def test_a_plane_outside_of_the_fan_is_attenuated() -> None:
    plane = photograph(VIEWS, [Surface(480.0, seed=3)])[0]
    inside = filter_light_field(noisy(plane, 10.0), fan("hyperfan", 470.0 + BEHIND_MM, 490.0 + BEHIND_MM)).light_field
    outside = filter_light_field(noisy(plane, 10.0), fan("hyperfan", 240.0 + BEHIND_MM, 260.0 + BEHIND_MM)).light_field
    assert error(outside, plane) > 5.0 * error(inside, plane)


def test_nothing_wraps_around_the_borders() -> None:
    plane = photograph(VIEWS, [Surface(480.0, seed=3)])[0]
    painted = plane.samples.copy()
    painted[..., :, -6:, :] = 255 if painted.dtype == np.uint8 else 1.0
    changed = shown(filter_light_field(with_samples(plane, painted), fan()).light_field)
    before = shown(filter_light_field(plane, fan()).light_field)
    assert np.abs(changed - before)[..., :, :20, :].max() < 2.5 / 255.0


def test_missing_samples_have_no_influence_and_stay_missing(clean: LightField) -> None:
    weights = clean.weights.copy()
    weights[0, 1, 20:50, 30:70] = 0.0
    weights[2, 2, :, :15] = 0.0
    given = noisy(clean, 10.0)
    results = [
        filter_light_field(
            with_samples(given, np.where(weights[..., None] > 0, given.samples, np.float32(value)), weights), fan()
        ).light_field
        for value in (0.0, 0.9)
    ]
    np.testing.assert_array_equal(results[0].samples, results[1].samples)
    assert (results[0].samples[weights == 0] == 0).all()
    there = weights > 0
    off = (shown(results[0]) - shown(clean))[there]
    assert 255.0 * np.sqrt(np.square(off).mean()) < 7.0


def test_particles_in_single_views_are_removed(clean: LightField) -> None:
    rng = np.random.default_rng(7)
    samples = shown(clean).astype(np.float32)
    for t, s in np.ndindex(3, 3):
        for u, v in rng.integers(0, [117, 78], (6, 2)):
            samples[t, s, v : v + 12, u : u + 3] = 0.95
    rainy = with_samples(clean, samples)
    plain, robust = (filter_light_field(rainy, fan(), leave_out=leave) for leave in (False, True))
    assert error(robust.light_field, clean) < 0.7 * error(plain.light_field, clean)
    assert error(robust.light_field, clean) < 0.4 * error(rainy, clean)
    assert plain.left_out == 0.0
    assert 0.02 < robust.left_out < 0.15


def test_the_type_of_samples_is_kept(clean: LightField) -> None:
    grey = np.rint(255.0 * shown(clean).mean(axis=-1, keepdims=True)).astype(np.uint8)
    filtered = filter_light_field(with_samples(clean, grey), fan()).light_field
    assert filtered.samples.dtype == np.uint8
    assert filtered.samples.shape == grey.shape
    assert np.abs(filtered.samples.astype(float) - grey).mean() < 2.0


def test_power_of_signal_and_noise_is_separated() -> None:
    rng = np.random.default_rng(4)
    roots = np.linalg.cholesky(PASSBAND.coherence(FREQUENCIES) + 1e-9 * np.eye(9))

    def drawn(count: int) -> np.ndarray:
        return (
            rng.normal(size=(len(FREQUENCIES), 9, count)) + 1j * rng.normal(size=(len(FREQUENCIES), 9, count))
        ) / 2**0.5

    spectra = roots @ drawn(2) * np.sqrt([4.0, 0.5]) + drawn(2) * np.sqrt([1.0, 2.0])
    power = measure_power(spectra.astype(np.complex64), PASSBAND, FREQUENCIES, 1.0)
    many = power.counts > 100
    assert many.sum() > 30
    np.testing.assert_allclose(power.signal[many].mean(axis=0), [4.0, 0.5], rtol=0.03)
    np.testing.assert_allclose(power.noise[many].mean(axis=0), [1.0, 2.0], rtol=0.03)
    np.testing.assert_allclose(power.noise_of_sample, 3.0, rtol=0.03)


def test_filtering_is_the_linear_least_squares_estimate() -> None:
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
