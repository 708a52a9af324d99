"""Scores on errors put in by hand; how often stated probabilities hold, where the answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.light_field_depth.reliability import BLOCK_PX, MeasuredScene, at_edges, reliability
from benchmarks.light_field_depth.stereo import BORDER_PX, bad_pixels, mean_square_error


def test_scores_count_what_is_inside_the_border() -> None:
    truth = np.zeros((50, 60))
    found = truth.copy()
    found[:BORDER_PX] = 9.0
    assert bad_pixels(found, truth) == 0.0
    assert mean_square_error(found, truth) == 0.0
    found[20, 15:45] = [0.069] * 15 + [-0.071] * 15
    assert bad_pixels(found, truth) == pytest.approx(15 / 600)
    assert mean_square_error(found, truth) == pytest.approx(100 * 15 * (0.069**2 + 0.071**2) / 600)


def test_no_estimate_is_bad_and_no_truth_does_not_count() -> None:
    truth, found = np.zeros((50, 60)), np.zeros((50, 60))
    found[25, 15:21] = np.nan
    found[25, 21:23] = 1.0
    truth[30] = np.nan
    assert bad_pixels(found, truth) == pytest.approx(8 / 570)
    assert bad_pixels(found, truth, 2.0) == pytest.approx(6 / 570)
    assert mean_square_error(found, truth) == pytest.approx(100 * 2 / 564)


SIDE = 8 * BLOCK_PX
BOUNDS = (0.0, 0.25, 0.5, 0.75, 1.0)


def drawn_scene(*, block_px: int = 1, overstated: float = 0.0, seed: int = 1) -> MeasuredScene:
    """A plane whose depth is right just as often as its confidence says, less `overstated`, with normal errors of the
    stated sigma; pixels of a square of `block_px` are right or wrong together."""
    random = np.random.default_rng(seed)
    few = (SIDE // block_px,) * 2
    confidence = np.kron(random.uniform(0.0, 1.0, few), np.ones((block_px,) * 2))
    wrong = np.kron(random.uniform(0.0, 1.0, few), np.ones((block_px,) * 2)) > confidence - overstated
    sigma = random.uniform(0.02, 0.1, (SIDE, SIDE))
    error = sigma * random.standard_normal((SIDE, SIDE)) + 3.0 * wrong
    return MeasuredScene(
        disparity_px=(error / 4.0).astype(np.float32),
        truth_px=np.zeros((SIDE, SIDE), np.float32),
        sigma_px=sigma,
        confidence=confidence.astype(np.float32),
        farthest_steps=4.0,
    )


def test_edges_are_those_of_depth_and_not_of_a_slanted_plane() -> None:
    v, u = np.mgrid[:60, :80].astype(np.float32)
    truth = 0.05 * u + 0.02 * v + np.where(u > 40, np.float32(1.0), np.float32(0.0))
    found = at_edges(truth.astype(np.float32))
    assert found[:, 37:45].all()
    assert not found[:, 5:34].any()


def test_a_true_probability_is_on_the_diagonal_and_an_overstated_one_below() -> None:
    for each in reliability([drawn_scene()], BOUNDS):
        assert each.low <= each.stated <= each.high
        assert each.high - each.low < 0.03
    for each in reliability([drawn_scene(overstated=0.2)], BOUNDS)[1:]:
        assert each.high < each.stated - 0.15


@pytest.mark.parametrize(("block_px", "within"), [(1, (0.5, 1.5)), (BLOCK_PX // 2, (8.0, 24.0))])
def test_the_interval_is_as_wide_as_what_errs_together(block_px: int, within: tuple[float, float]) -> None:
    """Half of the interval over 1.96 is the spread of the share among scenes drawn anew."""
    found = [reliability([drawn_scene(block_px=block_px, seed=seed)], (0.0, 1.0))[0] for seed in range(30)]
    spread = float(np.std([each.right - each.stated for each in found]))
    stated = float(np.mean([each.high - each.low for each in found])) / (2 * 1.96)
    # Of shares about the stated mean; that of the mean itself is as wide again.
    assert 0.6 * spread < stated < 2.0 * spread
    alone = 0.5 / np.sqrt(found[0].count)
    assert within[0] < stated / alone < within[1]
