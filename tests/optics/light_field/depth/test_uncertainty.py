"""The uncertainty of depth, and its causes."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.refine import SHARED_ERROR_EXPONENT, Match
from mirrorcam.optics.light_field.depth.uncertainty import (
    COVERED,
    ELSEWHERE,
    HALVED_FACTOR,
    INFORMATION,
    MARGIN_EXPONENT,
    MIN_RIVALS,
    NOISE_EXPONENT,
    RELATED,
    RIVALS,
    ROUGHNESS_EXPONENT,
    SIGMA_PX,
    SMOOTHNESS,
    SURE_MARGIN,
    UNRELATED,
    USUAL_RIVALS,
    probability,
    standard_deviation_px,
)

ONES = np.ones((30, 40), np.float32)
RANGE_PX = 20.0
ALIKE = Match(*(ONES for _ in range(6)))


def sigma(
    information: float = INFORMATION,
    residual: float = 2.0,
    margin: float = 50.0,
    smoothness: float = 1.0,
    right: float = 1.0,
    halved: bool = False,
    views: int = 8,
) -> float:
    match = Match(information * ONES, 8 * ONES, 8 * ONES, residual * ONES, ONES, ONES)
    found_px = standard_deviation_px(match, smoothness * ONES, margin * ONES, right * ONES, views, halved, RANGE_PX)
    return float(found_px[15, 20])


def test_sigma_grows_with_noise_and_doubt_and_shrinks_with_information() -> None:
    assert sigma() == pytest.approx(SIGMA_PX)
    assert sigma(information=10 * INFORMATION) < 0.7 * sigma()
    assert sigma(residual=20.0) > 1.4 * sigma()
    assert sigma(margin=SURE_MARGIN / 10) == pytest.approx(10**MARGIN_EXPONENT * sigma())
    assert sigma(smoothness=0.8) == pytest.approx(0.8**-ROUGHNESS_EXPONENT * sigma())
    assert sigma(views=80) == pytest.approx(10 ** (SHARED_ERROR_EXPONENT * NOISE_EXPONENT) * sigma())
    assert sigma(halved=True) == pytest.approx(HALVED_FACTOR * sigma())


def test_sigma_is_as_wide_as_the_search_where_nothing_determines_the_depth() -> None:
    uniform = RANGE_PX / np.sqrt(12.0)
    narrow, *wider, widest = (sigma(right=right) for right in (COVERED, 0.5, 0.25, 0.0))
    assert narrow == pytest.approx(SIGMA_PX)
    assert widest == pytest.approx(uniform)
    assert narrow < wider[0] < wider[1] < widest
    # At even odds, the rest of COVERED is that part of the wrong half.
    assert wider[0] == pytest.approx(np.hypot(narrow, (COVERED - 0.5) / 0.5 / COVERED * uniform), rel=1e-4)
    assert sigma(information=0.0, margin=0.0, smoothness=0.0) <= uniform + 1e-4


def test_probability_falls_with_rivals_at_edges_and_where_a_surface_is_rough() -> None:
    flat = 3.0 * ONES

    def log_odds(found: np.ndarray) -> float:
        return float(np.log(found[15, 20] / (1.0 - found[15, 20])))

    no_rival, one_rival = (probability(flat, ALIKE, count * ONES, 0 * ONES, ONES, False) for count in (0, 1))
    assert log_odds(one_rival) == pytest.approx(ELSEWHERE + SMOOTHNESS + RIVALS * np.log(1 + MIN_RIVALS), rel=1e-4)
    assert log_odds(no_rival) - log_odds(one_rival) == pytest.approx(
        RIVALS * np.log(MIN_RIVALS / (1 + MIN_RIVALS)), rel=1e-3
    )
    assert probability(flat, ALIKE, ONES, 0 * ONES, 0.5 * ONES, False)[15, 20] < one_rival[15, 20]
    assert probability(flat, ALIKE, ONES, 0 * ONES, ONES, True)[15, 20] < one_rival[15, 20]
    uninformative = probability(flat, ALIKE, ONES, 9.0 * ONES, ONES, False)
    np.testing.assert_allclose(uninformative, one_rival / (1.0 + 9.0 - USUAL_RIVALS), rtol=1e-5)
    torn = flat + np.where(np.arange(40) > 20, np.float32(5.0), np.float32(0.0))
    found = probability(torn, ALIKE, ONES, 0 * ONES, ONES, False)[15]
    assert found[20] == found[21] < found[18] < found[10]


def test_without_agreement_of_views_no_depth_is_likely() -> None:
    unlike, hardly, blank = (
        Match(ONES, ONES, ONES, ONES, products * ONES, energies * ONES)
        for products, energies in ((0.0, 1.0), (0.5 * (UNRELATED + RELATED), 1.0), (0.0, 0.0))
    )
    usual, *found = (
        float(probability(3.0 * ONES, match, 0 * ONES, 0 * ONES, ONES, False)[15, 20])
        for match in (ALIKE, unlike, hardly, blank)
    )
    assert found == pytest.approx([0.0, 0.5 * usual, usual])
