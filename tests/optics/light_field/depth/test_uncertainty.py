"""The standard deviation of depth, and its causes."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.refine import SHARED_ERROR_EXPONENT, Match
from mirrorcam.optics.light_field.depth.uncertainty import (
    COVERED,
    HALVED_FACTOR,
    INFORMATION,
    MARGIN_EXPONENT,
    NOISE_EXPONENT,
    NOISE_PX,
    NOISE_RATIO_LIMIT,
    ROUGHNESS_EXPONENT,
    SIGMA_PX,
    SURE_MARGIN,
    standard_deviation_px,
)

ONES = np.ones((30, 40), np.float32)
RANGE_PX = 20.0


def sigma(
    information: float = INFORMATION,
    residual: float = 2.0,
    margin: float = 50.0,
    smoothness: float = 1.0,
    right: float = 1.0,
    halved: bool = False,
    views: int = 8,
    noise_ratio: float = 0.0,
) -> float:
    match = Match(information * ONES, 8 * ONES, 8 * ONES, residual * ONES, ONES, ONES)
    found_px = standard_deviation_px(
        match,
        smoothness * ONES,
        margin * ONES,
        right * ONES,
        views=views,
        halved=halved,
        range_px=RANGE_PX,
        noise_ratio=noise_ratio,
    )
    return float(found_px[15, 20])


def test_sigma_grows_with_noise_and_doubt_and_shrinks_with_information() -> None:
    assert sigma() == pytest.approx(SIGMA_PX)
    assert sigma(information=10 * INFORMATION) < 0.7 * sigma()
    assert sigma(residual=20.0) > 1.4 * sigma()
    assert sigma(margin=SURE_MARGIN / 10) == pytest.approx(10**MARGIN_EXPONENT * sigma())
    assert sigma(smoothness=0.8) == pytest.approx(0.8**-ROUGHNESS_EXPONENT * sigma())
    assert sigma(views=80) == pytest.approx(10 ** (SHARED_ERROR_EXPONENT * NOISE_EXPONENT) * sigma())
    assert sigma(halved=True) == pytest.approx(HALVED_FACTOR * sigma())
    assert sigma(noise_ratio=NOISE_RATIO_LIMIT) == pytest.approx(
        np.hypot(sigma(), NOISE_PX * NOISE_RATIO_LIMIT / 2.0), rel=1e-4
    )


def test_sigma_is_as_wide_as_the_search_where_nothing_determines_the_depth() -> None:
    uniform = RANGE_PX / np.sqrt(12.0)
    narrow, *wider, widest = (sigma(right=right) for right in (COVERED, 0.5, 0.25, 0.0))
    assert narrow == pytest.approx(SIGMA_PX)
    assert widest == pytest.approx(uniform)
    assert narrow < wider[0] < wider[1] < widest
    # At even odds, the rest of COVERED is that part of the wrong half.
    assert wider[0] == pytest.approx(np.hypot(narrow, (COVERED - 0.5) / 0.5 / COVERED * uniform), rel=1e-4)
    assert sigma(information=0.0, margin=0.0, smoothness=0.0) <= uniform + 1e-4
