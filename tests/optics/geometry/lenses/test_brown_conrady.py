"""The Brown-Conrady lens by hand; `test_camera` compares it with OpenCV's."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.lenses.brown_conrady import BrownConrady


def test_each_coefficient_moves_a_ray_as_its_formula_says() -> None:
    x, y = np.array(0.6), np.array(0.8)  # r = 1
    moved = [np.subtract(BrownConrady(row).distorted(x, y), (x, y)).tolist() for row in np.eye(5)]
    assert np.allclose(moved, [[0.6, 0.8], [0.6, 0.8], [0.96, 2.28], [1.72, 0.96], [0.6, 0.8]])


@pytest.mark.parametrize("axis", [0, 1])
def test_flipped_twice_it_is_itself_and_once_it_sees_the_flipped_picture(axis: int) -> None:
    lens = BrownConrady(np.array([0.1, -0.2, 3e-3, -5e-3, 0.04]))
    assert lens.flipped(axis).flipped(axis).coefficients.tolist() == lens.coefficients.tolist()
    signs = np.array([-1.0, 1.0] if axis == 0 else [1.0, -1.0])
    point = np.array([0.3, -0.2])
    assert lens.flipped(axis).distorted(*(signs * point)) == pytest.approx(signs * lens.distorted(*point))
