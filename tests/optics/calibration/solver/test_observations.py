"""Observations: rows that are checked, joined and selected."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations


def test_invalid_observations_are_refused() -> None:
    one = np.array([0])
    with pytest.raises(ValueError, match="pixels has shape"):
        Observations(one, one, one, np.zeros((2, 2)))
    with pytest.raises(ValueError, match="NaN"):
        Observations(one, one, one, np.full((1, 2), np.nan))
    with pytest.raises(ValueError, match="sorted by frame"):
        Observations(np.array([1, 0]), np.array([0, 0]), np.array([0, 1]), np.zeros((2, 2)))
    with pytest.raises(ValueError, match="sigma_px holds"):
        Observations(one, one, one, np.zeros((1, 2)), np.zeros(1))
    assert len(Observations.join([])) == 0


def test_joining_sorts_by_frame_and_keeps_the_order_within_one() -> None:
    pixels = np.arange(8.0).reshape(4, 2)
    late = Observations.of_view(5, 2, np.array([7, 3]), pixels[:2])
    early = Observations.of_view(1, DIRECT, np.array([9, 0]), pixels[2:])
    joined = Observations.join([late, early])
    assert joined.frame.tolist() == [1, 1, 5, 5]
    assert joined.corner.tolist() == [9, 0, 7, 3]
    np.testing.assert_array_equal(joined.pixels, pixels[[2, 3, 0, 1]])
    np.testing.assert_array_equal(joined.with_frame_offset(3).frame, [4, 4, 8, 8])
    assert joined.where(joined.view == DIRECT).corner.tolist() == [9, 0]


def test_a_board_is_seen_both_ways_in_one_frame_only() -> None:
    mirrored = Observations.of_view(0, 1, np.array([7]), np.zeros((1, 2)))
    direct = Observations.of_view(0, DIRECT, np.array([7]), np.zeros((1, 2)))
    assert Observations.join([mirrored, direct]).direct_and_mirrored
    assert not Observations.join([mirrored, direct.with_frame_offset(1)]).direct_and_mirrored
    assert not direct.direct_and_mirrored


def test_standard_deviations_follow_their_rows() -> None:
    sigmas = np.array([0.5, 2.0])
    rows = Observations.of_view(4, 0, np.array([1, 2]), np.zeros((2, 2)), sigmas)
    equal = Observations.of_view(2, 0, np.array([3]), np.zeros((1, 2)))
    joined = Observations.join([rows, equal])
    assert joined.sigma_px.tolist() == [1.0, 0.5, 2.0]
    assert joined.where(joined.corner == 2).sigma_px.tolist() == [2.0]
    assert rows.with_frame_offset(1).sigma_px.tolist() == sigmas.tolist()
    np.testing.assert_array_equal(rows.standardised(np.ones((2, 2))), [[2.0, 2.0], [0.5, 0.5]])


def test_rows_cannot_be_changed() -> None:
    rows = Observations.of_view(0, 0, np.array([1]), np.zeros((1, 2)))
    with pytest.raises(ValueError, match="read-only"):
        rows.pixels[0, 0] = 1.0
