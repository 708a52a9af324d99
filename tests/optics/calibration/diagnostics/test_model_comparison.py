"""Comparison of nested models: by hand, and against the distribution that noise alone leads to."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.model_comparison import (
    MIN_GAIN_SIGMAS,
    SUPPORTED_CHANCE,
    compare,
    compare_likelihood,
    cross_validated,
    gain_sigmas,
    smallest,
)
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted, fit_as, joint_model, paper_model
from mirrorcam.optics.calibration.solver.observations import Observations
from tests.optics.calibration.diagnostics.conftest import BOARD, Scene

CORNERS = BOARD.corners_in_board_mm


def models_of(scene: Scene, seen: Observations) -> tuple[Fitted, Fitted]:
    """The joint fit, and the one with the camera held at the truth."""
    paper = fit_as("paper", scene.start, seen, paper_model(CORNERS))
    return fit_as("joint", paper.solution.estimate, seen, joint_model(scene.start.camera, CORNERS)), paper


def test_the_smallest_model_is_compared_with_none(scene: Scene) -> None:
    _, paper = models_of(scene, scene.noisy(0))
    entry = smallest(paper)
    assert entry.against is None
    assert entry.supported
    assert entry.parameters == 12
    assert np.isnan([entry.drop, entry.chance, entry.information_gain, entry.held_out_gain]).all()
    assert entry.rms_px == pytest.approx(np.sqrt(np.mean(paper.solution.residuals[paper.solution.inliers] ** 2)))


def test_free_intrinsics_explain_only_noise_where_the_camera_is_right(scene: Scene) -> None:
    """The drop in units of sigma^2 is chi squared with 9 degrees of freedom: its mean over draws is 9."""
    drops = []
    for seed in range(8):
        seen = scene.noisy(40 + seed)
        comparison = compare_likelihood(*models_of(scene, seen), seen)
        drops.append(comparison.drop)
        assert comparison.chance > SUPPORTED_CHANCE
        assert comparison.information_gain < 0.0
        assert not comparison.supported
    assert np.mean(drops) == pytest.approx(9.0, abs=4.0 * np.sqrt(2.0 * 9.0 / 8))


def test_a_comparison_that_the_likelihood_rejects_is_not_cross_validated(scene: Scene) -> None:
    seen = scene.noisy(3)
    larger, smaller = models_of(scene, seen)
    likelihood = compare_likelihood(larger, smaller, seen)
    assert cross_validated(likelihood, larger, smaller, seen) is likelihood
    assert np.isnan(compare(larger, smaller, seen).held_out_gain)


def test_exact_corners_support_nothing(scene: Scene) -> None:
    """Differences of rounding errors are not significant."""
    comparison = compare(*models_of(scene, scene.clean), scene.clean)
    assert not comparison.supported
    assert comparison.drop < 1.0


def test_a_gain_is_significant_by_its_mean_or_by_nearly_all_frames() -> None:
    random = np.random.default_rng(0)
    even = 1.0 + 0.1 * random.standard_normal(20)
    few = np.append(even, [400.0, 300.0])
    assert gain_sigmas(even) > 20.0
    assert few.mean() / (few.std(ddof=1) / np.sqrt(len(few))) < 2.0 < gain_sigmas(few) < 6.0
    assert gain_sigmas(-even) < -20.0
    assert gain_sigmas(np.zeros(5)) == 0.0
    by_chance = [gain_sigmas(random.standard_normal(16)) for _ in range(2000)]
    assert np.mean(np.array(by_chance) > MIN_GAIN_SIGMAS) < 0.06
