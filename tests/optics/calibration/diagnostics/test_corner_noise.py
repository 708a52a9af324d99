"""Noise of views: estimated from scatter about smooth residuals, and shrunk where corners are few."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.corner_noise import (
    CorrelatedErrors,
    correlated_errors,
    with_view_noise,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, fit
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.diagnostics.conftest import JOINT, Scene, scene_of

GRID = np.stack(np.meshgrid(np.arange(12.0), np.arange(9.0)), axis=-1).reshape(-1, 2)
SIGMAS = np.array([0.005, 0.005, 0.03, 0.01, 0.005, 0.008])


def views(corners: int = len(GRID)) -> Observations:
    """Return a frame with a view of the same corners for each of SIGMAS; odd ids are twice as uncertain."""
    ids = np.arange(corners)
    pixels = 30.0 * GRID[:corners]
    parts = [Observations.of_view(0, view, ids, pixels, np.where(ids % 2, 2.0, 1.0)) for view in range(len(SIGMAS))]
    return Observations.join(parts)


def noise(seen: Observations, seed: int = 0) -> FloatArray:
    random = np.random.default_rng(seed)
    return random.normal(0.0, 1.0, (len(seen), 2)) * (SIGMAS[seen.view] * seen.sigma_px)[:, None]


def of_views(seen: Observations) -> FloatArray:
    """Return the median standard deviation of the corners with even ids, per view."""
    even = seen.corner % 2 == 0
    return np.array([np.median(seen.sigma_px[even & (seen.view == view)]) for view in range(len(SIGMAS))])


def test_each_view_gets_the_scatter_of_its_corners() -> None:
    seen = views()
    found = np.array([of_views(with_view_noise(seen, noise(seen, seed))) for seed in range(30)])
    # Shrunk towards the median of all views by the weight of 8 in 184 degrees of freedom.
    freedom, median = 2.0 * (len(GRID) - 10), np.median(SIGMAS)
    expected = np.sqrt((freedom * SIGMAS**2 + 8.0 * median**2) / (freedom + 8.0))
    np.testing.assert_allclose(np.sqrt(np.mean(found**2, axis=0)), expected, rtol=0.05)
    scaled = with_view_noise(seen, noise(seen))
    ratio = np.median(scaled.sigma_px[seen.corner % 2 == 1]) / np.median(scaled.sigma_px[seen.corner % 2 == 0])
    assert ratio == pytest.approx(2.0, rel=0.05)


def test_heavy_tails_count_less_and_outliers_stay_to_be_found() -> None:
    """Noise with a t distribution of four degrees of freedom is nearly normal once standardised."""
    random = np.random.default_rng(0)
    seen = Observations.join([views().with_frame_offset(frame) for frame in range(8)])
    left = random.normal(0.0, 0.01, (len(seen), 2)) / np.sqrt(random.chisquare(4.0, (len(seen), 1)) / 4.0)
    found = with_view_noise(replace(seen, sigma_px=np.ones(len(seen))), left)
    inner = np.abs(left).max(axis=1) < 0.04
    relative = np.abs(found.standardised(left)[inner])
    assert (relative > 3.0).mean() < 0.003
    assert np.mean(relative**2) == pytest.approx(1.0, abs=0.12)
    far, near = (np.median(found.sigma_px[rows]) for rows in (inner & (np.abs(left).max(axis=1) > 0.025), inner))
    assert far > 1.4 * near
    left[::100] = 0.5
    assert (np.abs(with_view_noise(seen, left).standardised(left)[::100]) > 5.0).all()


def test_normal_noise_has_no_tails() -> None:
    seen = replace(views(), sigma_px=np.ones(len(views())))
    found = with_view_noise(seen, noise(seen))
    spread = [np.ptp(found.sigma_px[seen.view == view]) / found.sigma_px[seen.view == view].mean() for view in (0, 2)]
    assert max(spread) < 0.3


def test_smooth_residuals_are_not_counted_as_noise() -> None:
    seen = views()
    x, y = (seen.pixels / 300.0).T
    misfit = np.stack([0.2 + 0.1 * x * y - 0.3 * x**3, 0.1 * y**2 - 0.2 * x], axis=1)
    alone, both = (with_view_noise(seen, noise(seen) + field) for field in (0.0, misfit))
    np.testing.assert_allclose(both.sigma_px, alone.sigma_px, rtol=0.01)


def test_outliers_hardly_widen_their_view() -> None:
    seen, left = views(), noise(views())
    clean = of_views(with_view_noise(seen, left))
    left[::25] += 20.0 * SIGMAS[seen.view[::25], None]
    spoilt = with_view_noise(seen, left)
    assert (of_views(spoilt.where(np.arange(len(seen)) % 25 != 0)) < 1.3 * clean).all()


def test_the_noise_of_a_view_of_few_corners_shrinks_towards_the_others() -> None:
    seen = views()
    few = seen.where((seen.view != 2) | (seen.corner < 6))
    found = of_views(with_view_noise(few, noise(few)))
    assert 0.008 < found[2] < 0.03
    lone = seen.where(seen.corner < 1)
    assert with_view_noise(lone, noise(lone)) is lone
    none = Observations.empty()
    assert with_view_noise(none, np.empty((0, 2))) is none


def test_corners_without_noise_stay_usable() -> None:
    seen = views()
    found = with_view_noise(seen, np.zeros((len(seen), 2)))
    assert found.sigma_px == pytest.approx(1e-4)


@pytest.fixture(scope="module")
def many(device: Layout) -> Scene:
    """Return as many frames as a user takes."""
    return scene_of(device, mirrored=20, direct=8)


def leaning(scene: Scene, seed: int, shift_px: float) -> Observations:
    """Return corners with independent noise, and a common shift and scale in each view of each frame."""
    seen = scene.noisy(seed)
    random = np.random.default_rng(10_000 + seed)
    pixels = seen.pixels.copy()
    for frame in np.unique(seen.frame):
        for view in np.unique(seen.view[seen.frame == frame]):
            rows = (seen.frame == frame) & (seen.view == view)
            offset = pixels[rows] - pixels[rows].mean(axis=0)
            stretch = random.normal(0.0, shift_px, (2, 2)) / np.abs(offset).max()
            pixels[rows] += random.normal(0.0, shift_px, 2) + offset @ stretch
    return replace(seen, pixels=pixels)


def test_independent_errors_have_no_shared_part(scene: Scene) -> None:
    found = [
        correlated_errors(fit(scene.start, seen, JOINT), seen, JOINT) for seen in map(scene.noisy, range(500, 530))
    ]
    assert kstest([one.chance for one in found], "uniform").pvalue > 0.01
    assert np.mean([one.ratio**2 for one in found]) == pytest.approx(1.0, abs=0.15)
    assert all(one.inflation == 1.0 for one in found)


def squared_error_per_parameter(scene: Scene, solution: Solution) -> float:
    truth, found = scene.start, solution.estimate
    error = np.concatenate(
        [
            found.camera.intrinsics - truth.camera.intrinsics,
            (found.virtual_centres_in_rig_mm - truth.virtual_centres_in_rig_mm).ravel(),
        ]
    )
    return float(error @ np.linalg.solve(solution.covariance, error)) / error.size


def test_shared_errors_are_found_and_widened_sigmas_are_true(many: Scene) -> None:
    """Normalised estimation error squared per parameter: far above 1 from the solver, about 1 when widened."""
    plain: list[float] = []
    inflation: list[float] = []
    for seed in range(12):
        seen = leaning(many, seed, 0.03)
        solution = fit(many.start, seen, JOINT)
        found = correlated_errors(solution, seen, JOINT)
        assert found.chance < 1e-3
        plain.append(squared_error_per_parameter(many, solution))
        inflation.append(plain[-1] / found.inflation**2)
    assert np.mean(plain) > 2.0
    assert 0.5 < np.mean(inflation) < 1.6


def test_an_insignificant_ratio_widens_nothing_and_no_ratio_narrows() -> None:
    assert CorrelatedErrors(ratio=1.4, chance=0.05).inflation == 1.0
    assert CorrelatedErrors(ratio=1.4, chance=1e-5).inflation == 1.4
    assert CorrelatedErrors(ratio=0.8, chance=1e-5).inflation == 1.0


def test_one_frame_shows_no_shared_errors(scene: Scene) -> None:
    seen = scene.noisy(0)
    seen = seen.where(seen.frame == 0)
    start = scene.start.with_poses(scene.poses[:1])
    model = replace(JOINT, intrinsics=())
    found = correlated_errors(fit(start, seen, model), seen, model)
    assert (found.ratio, found.chance, found.inflation) == (1.0, 1.0, 1.0)
