"""The benchmark's scores, on errors put in by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.light_field_depth import BORDER_PX, bad_pixels, mean_square_error


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
