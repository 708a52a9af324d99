"""Convex solids against each other and against the light."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from mirrorcam.cad.plan.fasteners import ROOF_DEG
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import box, overlap_mm, require_clear_of_light, roofed_window, shifted, volume_mm3
from mirrorcam.cad.plan.seats import Frustum, keep_outs
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout

CUBE = box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))


def turned(solid: Frustum, angles: tuple[float, float, float]) -> Frustum:
    a, b, c = angles
    z = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    x = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(b), -np.sin(b)], [0.0, np.sin(b), np.cos(b)]])
    y = np.array([[np.cos(c), 0.0, np.sin(c)], [0.0, 1.0, 0.0], [-np.sin(c), 0.0, np.cos(c)]])
    return Frustum(solid.base @ (z @ x @ y).T, solid.top @ (z @ x @ y).T)


def shared_ball_mm(a: Frustum, b: Frustum) -> float:
    """Radius of the largest ball in both, below 0 if there is none: an independent test of overlap."""
    normals, offsets = (np.concatenate(pair) for pair in zip(a.half_spaces, b.half_spaces, strict=True))
    rows = np.column_stack([normals, np.ones(len(normals))])
    found = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=offsets, bounds=[(None, None)] * 4)
    return float(found.x[3])


def test_the_overlap_of_boxes_is_the_shift_that_separates_them() -> None:
    assert overlap_mm(CUBE, shifted(CUBE, np.array([1.7, 0.2, 0.5]))) == pytest.approx(0.3)
    assert overlap_mm(CUBE, shifted(CUBE, np.array([2.0, 0.0, 0.0]))) == pytest.approx(0.0, abs=1e-12)
    assert overlap_mm(CUBE, shifted(CUBE, np.array([2.5, 0.0, 0.0]))) == pytest.approx(-0.5)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_solids_overlap_exactly_if_they_share_a_ball(
    angles: tuple[float, float, float], shift: tuple[float, float, float]
) -> None:
    pyramid = Frustum(CUBE.base, np.array([[3.0, 1.0, 1.0]]))
    other = shifted(turned(pyramid, angles), np.array(shift))
    ball = shared_ball_mm(CUBE, other)
    if abs(ball) > 1e-6:
        assert (overlap_mm(CUBE, other) > 0.0) == (ball > 0.0)


def test_volumes() -> None:
    assert volume_mm3(CUBE) == pytest.approx(8.0)
    assert volume_mm3(Frustum(CUBE.base, np.array([[3.0, 1.0, 1.0]]))) == pytest.approx(4.0)
    # A window with a roof is a rectangle and a triangle.
    assert volume_mm3(roofed_window((0.0, 6.0), (1.0, 5.0), (0.0, 3.0))) == pytest.approx(
        3.0 * (6.0 * 4.0 + 4.0 / np.tan(np.deg2rad(ROOF_DEG)))
    )


def test_a_solid_in_the_light_is_refused_with_mirror_part_and_depth(fold_90_layout: Layout) -> None:
    light = keep_outs(fold_90_layout, HARDWARE)
    require_clear_of_light("box", [box((-5.0, -60.0, -5.0), (5.0, -50.0, 5.0))], fold_90_layout, light)
    middle = fold_90_layout.mirrors[4].outline_in_rig_mm.mean(axis=0)
    wall = box(tuple(middle - np.array([3.0, -30.0, 3.0])), tuple(middle + np.array([3.0, 31.0, 3.0])))
    with pytest.raises(InputError, match=r"light of mirror 1-1 enters the wall by 1\d\.\d mm, but must not touch it"):
        require_clear_of_light("wall", [wall], fold_90_layout, light)
