"""Splits and held-out frames: quiet where the model is right, loud where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.cross_validation import (
    Split,
    _quadratic,
    balanced_folds,
    held_out,
    held_out_residuals,
    is_mirrored,
    near_and_far,
    splits,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, fit
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT, NOISE_PX, Scene, scene_of

RANGE_MM = 420.0


def split_of(scene: Scene, seen: Observations) -> tuple[tuple[Split, ...], tuple[str, ...]]:
    solution = fit(scene.start, seen, JOINT)
    return splits(solution, seen, JOINT, scene.calibrated(solution), reference=3, range_mm=RANGE_MM)


def test_halves_differ_as_their_covariances_predict(scene: Scene) -> None:
    """The squared difference, in what is predicted, is chi squared: mean 1 per parameter (21), overall and per view."""
    overall, in_views, against = [], [], []
    for seed in range(10):
        found, notes = split_of(scene, scene.noisy(50 + seed))
        assert notes == ()
        assert [split.how for split in found] == ["into halves alike", "into near and far boards"]
        assert [split.alarm for split in found] == [None, None]
        overall += [split.overall_ratio**2 for split in found]
        in_views += [np.mean(split.ratio**2) for split in found]
        against += [np.nanmean(split.relative_ratio**2) for split in found]
    # 10 sets of 21 parameters, two splits of each that are not independent: a standard error of sqrt(2 / 210) = 0.1.
    assert np.mean(overall) == pytest.approx(1.0, abs=0.25)
    # A view's difference is mostly two or three weak directions: sqrt(2 / 2 / 10) = 0.3.
    assert np.mean(in_views) == pytest.approx(1.0, abs=0.8)
    assert np.mean(against) == pytest.approx(1.0, abs=0.8)


def test_a_wrong_model_raises_the_alarm(device: Layout) -> None:
    bowed = scene_of(device, warp_mm=0.3)
    found, _ = split_of(bowed, bowed.noisy(1))
    alarms = [split.alarm for split in found if split.alarm is not None]
    assert alarms
    assert "times what the halves' uncertainties predict" in alarms[0]


def test_a_claim_of_too_little_noise_raises_the_alarm(scene: Scene) -> None:
    """Noise that is the same on all corners of a view and frame is not what least squares takes it for."""
    seen = scene.noisy(2, noise_px=0.01)
    groups = 10 * seen.frame + seen.view + 1
    shift = np.random.default_rng(0).normal(0.0, 0.1, (groups.max() + 1, 2))
    found, _ = split_of(scene, replace(seen, pixels=seen.pixels + shift[groups]))
    assert any(split.alarm for split in found)


def test_the_law_of_a_sum_of_squares_is_that_of_draws() -> None:
    random = np.random.default_rng(4)
    root = random.normal(size=(5, 5))
    covariance = root @ root.T
    derivatives = random.normal(size=(30, 2, 5))
    draws = random.multivariate_normal(np.zeros(5), covariance, size=4000)
    found = np.array([_quadratic(derivatives, draw, covariance) for draw in draws])
    assert np.mean(found[:, 0] ** 2) == pytest.approx(found[0, 1] ** 2, rel=0.05)
    direct = np.sqrt(np.mean(np.sum((derivatives @ draws[0]) ** 2, axis=1)))
    assert found[0, 0] == pytest.approx(direct)
    for chance in (0.5, 0.1, 0.02):
        assert np.mean(found[:, 2] < chance) == pytest.approx(chance, rel=0.3)


def test_frames_are_dealt_so_that_halves_are_alike(scene: Scene) -> None:
    part = balanced_folds(scene.start, scene.clean, JOINT.board, 2)
    mirrored = is_mirrored(scene.clean, len(part))
    assert mirrored.sum() == 10
    assert [(part[mirrored] == half).sum() for half in (0, 1)] == [5, 5]
    assert abs((part[~mirrored] == 0).sum() - (part[~mirrored] == 1).sum()) <= 1
    middles = scene.poses[:, :3, :3] @ BOARD.corners_in_board_mm.mean(axis=0) + scene.poses[:, :3, 3]
    depth = np.linalg.norm(middles[mirrored], axis=1)
    gap = abs(depth[part[mirrored] == 0].mean() - depth[part[mirrored] == 1].mean())
    apart = near_and_far(scene.start, scene.clean, JOINT.board)
    gap_apart = abs(depth[apart[mirrored] == 0].mean() - depth[apart[mirrored] == 1].mean())
    assert gap < 0.5 * gap_apart
    assert (apart[~mirrored] == part[~mirrored]).sum() == (~mirrored).sum()


def test_frames_alike_go_to_different_halves(scene: Scene) -> None:
    """Each pose twice: whichever order they come in, no half has both."""
    twice = replace(scene.start, rig_from_board=np.repeat(scene.poses, 2, axis=0))
    parts = [
        replace(scene.clean, frame=2 * scene.clean.frame),
        replace(scene.clean, frame=2 * scene.clean.frame + 1),
    ]
    part = balanced_folds(twice, Observations.join(parts), JOINT.board, 2)
    assert (part[::2] != part[1::2]).all()


def test_too_few_frames_are_not_split_and_it_is_said(device: Layout) -> None:
    few = scene_of(device, mirrored=5)
    found, notes = split_of(few, few.noisy(0))
    assert found == ()
    assert notes[0] == "not split into halves alike: a half would have under 3 mirrored frames"


def test_held_out_frames_are_predicted_to_the_noise(scene: Scene, solution: Solution) -> None:
    seen = scene.noisy(0)
    out = np.zeros(15, dtype=bool)
    out[[2, 7]] = True
    held = held_out(solution.estimate, seen, JOINT, out)
    assert len(held.observations) == np.isin(seen.frame, [2, 7]).sum()
    assert np.all(held.rms_px < 1.2 * NOISE_PX)
    assert np.all(held.rms_px > 0.8 * NOISE_PX)


def rms(left: FloatArray) -> float:
    return float(np.sqrt(np.mean(left**2)))


def test_folds_leave_more_than_the_fit_and_see_every_corner_once(scene: Scene, solution: Solution) -> None:
    seen = scene.noisy(0)
    left = held_out_residuals(solution.estimate, seen, JOINT, balanced_folds(solution.estimate, seen, JOINT.board, 3))
    assert np.isfinite(left).all()
    assert rms(solution.residuals) < rms(left) < 1.1 * NOISE_PX


def test_a_held_out_frame_does_not_tell_its_own_prediction(scene: Scene, solution: Solution) -> None:
    """Corners of held-out frames may be anything: globals that predict them do not change."""
    seen = scene.noisy(0)
    out = np.zeros(15, dtype=bool)
    out[3] = True
    spoilt = replace(
        seen, pixels=seen.pixels + 5.0 * np.sin(np.arange(2 * len(seen))).reshape(-1, 2) * (seen.frame == 3)[:, None]
    )
    honest, other = (held_out(solution.estimate, rows, JOINT, out) for rows in (seen, spoilt))
    np.testing.assert_array_equal(honest.estimate.virtual_centres_in_rig_mm, other.estimate.virtual_centres_in_rig_mm)
    np.testing.assert_array_equal(honest.estimate.camera.intrinsics, other.estimate.camera.intrinsics)
    assert rms(other.residuals) > 10 * rms(honest.residuals)
