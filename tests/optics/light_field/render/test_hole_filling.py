"""Holes, against what lies behind them."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.render.hole_filling import filled

NAN = np.nan


def test_a_hole_is_filled_from_behind_and_not_from_the_edge_it_opened_at() -> None:
    line = np.array([0.2, 0.2, 0.9, 0.9, NAN, NAN, NAN, NAN, 0.3, 0.3], np.float32)
    shown = filled(np.tile(line, (9, 1)), 0.05)
    np.testing.assert_array_equal(shown[:, 4:8], np.float32(0.3))
    np.testing.assert_array_equal(shown[:, :4], np.tile(line[:4], (9, 1)))


def test_a_slope_behind_goes_on_by_what_is_close() -> None:
    slope = np.linspace(0.2, 0.3, 21, dtype=np.float32)
    holes = slope.copy()
    holes[8:13] = NAN
    shown = filled(np.tile(holes, (3, 1)), 0.2)
    assert np.abs(shown - slope).max() < 0.012


def test_cracks_in_what_is_near_stay_near() -> None:
    card = np.full((20, 20), 0.2, np.float32)
    card[5:15, 5:15] = 0.8
    card[:, 10] = NAN
    assert (filled(card, 0.05)[5:15, 10] == np.float32(0.8)).all()
    assert (filled(card, 0.05)[:5, 10] == np.float32(0.2)).all()


def test_corners_without_neighbours_are_filled_and_nothing_is_refused() -> None:
    corner = np.full((8, 9), NAN, np.float32)
    corner[0, 0] = 0.4
    np.testing.assert_allclose(filled(corner, 0.1), 0.4, rtol=1e-6)
    with pytest.raises(ValueError, match="a map of holes"):
        filled(np.full((3, 3), NAN, np.float32), 0.1)
