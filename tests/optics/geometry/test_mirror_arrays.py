"""Planes of virtual centres as arrays: against `Mirror`, and derivatives against finite differences."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror_arrays import dot, plane_axes, plane_of, plane_vjp
from tests.optics.geometry.followed_rays import mirror

CENTRES = np.array([[9.0, -80.0, 84.0], [-30.0, -75.0, 95.0], [0.0, -1.0, 60.0]]).T


def test_planes_are_those_of_mirrors() -> None:
    of = mirror()
    normal, distance_mm = plane_of(of.virtual_centre_in_rig_mm[:, None])
    assert_allclose(normal[:, 0], of.normal_in_rig)
    assert_allclose(distance_mm, of.distance_mm)
    # The pupil and its reflection are as far from the plane, on opposite sides.
    normals, distances_mm = plane_of(CENTRES)
    assert_allclose(dot(CENTRES, normals) + distances_mm, -distances_mm)


def test_axes_are_a_right_handed_frame_along_the_rig_x() -> None:
    # The last normal is the rig's x axis itself.
    normals = np.column_stack([plane_of(CENTRES)[0], [1.0, 0.0, 0.0]])
    x_axes, y_axes = plane_axes(normals)
    frames = np.stack([x_axes, y_axes, normals], axis=-1).transpose(1, 0, 2)
    assert_allclose(frames @ frames.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frames.shape), atol=1e-12)
    assert_allclose(np.linalg.det(frames), 1.0)
    assert (x_axes[0, :-1] > 0.5).all()
    assert_allclose(y_axes[0, :-1], 0.0, atol=1e-12)


def test_derivatives_of_planes_agree_with_finite_differences() -> None:
    random = np.random.default_rng(1)
    by_normal, by_distance = random.normal(size=(2, 3, 3)), random.normal(size=(2, 3))

    def value(centres: FloatArray) -> FloatArray:
        normal, distance_mm = plane_of(centres)
        return np.einsum("akn,kn->an", by_normal, normal) + by_distance * distance_mm

    found, h = plane_vjp(by_normal, by_distance, plane_of(CENTRES)), 1e-4
    for axis in range(3):
        step = h * np.eye(3)[:, axis : axis + 1]
        assert_allclose(found[:, axis], (value(CENTRES + step) - value(CENTRES - step)) / (2 * h), atol=1e-9)
