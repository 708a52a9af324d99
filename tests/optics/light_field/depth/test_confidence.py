"""Confidence: limits of the log odds, and how often depth is right where it is stated to be likely."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.light_field_depth.kinds import Case, rooms
from benchmarks.light_field_depth.rooms import FAR_MM, NEAR_MM, room
from benchmarks.light_field_depth.training import calibration_error, fitted, tried
from mirrorcam.optics.light_field.depth.confidence import STATISTICS, LogOdds, log_odds, statistics
from mirrorcam.optics.light_field.depth.refine import Match

ONES = np.ones((30, 40), np.float32)


def test_statistics_are_those_that_training_used() -> None:
    match = Match(*(ONES for _ in range(6)))
    found = statistics(3.0 * ONES, match, ONES, ONES, range_px=20.0, views=8, halved=False, noise_ratio=1.0)
    odds = log_odds()
    assert found.shape == (len(STATISTICS), 30, 40)
    assert odds.lowest.shape == odds.highest.shape == odds.linear.shape == (len(STATISTICS),)
    assert odds.quadratic.shape == (len(STATISTICS),) * 2
    np.testing.assert_array_equal(odds.quadratic, odds.quadratic.T)
    assert 0.0 < odds.probability(found).min() <= odds.probability(found).max() < 1.0


def test_log_odds_are_a_quadratic_form_of_limited_statistics() -> None:
    odds = LogOdds(
        lowest=np.array([0.0, 10.0], np.float32),
        highest=np.array([2.0, 30.0], np.float32),
        constant=0.5,
        linear=np.array([1.0, -2.0], np.float32),
        quadratic=np.array([[0.1, 0.4], [0.4, -0.3]], np.float32),
    )
    values = np.array([[0.0, 1.0, 5.0], [20.0, 25.0, -99.0]], np.float32)[:, None]
    x, y = np.array([-1.0, 0.0, 1.0]), np.array([0.0, 0.5, -1.0])
    expected = 0.5 + x - 2 * y + 0.1 * x * x + 0.8 * x * y - 0.3 * y * y
    np.testing.assert_allclose(odds.probability(values)[0], 1 / (1 + np.exp(-expected)), rtol=1e-5)


def test_training_finds_the_log_odds_of_its_samples() -> None:
    random = np.random.default_rng(0)
    values = random.uniform(-1, 1, (2, 40_000)).astype(np.float32)
    true = 0.3 + 1.5 * values[0] - values[1] + 2.0 * values[0] * values[1]
    right = random.random(true.shape) < 1 / (1 + np.exp(-true))
    odds = fitted(values, right, np.ones(len(right)))
    found = odds.probability(values[:, None])[0]
    np.testing.assert_allclose(found, 1 / (1 + np.exp(-true)), atol=0.03)
    assert calibration_error(found, right) < 0.02


@pytest.mark.parametrize(("ramp_grey", "noise_grey"), [(0.0, 0.5), (0.0, 10.0), (30.0, 2.0), (30.0, 10.0)])
def test_a_bare_wall_has_no_sure_depth_and_a_sigma_as_wide_as_the_search(ramp_grey: float, noise_grey: float) -> None:
    light_field, truth = room(77, noise_grey, furnished=False, ramp_grey=ramp_grey)
    found = tried(Case("wall", "bare walls", light_field, truth, NEAR_MM, FAR_MM), "best")
    assert np.mean(found.confidence > 0.5) < 0.02
    assert np.mean(found.error_px > 3.0 * found.sigma_px) < 0.01
    range_px = light_field.focal_px * light_field.positions_mm[..., 0].max() * (1 / NEAR_MM - 1 / FAR_MM)
    assert np.median(found.sigma_px) == pytest.approx(range_px / np.sqrt(12), rel=0.1)


def test_a_ramp_is_measured_where_its_noise_allows() -> None:
    light_field, truth = room(77, 0.5, furnished=False, ramp_grey=30.0)
    found = tried(Case("wall", "bare walls", light_field, truth, NEAR_MM, FAR_MM), "best")
    assert found.right.mean() > 0.9
    assert found.right.mean() > found.confidence.mean() > 0.3
    assert np.mean(found.error_px > 3.0 * found.sigma_px) < 0.01


def test_confidence_holds_in_rooms_that_training_did_not_use() -> None:
    results = [tried(case, "best") for case in rooms(2001, 4)]
    stated = np.concatenate([result.confidence for result in results])
    right = np.concatenate([result.right for result in results])
    assert stated.mean() == pytest.approx(right.mean(), abs=0.06)
    assert calibration_error(stated, right) < 0.08
    assert right[stated > 0.9].mean() > 0.85
