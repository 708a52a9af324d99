"""Correlated errors of corners: distinguished from independent ones, with true uncertainties in spite of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from mirrorcam.optics.calibration.diagnostics.error_correlation import CorrelatedErrors, correlated_errors
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, fit
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.diagnostics.conftest import JOINT, Scene, scene_of


@pytest.fixture(scope="module")
def many(device: Layout) -> Scene:
    """As many frames as a person takes."""
    return scene_of(device, mirrored=20, direct=8)


def leaning(scene: Scene, seed: int, shift_px: float) -> Observations:
    """Corners with independent noise and, in each view of each frame, a shift and a stretch that all of them share."""
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


def test_independent_errors_are_as_likely_as_they_are(scene: Scene) -> None:
    found = [
        correlated_errors(fit(scene.start, seen, JOINT), seen, JOINT) for seen in map(scene.noisy, range(500, 530))
    ]
    assert kstest([one.chance for one in found], "uniform").pvalue > 0.01
    assert np.mean([one.ratio**2 for one in found]) == pytest.approx(1.0, abs=0.15)
    assert all(one.widening == 1.0 for one in found)


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
    """Normalised estimation error squared per parameter: far above 1 as the solver has it, about 1 when widened."""
    plain: list[float] = []
    widened: list[float] = []
    for seed in range(12):
        seen = leaning(many, seed, 0.03)
        solution = fit(many.start, seen, JOINT)
        found = correlated_errors(solution, seen, JOINT)
        assert found.chance < 1e-3
        plain.append(squared_error_per_parameter(many, solution))
        widened.append(plain[-1] / found.widening**2)
    assert np.mean(plain) > 2.0
    assert 0.5 < np.mean(widened) < 1.6


def test_a_ratio_that_may_be_chance_widens_nothing_and_none_narrows() -> None:
    assert CorrelatedErrors(ratio=1.4, chance=0.05).widening == 1.0
    assert CorrelatedErrors(ratio=1.4, chance=1e-5).widening == 1.4
    assert CorrelatedErrors(ratio=0.8, chance=1e-5).widening == 1.0


def test_one_frame_shares_nothing_that_could_be_told(scene: Scene) -> None:
    seen = scene.noisy(0)
    seen = seen.where(seen.frame == 0)
    start = scene.start.with_poses(scene.poses[:1])
    model = replace(JOINT, intrinsics=())
    assert correlated_errors(fit(start, seen, model), seen, model) == CorrelatedErrors(1.0, 1.0)
