"""Common properties of lenses: the identity, and an approximate inverse within the valid radius."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.lenses.fisheye import Fisheye
from mirrorcam.optics.geometry.lenses.polynomial import BrownConrady


def test_only_a_lens_without_distortion_is_the_identity() -> None:
    assert BrownConrady(np.zeros(5)).is_identity
    assert not BrownConrady(np.array([0.0, 0.0, 1e-9, 0.0, 0.0])).is_identity
    assert not Fisheye(np.zeros(4)).is_identity


def test_the_approximate_inverse_stays_within_the_valid_radius() -> None:
    folding = BrownConrady(np.array([-1 / 3, 0.0, 0.0, 0.0, 0.0]))
    x, y = folding.undistorted_estimate(np.array([0.1, 3.0]), np.array([0.0, 4.0]))
    np.testing.assert_allclose([x, y], [[0.1, 0.57], [0.0, 0.76]])
