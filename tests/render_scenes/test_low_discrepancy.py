"""Steps of additive recurrences: the known constants, and points that are spread evenly."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.low_discrepancy import additive_steps


def test_the_golden_ratio_and_the_plastic_number_are_known() -> None:
    assert additive_steps(1)[0] == pytest.approx(2.0 / (1.0 + 5.0**0.5), rel=1e-11)
    assert additive_steps(2) == pytest.approx((0.7548776662466927, 0.5698402909959032), rel=1e-11)


@pytest.mark.parametrize("dimensions", [4, 9])
def test_means_are_closer_than_those_of_random_points(dimensions: int) -> None:
    count = 4096
    points = np.arange(count)[:, None] * np.array(additive_steps(dimensions)) % 1.0
    error = np.abs(np.cos(2.0 * np.pi * points).mean(axis=0))
    assert error.max() < 0.1 / count**0.5
