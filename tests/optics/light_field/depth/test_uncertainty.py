"""How sure depth is: what makes it less sure."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.refine import Match
from mirrorcam.optics.light_field.depth.uncertainty import (
    ELSEWHERE,
    INFORMATION,
    SIGMA_PX,
    SURE_MARGIN,
    probability,
    standard_deviation_px,
)

ONES = np.ones((30, 40), np.float32)


def sigma(information: float = INFORMATION, residual: float = 2.0, margin: float = 50.0, smooth: float = 1.0) -> float:
    match = Match(information * ONES, 8 * ONES, 8 * ONES, residual * ONES)
    return float(standard_deviation_px(match, smooth * ONES, margin * ONES, 8, 20.0)[15, 20])


def test_sigma_grows_with_noise_and_doubt_and_shrinks_with_information() -> None:
    assert sigma() == pytest.approx(SIGMA_PX)
    assert sigma(information=10 * INFORMATION) < 0.7 * sigma()
    assert sigma(residual=20.0) > 1.4 * sigma()
    assert sigma(margin=SURE_MARGIN / 10) == pytest.approx(10 * sigma())
    assert sigma(smooth=0.5) == pytest.approx(8 * sigma())
    # Never more than that of any depth of the range being as likely.
    assert sigma(information=0.0, margin=0.0) <= 20.0 / np.sqrt(12.0) + 1e-4


def test_probability_is_shared_among_rivals_and_lost_where_no_view_shows_the_same() -> None:
    level = 3.0 * ONES
    assert probability(level, 0 * ONES, 0.2 * ONES)[15, 20] == pytest.approx(ELSEWHERE)
    assert probability(level, ONES, 0.2 * ONES)[15, 20] == pytest.approx(ELSEWHERE / 2)
    assert probability(level, 0 * ONES, ONES).max() == 0.0
    torn = level + np.where(np.arange(40) > 20, np.float32(5.0), np.float32(0.0))
    found = probability(torn, 0 * ONES, 0.2 * ONES)[15]
    assert found[20] == found[21] < found[18] < found[10]
