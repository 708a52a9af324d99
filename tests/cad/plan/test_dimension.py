"""Dimensions in rig: the span of a length, in full and along a direction; which plans offer any."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.plan.dimension import Dimensioned, Length
from mirrorcam.cad.plan.hardware import HARDWARE


def test_a_length_along_a_direction_is_the_projection_of_its_span() -> None:
    ends = np.array([(1.0, 2.0, 3.0), (4.0, 6.0, 3.0)])
    np.testing.assert_array_equal(Length(ends).span_in_rig, [3.0, 4.0, 0.0])
    np.testing.assert_array_equal(Length(ends, way_in_rig=np.array([0.0, 1.0, 0.0])).span_in_rig, [0.0, 4.0, 0.0])
    across = Length(ends, way_in_rig=np.array([0.8, -0.6, 0.0])).span_in_rig
    np.testing.assert_allclose(across, np.zeros(3), atol=1e-12)


def test_plans_with_dimensions_are_known_by_them() -> None:
    assert isinstance(plan_clip(HARDWARE), Dimensioned)
    assert not isinstance(HARDWARE, Dimensioned)
