"""Rigid transforms: the group axioms, for single and stacked transforms."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform

RANDOM = np.random.default_rng(0)


def random_transforms(count: int) -> FloatArray:
    return rigid(Rotation.random(count, random_state=1).as_matrix(), RANDOM.normal(size=(count, 3)))


def test_points_are_rotated_then_shifted() -> None:
    turn = Rotation.from_euler("z", 90.0, degrees=True).as_matrix()
    np.testing.assert_allclose(transform(rigid(turn, [10.0, 0.0, 3.0]), np.array([[1.0, 2.0, 0.0]])), [[8.0, 1.0, 3.0]])


def test_an_inverse_undoes_its_transform() -> None:
    made, points = random_transforms(5), RANDOM.normal(size=(7, 3))
    np.testing.assert_allclose(inverse(made) @ made, np.broadcast_to(np.eye(4), made.shape), atol=1e-15)
    np.testing.assert_allclose(inverse(made), np.linalg.inv(made), atol=1e-14)
    np.testing.assert_allclose(transform(inverse(made[2]), transform(made[2], points)), points, atol=1e-14)


def test_matrices_compose_as_transforms_do() -> None:
    (a_from_b, b_from_c), points = random_transforms(2), RANDOM.normal(size=(4, 2, 3))
    both = transform(a_from_b, transform(b_from_c, points))
    np.testing.assert_allclose(transform(a_from_b @ b_from_c, points), both, atol=1e-14)


def test_rotations_and_translations_broadcast() -> None:
    shifts = RANDOM.normal(size=(6, 3))
    made = rigid(np.eye(3), shifts)
    assert made.shape == (6, 4, 4)
    np.testing.assert_array_equal(made[:, :3, 3], shifts)
    np.testing.assert_array_equal(
        rigid(np.broadcast_to(np.eye(3), (6, 3, 3)), np.zeros(3)), rigid(np.eye(3), 0 * shifts)
    )
    np.testing.assert_array_equal(rigid(np.eye(3), np.zeros(3)), np.eye(4))
