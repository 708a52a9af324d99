"""The solver at the Cramér-Rao bound: efficient errors, true covariances, outliers, wrong starts.

A root mean square over 200 trials has a standard error of 5 %. Therefore each error is
also compared with the linear estimate from the same noise, whose spread *is* the bound: their difference has a
far smaller standard error.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import least_squares

from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit, minimise
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate, residuals
from tests.nightly import a_few
from tests.optics.calibration.solver.peer import Peer
from tests.optics.calibration.solver.scenes import (
    SIGMA_PX,
    Scene,
    disturbed,
    large_scene,
    small_scene,
    start_from,
)
from tests.optics.calibration.solver.trials import Trials, converges, over_bound, run_trials

TRIALS = 200


@lru_cache(maxsize=1)
def trials() -> Trials:
    return run_trials(TRIALS, outliers=40)


@pytest.mark.parametrize("what", a_few(1, [0, 1]), ids=["normals", "distances"])
def test_errors_reach_the_cramer_rao_bound(what: int) -> None:
    found = trials()
    ours, linear = over_bound(found, found.errors)[what], over_bound(found, found.linear)[what]
    plain = np.sqrt(ours.mean(axis=0))
    # The mean of squared normal variables has a relative standard error of sqrt(2 / trials), its root half of that.
    spread = np.sqrt(0.5 / TRIALS)
    assert (np.abs(plain - 1.0) < 3.5 * spread).all()
    # The linear estimate has expectation 1, so that only the difference has to be estimated.
    paired = 1.0 + (ours - linear).mean(axis=0)
    precision = (ours - linear).std(axis=0) / np.sqrt(TRIALS)
    assert precision.max() < 0.001
    assert (np.sqrt(paired + 3.0 * precision) < 1.005).all()


def test_the_claimed_covariance_matches_the_errors() -> None:
    """Normalised estimation error squared per degree of freedom: mean 1, sqrt(2 / (200 x 36)) = 0.017 of spread."""
    found = trials()
    nees = np.mean([e @ np.linalg.solve(c, e) for e, c in zip(found.errors, found.claims, strict=True)])
    assert 0.95 < nees / found.errors.shape[1] < 1.05
    claimed = np.mean([np.sqrt(np.diag(claim)) for claim in found.claims], axis=0)
    np.testing.assert_allclose(claimed, np.sqrt(np.diag(found.scene.bound)), rtol=0.01)


def test_the_weakest_direction_is_as_uncertain_as_claimed() -> None:
    found = trials()
    block = found.scene.bound[found.mirrors, found.mirrors]
    weakest = np.linalg.eigh(block)[1][:, -1]
    claimed = np.mean([np.sqrt(weakest @ claim[found.mirrors, found.mirrors] @ weakest) for claim in found.claims])
    ours, linear = found.errors[:, found.mirrors] @ weakest, found.linear[:, found.mirrors] @ weakest
    assert np.sqrt(np.mean(ours**2)) == pytest.approx(claimed, rel=3.5 * np.sqrt(0.5 / TRIALS))
    paired = np.sqrt(weakest @ block @ weakest + np.mean(ours**2 - linear**2))
    assert paired == pytest.approx(claimed, rel=0.02)


def test_outliers_cost_a_tenth_at_most() -> None:
    """One corner in a hundred is off by 20 sigma: 1 % fewer corners alone would cost half a percent."""
    found = trials()
    spoilt = np.stack(over_bound(found, found.with_outliers))
    clean = np.stack(over_bound(found, found.errors[: len(found.with_outliers)]))
    assert np.sqrt(spoilt.mean() / clean.mean()) < 1.05
    assert (np.sqrt(spoilt.mean(axis=1) / clean.mean(axis=1)) < 1.1).all()


def test_corners_are_weighted_by_their_variance() -> None:
    """Half of the views have six times the noise: errors are as claimed, and smaller than with equal weights."""
    scene = small_scene()
    sigmas = np.where((scene.clean.frame + scene.clean.view) % 2 == 0, 6.0, 1.0) * SIGMA_PX
    seen = replace(scene.clean, sigma_px=sigmas)
    squared, over_equal = [], []
    for seed in range(20):
        random = np.random.default_rng(seed)
        noisy = replace(seen, pixels=seen.pixels + sigmas[:, None] * random.standard_normal((len(seen), 2)))
        solution = fit(scene.truth, noisy, scene.model)
        error = scene.errors(solution.estimate)
        squared.append(error @ np.linalg.solve(solution.covariance, error) / len(error))
        equal = scene.errors(minimise(scene.truth, replace(noisy, sigma_px=np.ones(len(seen))), scene.model)[0])
        over_equal.append(np.abs(error) / np.abs(equal))
        assert solution.scale == pytest.approx(1.0, rel=0.06)
        assert solution.sigma_px == pytest.approx(np.median(sigmas[solution.inliers]), rel=0.06)
    assert np.mean(squared) == pytest.approx(1.0, abs=0.25)
    assert np.median(over_equal) < 0.7


@pytest.mark.slow
def test_every_wrong_start_leads_to_the_same_minimum() -> None:
    scene = small_scene()
    assert all(converges(scene, seed, tilt_deg=2.0, offset_mm=2.0) for seed in range(20))


def large_start(scene: Scene, seen: Observations) -> Estimate:
    return start_from(
        scene.layout.camera, disturbed(scene.layout, 0, tilt_deg=2.0, offset_mm=2.0), seen, scene.model.board
    )


def test_few_steps_solve_a_large_problem_from_a_distant_start() -> None:
    scene = large_scene()
    seen, _ = scene.noisy(0)
    assert seen.pixels.size == 29160
    solution = fit(large_start(scene, seen), seen, scene.model)
    assert solution.iterations <= 10
    assert len(solution.parameters) + 6 * len(solution.estimate.rig_from_board) == 216
    assert solution.sigma_px == pytest.approx(SIGMA_PX, rel=3.5 * np.sqrt(0.5 / seen.pixels.size))


@pytest.mark.slow
def test_the_large_problem_has_the_same_minimum_for_scipy() -> None:
    scene = large_scene()
    seen, _ = scene.noisy(0)
    start = large_start(scene, seen)
    peer = Peer(start, seen, scene.model)
    theirs = least_squares(peer.residuals, peer.x0, jac=peer.dense, x_scale="jac", ftol=1e-14, xtol=1e-14, gtol=1e-14)
    ours, _ = minimise(start, seen, scene.model)
    cost = float(np.sum(residuals(ours, seen, scene.model.board) ** 2))
    assert cost == pytest.approx(2.0 * theirs.cost, rel=1e-7)
    best = peer.estimate(theirs.x).virtual_centres_in_rig_mm
    np.testing.assert_allclose(ours.virtual_centres_in_rig_mm, best, atol=1e-7 * 80.0)


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "millimetres", "least"), [(2.0, 2.0, 0.99), (3.0, 3.0, 0.99)])
def test_nearly_all_wrong_starts_lead_to_the_same_minimum(degrees: float, millimetres: float, least: float) -> None:
    scene = small_scene()
    found = [converges(scene, 500 + seed, tilt_deg=degrees, offset_mm=millimetres) for seed in range(100)]
    assert np.mean(found) >= least
