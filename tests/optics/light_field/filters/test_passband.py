"""Passbands against integrals of plane waves over their slopes."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.filters import FilterKind, Passband
from tests.optics.light_field.depth.surfaces import grid_views

VIEWS = grid_views()
BEHIND_MM = VIEWS.reference_view_depth_mm
FREQUENCIES = np.array([[0.0, 0.0], [0.3, 0.0], [0.2, -0.7], [2.9, 1.4], [-1.1, 2.0]])


def integral(passband: Passband, frequencies: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the mean (m, n, n) of v v* over slopes (k, 2) along x and y, for the waves v of a point in the views."""
    lags = np.einsum("mc,kc,nc->mkn", frequencies, slopes, passband.positions_mm)
    waves = np.exp(-1j * lags)
    covariance = np.einsum("mki,mkj->mij", waves, waves.conj()) / len(slopes)
    phases = np.exp(1j * passband.phases(frequencies)).T
    return np.asarray(phases[:, :, None] * covariance * phases[:, None].conj())


@pytest.mark.parametrize("kind", ["hyperfan", "dual-fan"])
def test_coherence_is_the_integral_over_depths(kind: FilterKind) -> None:
    passband = Passband.of(VIEWS, kind, 350.0 + BEHIND_MM, 420.0 + BEHIND_MM)
    ends = VIEWS.focal_px * (1.0 / VIEWS.reference_distance_mm - 1.0 / np.array([350.0, 420.0]))
    count = 400
    slopes = ends[0] + (ends[1] - ends[0]) * (np.arange(count) + 0.5) / count
    across, down = (slopes, slopes) if kind == "hyperfan" else (each.ravel() for each in np.meshgrid(slopes, slopes))
    expected = integral(passband, FREQUENCIES, np.stack([across, down], axis=-1))
    np.testing.assert_allclose(passband.coherence(FREQUENCIES), expected, atol=2e-4)


def test_a_hypercone_is_the_integral_over_all_slopes_that_views_distinguish() -> None:
    views = grid_views(uneven=False)
    passband = Passband.of(views, "hypercone", None, None)
    for frequency in FREQUENCIES[1:]:
        most = np.pi / 20.0 / np.linalg.norm(frequency)
        slopes = most * (2.0 * (np.arange(2000) + 0.5) / 2000 - 1.0)
        expected = integral(passband, frequency[None], np.stack([slopes, slopes], axis=-1))
        np.testing.assert_allclose(passband.coherence(frequency[None]), expected, atol=1e-4)
    np.testing.assert_array_equal(passband.coherence(FREQUENCIES[:1]), np.ones((1, 9, 9)))


@pytest.mark.parametrize("kind", ["hyperfan", "dual-fan", "hypercone"])
def test_coherence_is_a_correlation(kind: FilterKind) -> None:
    coherence = Passband.of(VIEWS, kind, 400.0, 900.0).coherence(FREQUENCIES)
    np.testing.assert_allclose(np.diagonal(coherence, axis1=1, axis2=2), 1.0)
    assert np.linalg.eigvalsh(coherence).min() > -1e-12


@pytest.mark.parametrize(
    ("near_mm", "far_mm", "message"),
    [
        (None, 500.0, "a hyperfan passes a range of depths"),
        (500.0, 400.0, "depths 500 to 400 mm"),
        (-200.0, 400.0, "the nearest must come first and be more than"),
        (np.nan, 400.0, "depths nan to 400 mm"),
    ],
)
def test_depths_out_of_order_are_refused(near_mm: float | None, far_mm: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Passband.of(VIEWS, "hyperfan", near_mm, far_mm)


def test_one_view_is_refused() -> None:
    with pytest.raises(InputError, match="light field has one view, expected several"):
        Passband.of(grid_views(1, 1), "hypercone", None, None)
