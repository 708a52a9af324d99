"""Pins between pieces: frames of their holes, the wall round them, and the two places that are farthest apart."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.pin_joints import (
    clearance_round_pin_mm,
    farthest_pair,
    hole_depth_mm,
    hole_frame,
    hole_mm,
    reach_of_pin_mm,
)

DIAMETER, LENGTH = HARDWARE.holder.pin_mm


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_hole_runs_into_its_piece_with_its_roof_up(axis: int, side: float) -> None:
    frame = hole_frame(np.array([3.0, 4.0, 5.0]), axis, side)
    np.testing.assert_array_equal(frame[:3, 3], [3.0, 4.0, 5.0])
    np.testing.assert_array_equal(frame[:3, 2], side * np.eye(3)[axis])
    np.testing.assert_array_equal(frame[:3, 1], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3))
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_holes_are_wider_and_deeper_than_half_their_pin_and_keep_a_wall() -> None:
    wall = HARDWARE.printer.wall_mm
    assert hole_mm(HARDWARE) > DIAMETER
    assert 2.0 * hole_depth_mm(HARDWARE) > LENGTH
    assert reach_of_pin_mm(HARDWARE) - hole_depth_mm(HARDWARE) == pytest.approx(wall)
    # The ridge of the roof is two tangents of the hole away from its axis.
    ridge = hole_mm(HARDWARE) / 2.0 / np.sin(np.radians(42.0))
    assert clearance_round_pin_mm(HARDWARE) == pytest.approx(ridge + wall)


def test_the_farthest_two_of_points_are_found_and_none_of_none() -> None:
    pair, apart = farthest_pair(np.array([(0.0, 0.0), (3.0, 0.0), (1.0, 1.0), (3.0, 4.0)]))
    assert apart == 5.0
    assert {tuple(point) for point in pair} == {(0.0, 0.0), (3.0, 4.0)}
    assert farthest_pair(np.zeros((0, 2)))[1] == 0.0
    assert farthest_pair(np.ones((1, 2)))[1] == 0.0
