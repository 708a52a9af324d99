"""Split-half tests: they raise an alarm only if the model is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.nested_models import fit_with
from mirrorcam.optics.calibration.diagnostics.split_half import Split, _quadratic, splits
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.diagnostics.conftest import JOINT, Scene, scene_of
from tests.optics.calibration.diagnostics.moving_boards import MovingBoards

RANGE_MM = 420.0


def split_of(scene: Scene, seen: Observations) -> tuple[tuple[Split, ...], tuple[str, ...]]:
    solution = fit(scene.start, seen, JOINT)
    return splits(solution, seen, JOINT, scene.calibrated(solution), reference=3, range_mm=RANGE_MM)


def test_halves_differ_as_their_covariances_predict(scene: Scene) -> None:
    """The normalised squared difference is chi squared: mean 1 per parameter (21), overall and per view."""
    overall, in_views, against = [], [], []
    for seed in range(10):
        found, notes = split_of(scene, scene.noisy(50 + seed))
        assert notes == ()
        assert [split.division for split in found] == ["into similar halves", "into near and far boards"]
        assert [split.alarm for split in found] == [None, None]
        overall += [split.overall_ratio**2 for split in found]
        in_views += [np.mean(split.ratio**2) for split in found]
        against += [np.nanmean(split.relative_ratio**2) for split in found]
    # 10 sets of 21 parameters, two splits of each that are not independent: a standard error of sqrt(2 / 210) = 0.1.
    assert np.mean(overall) == pytest.approx(1.0, abs=0.25)
    # A view's difference lies mostly in two or three weak directions: sqrt(2 / 2 / 10) = 0.3.
    assert np.mean(in_views) == pytest.approx(1.0, abs=0.8)
    assert np.mean(against) == pytest.approx(1.0, abs=0.8)


def test_a_wrong_model_raises_the_alarm(device: Layout) -> None:
    bowed = scene_of(device, warp_mm=0.3)
    found, _ = split_of(bowed, bowed.noisy(1))
    alarms = [split.alarm for split in found if split.alarm is not None]
    assert alarms
    assert "times what the halves' uncertainties predict" in alarms[0]


def test_halves_of_boards_in_motion_agree() -> None:
    """A model without acceleration left differences of near and far boards of 10 times the prediction and more."""
    boards = MovingBoards.of(2)
    seen = boards.noisy(0)
    fitted = fit_with("motion", boards.joint(seen), seen)
    layout = scene_of(boards.layout, mirrored=1, direct=0).calibrated(fitted.solution)
    found, notes = splits(fitted.solution, seen, fitted.model, layout, reference=0, range_mm=RANGE_MM)
    assert notes == ()
    assert [split.alarm for split in found] == [None, None]


def test_a_claim_of_too_little_noise_raises_the_alarm(scene: Scene) -> None:
    """Noise that all corners of a view and frame share is not independent, as least squares assumes."""
    seen = scene.noisy(2, noise_px=0.01)
    groups = 10 * seen.frame + seen.view + 1
    shift = np.random.default_rng(0).normal(0.0, 0.1, (groups.max() + 1, 2))
    found, _ = split_of(scene, replace(seen, pixels=seen.pixels + shift[groups]))
    assert any(split.is_harmful for split in found)


def test_a_difference_too_small_to_matter_is_harmless(scene: Scene) -> None:
    """Errors of 3e-4 px that corners share, in pictures nearly without noise."""
    seen = scene.noisy(2, noise_px=2e-4)
    groups = 10 * seen.frame + seen.view + 1
    shift = np.random.default_rng(0).normal(0.0, 3e-4, (groups.max() + 1, 2))
    found, _ = split_of(scene, replace(seen, pixels=seen.pixels + shift[groups]))
    assert any(split.alarm for split in found)
    assert not any(split.is_harmful for split in found)


def test_the_distribution_of_a_sum_of_squares_matches_draws() -> None:
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


def test_too_few_frames_are_not_split_but_noted(device: Layout) -> None:
    few = scene_of(device, mirrored=5)
    found, notes = split_of(few, few.noisy(0))
    assert found == ()
    assert notes[0] == "not split into similar halves: a half would have under 3 mirrored frames"
