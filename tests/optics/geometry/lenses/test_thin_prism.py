"""The thin-prism lens: OpenCV's values and derivatives, and the way back."""

from __future__ import annotations

import cv2
import numpy as np

from tests.optics.geometry.lenses.cameras import LENSES, assert_comes_back, assert_derivatives, camera_of, points

CAMERA = camera_of("thin_prism", LENSES["thin_prism"][0])


def test_it_projects_as_opencv_does_with_its_derivatives() -> None:
    expected, jacobian = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), CAMERA.matrix, CAMERA.distortion)
    pixels, d_points, d_intrinsics = CAMERA.project_with_jacobians(points())
    jacobian = np.asarray(jacobian).reshape(-1, 2, 10 + 12)
    np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(d_points, jacobian[:, :, 3:6], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(d_intrinsics, jacobian[:, :, 6:], rtol=1e-9, atol=1e-8)


def test_it_agrees_with_differences_and_comes_back() -> None:
    assert_derivatives(CAMERA, points(40))
    assert_comes_back(CAMERA)


def test_without_a_prism_it_is_the_rational_lens() -> None:
    coefficients = LENSES["rational"][0]
    rational, prism = camera_of("rational", coefficients), camera_of("thin_prism", [*coefficients, 0, 0, 0, 0])
    np.testing.assert_array_equal(prism.project(points()), rational.project(points()))
    assert prism.valid_radius == rational.valid_radius
