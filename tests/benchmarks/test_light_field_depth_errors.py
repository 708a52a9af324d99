"""Errors of depth beside a truth, and how often stated probabilities hold, where the answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.light_field_depth import BORDER_PX
from benchmarks.light_field_depth_errors import BLOCK_PX, MeasuredScene, at_edges, reliability, sigma_px, wilson
from mirrorcam.optics.light_field.depth import DepthEstimator
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

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
        name="plane",
        views="3x3, step 4",
        against="true disparity",
        image=np.full((SIDE, SIDE, 3), 128, np.uint8),
        disparity_px=(error / 4.0).astype(np.float32),
        truth_px=np.zeros((SIDE, SIDE), np.float32),
        sigma_px=sigma,
        confidence=confidence.astype(np.float32),
        reach=4.0,
    )


def test_errors_are_of_the_farthest_view_and_leave_out_the_border_and_what_is_unknown() -> None:
    scene = drawn_scene()
    disparity = np.full((SIDE, SIDE), 0.25, np.float32)
    disparity[40, 50] = np.nan
    scene = replace(scene, disparity_px=disparity)
    assert scene.judged.sum() == (SIDE - 2 * BORDER_PX) ** 2 - 1
    assert not scene.judged[:BORDER_PX].any() and not scene.judged[40, 50]
    np.testing.assert_allclose(scene.error_px[scene.judged], 1.0)


def test_edges_are_those_of_depth_and_not_of_a_slanted_plane() -> None:
    v, u = np.mgrid[:60, :80].astype(np.float32)
    truth = 0.05 * u + 0.02 * v + np.where(u > 40, np.float32(1.0), np.float32(0.0))
    found = at_edges(truth.astype(np.float32))
    assert found[:, 37:45].all()
    assert not found[:, 5:34].any()


def test_errors_in_sigmas_leave_out_edges_of_depth() -> None:
    scene = drawn_scene()
    truth = np.where(np.arange(SIDE) > 100, np.float32(1.0), np.float32(0.0)) * np.ones((SIDE, 1), np.float32)
    scene = replace(scene, truth_px=truth, disparity_px=truth + np.float32(0.01), sigma_px=np.full((SIDE, SIDE), 0.02))
    np.testing.assert_allclose(scene.flat_sigmas, 2.0, rtol=1e-4)
    assert scene.flat_sigmas.size == (scene.judged & ~at_edges(truth)).sum() < scene.judged.sum()


def test_sigma_of_a_pixel_is_less_depth_nearer_by() -> None:
    light_field, _, _ = photograph(grid_views(uneven=False), [Surface(420.0, slope=(0.2, 0.1))])
    found = DepthEstimator(light_field).estimate(light_field)
    near = found.depth_mm < np.nanmedian(found.depth_mm)
    per_mm = sigma_px(found) / found.sigma_mm
    assert np.nanmedian(per_mm[near]) > np.nanmedian(per_mm[~near])


def test_a_true_probability_is_on_the_diagonal_and_an_overstated_one_below() -> None:
    for each in reliability([drawn_scene()], BOUNDS):
        assert each.low <= each.stated <= each.high
        assert each.high - each.low < 0.03
    for each in reliability([drawn_scene(overstated=0.2)], BOUNDS)[1:]:
        assert each.high < each.stated - 0.15


def test_classes_share_out_all_pixels_those_at_the_last_bound_too() -> None:
    scene = drawn_scene()
    confidence = scene.confidence.copy()
    confidence[100:120] = 1.0
    confidence[confidence < 0.25] = 0.25
    classes = reliability([replace(scene, confidence=confidence)] * 2, BOUNDS)
    assert len(classes) == 3
    assert sum(each.count for each in classes) == 2 * scene.judged.sum()


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


def test_wilsons_interval_holds_as_often_as_it_says() -> None:
    """Coverage of binomial shares, by the binomial distribution itself."""
    from scipy.stats import binom

    for share in (0.02, 0.3, 0.9):
        ends = [wilson(hits / 80, 80) for hits in range(81)]
        held = [low <= share <= high for low, high in ends]
        assert 0.92 < float(binom.pmf(np.arange(81), 80, share) @ np.array(held)) < 0.99
    assert wilson(1.0, 50)[0] > 0.9 and wilson(1.0, 50)[1] == pytest.approx(1.0)
    assert wilson(0.0, 50)[0] == pytest.approx(0.0, abs=1e-12)
