"""Comparison of nested models: against closed forms, and against the distribution under noise alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.model_comparison import (
    MIN_GAIN_SIGMAS,
    SUPPORTED_CHANCE,
    balanced_folds,
    compare,
    compare_likelihood,
    cross_validated,
    gain_sigmas,
    held_out_corners,
    held_out_residuals,
    is_mirrored,
    predict_held_out,
    smallest_model,
    split_by_distance,
)
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted, fit_as, joint_model, paper_model
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import FrameTerms
from mirrorcam.optics.calibration.solver.residuals import residuals
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT, NOISE_PX, Scene

CORNERS = BOARD.corners_in_board_mm


def models_of(scene: Scene, seen: Observations) -> tuple[Fitted, Fitted]:
    """The joint fit, and the one with the camera held at the truth."""
    paper = fit_as("paper", scene.start, seen, paper_model(CORNERS))
    return fit_as("joint", paper.solution.estimate, seen, joint_model(scene.start.camera, CORNERS)), paper


def test_the_smallest_model_has_no_comparison(scene: Scene) -> None:
    _, paper = models_of(scene, scene.noisy(0))
    entry = smallest_model(paper)
    assert entry.against is None
    assert entry.supported
    assert entry.parameters == 12
    assert np.isnan([entry.drop, entry.chance, entry.information_gain, entry.held_out_gain]).all()
    assert entry.rms_px == pytest.approx(np.sqrt(np.mean(paper.solution.residuals[paper.solution.inliers] ** 2)))


def test_free_intrinsics_explain_only_noise_if_the_camera_is_right(scene: Scene) -> None:
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


def test_exact_corners_support_no_larger_model(scene: Scene) -> None:
    """Differences of rounding errors are not significant."""
    comparison = compare(*models_of(scene, scene.clean), scene.clean)
    assert not comparison.supported
    assert comparison.drop < 1.0


def test_a_gain_is_significant_by_its_mean_or_if_nearly_all_frames_agree() -> None:
    random = np.random.default_rng(0)
    even = 1.0 + 0.1 * random.standard_normal(20)
    few = np.append(even, [400.0, 300.0])
    assert gain_sigmas(even) > 20.0
    assert few.mean() / (few.std(ddof=1) / np.sqrt(len(few))) < 2.0 < gain_sigmas(few) < 6.0
    assert gain_sigmas(-even) < -20.0
    assert gain_sigmas(np.zeros(5)) == 0.0
    by_chance = [gain_sigmas(random.standard_normal(16)) for _ in range(2000)]
    assert np.mean(np.array(by_chance) > MIN_GAIN_SIGMAS) < 0.06


def test_frames_are_split_into_similar_halves(scene: Scene) -> None:
    part = balanced_folds(scene.start, scene.clean, JOINT.board, 2)
    mirrored = is_mirrored(scene.clean, len(part))
    assert mirrored.sum() == 10
    assert [(part[mirrored] == half).sum() for half in (0, 1)] == [5, 5]
    assert abs((part[~mirrored] == 0).sum() - (part[~mirrored] == 1).sum()) <= 1
    middles = scene.poses[:, :3, :3] @ BOARD.corners_in_board_mm.mean(axis=0) + scene.poses[:, :3, 3]
    depth = np.linalg.norm(middles[mirrored], axis=1)
    gap = abs(depth[part[mirrored] == 0].mean() - depth[part[mirrored] == 1].mean())
    apart = split_by_distance(scene.start, scene.clean, JOINT.board)
    gap_apart = abs(depth[apart[mirrored] == 0].mean() - depth[apart[mirrored] == 1].mean())
    assert gap < 0.5 * gap_apart
    assert (apart[~mirrored] == part[~mirrored]).sum() == (~mirrored).sum()


def test_similar_frames_go_to_different_halves(scene: Scene) -> None:
    """Each pose occurs twice: in any order of frames, no half has both."""
    twice = scene.start.with_poses(np.repeat(scene.poses, 2, axis=0))
    parts = [
        replace(scene.clean, frame=2 * scene.clean.frame),
        replace(scene.clean, frame=2 * scene.clean.frame + 1),
    ]
    part = balanced_folds(twice, Observations.join(parts), JOINT.board, 2)
    assert (part[::2] != part[1::2]).all()


def test_held_out_frames_are_predicted_to_the_noise(scene: Scene, solution: Solution) -> None:
    seen = scene.noisy(0)
    out = np.zeros(15, dtype=bool)
    out[[2, 7]] = True
    held = predict_held_out(solution.estimate, seen, JOINT, out)
    assert len(held.observations) == np.isin(seen.frame, [2, 7]).sum()
    assert np.all(held.rms_px < 1.2 * NOISE_PX)
    assert np.all(held.rms_px > 0.8 * NOISE_PX)


def rms(left: FloatArray) -> float:
    return float(np.sqrt(np.mean(left**2)))


def test_folds_predict_every_corner_once_and_worse_than_the_fit(scene: Scene, solution: Solution) -> None:
    seen = scene.noisy(0)
    left = held_out_residuals(solution.estimate, seen, JOINT, balanced_folds(solution.estimate, seen, JOINT.board, 3))
    assert np.isfinite(left).all()
    assert rms(solution.residuals) < rms(left) < 1.1 * NOISE_PX


def test_bows_predict_corners_between_the_fitted_ones(scene: Scene, solution: Solution) -> None:
    """With a bow in each frame, corners are predicted down to the noise; without, they are not."""
    bows = np.random.default_rng(4).normal(0.0, 1.0, (15, 3))
    shift = residuals(replace(scene.start, bow_mm=bows), scene.clean, JOINT.board)
    seen = replace(scene.clean, pixels=scene.noisy(0).pixels + shift)
    fold = balanced_folds(solution.estimate, seen, JOINT.board, 3)
    bowed = replace(JOINT, frame_terms=FrameTerms(bow_per_mm=NOISE_PX))
    assert rms(held_out_corners(solution.estimate, seen, bowed, fold)) < 1.3 * NOISE_PX
    assert rms(held_out_corners(solution.estimate, seen, JOINT, fold)) > 3.0 * NOISE_PX


def test_a_held_out_frame_does_not_influence_its_own_prediction(scene: Scene, solution: Solution) -> None:
    """Corners of held-out frames may be arbitrary: the globals that predict them do not change."""
    seen = scene.noisy(0)
    out = np.zeros(15, dtype=bool)
    out[3] = True
    spoilt = replace(
        seen, pixels=seen.pixels + 5.0 * np.sin(np.arange(2 * len(seen))).reshape(-1, 2) * (seen.frame == 3)[:, None]
    )
    honest, other = (predict_held_out(solution.estimate, rows, JOINT, out) for rows in (seen, spoilt))
    np.testing.assert_array_equal(honest.estimate.virtual_centres_in_rig_mm, other.estimate.virtual_centres_in_rig_mm)
    np.testing.assert_array_equal(honest.estimate.camera.intrinsics, other.estimate.camera.intrinsics)
    assert rms(other.residuals) > 10 * rms(honest.residuals)
