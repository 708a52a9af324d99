"""The rational lens: OpenCV's values and derivatives, the way back, and where it is defined."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.rational import Rational
from tests.optics.geometry.lenses.cameras import LENSES, assert_comes_back, assert_derivatives, camera_of, points

PRISM = camera_of("thin_prism", LENSES["thin_prism"][0])


@pytest.fixture(params=LENSES["rational"], ids=["mild", "strong"])
def camera(request: pytest.FixtureRequest) -> Camera:
    return camera_of("rational", request.param)


def test_it_projects_as_opencv_does_with_its_derivatives(camera: Camera) -> None:
    expected, jacobian = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    pixels, d_points, d_intrinsics = camera.project_with_jacobians(points())
    jacobian = np.asarray(jacobian).reshape(-1, 2, 10 + 8)
    np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(d_points, jacobian[:, :, 3:6], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(d_intrinsics, jacobian[:, :, 6:], rtol=1e-9, atol=1e-8)


def test_it_agrees_with_differences_and_comes_back(camera: Camera) -> None:
    assert_derivatives(camera, points(40))
    assert_comes_back(camera)


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ([0.0] * 8, np.inf),
        ([0, 0, 0, 0, 0, 1.0, 0, 0], 1.0),  # r / (1 + r^2)
        ([0, 0, 0, 0, 0, 0, 0, -1 / 64], 2.0),  # a pole, before which it grows
        ([-1 / 3, 0, 0, 0, 0, 0, 0, 0], 1.0),
        ([0.5, 0, 0, 0, 0, 0.5, 0, 0], np.inf),
    ],
)
def test_it_is_defined_as_far_as_it_grows(coefficients: list[float], expected: float) -> None:
    assert Rational(np.array(coefficients)).valid_radius == pytest.approx(expected)


def test_a_thin_prism_projects_as_opencv_does_with_its_derivatives() -> None:
    expected, jacobian = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), PRISM.matrix, PRISM.distortion)
    pixels, d_points, d_intrinsics = PRISM.project_with_jacobians(points())
    jacobian = np.asarray(jacobian).reshape(-1, 2, 10 + 12)
    np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(d_points, jacobian[:, :, 3:6], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(d_intrinsics, jacobian[:, :, 6:], rtol=1e-9, atol=1e-8)


def test_a_thin_prism_agrees_with_differences_and_comes_back() -> None:
    assert_derivatives(PRISM, points(40))
    assert_comes_back(PRISM)


def test_without_a_prism_it_is_the_rational_lens() -> None:
    coefficients = LENSES["rational"][0]
    rational, prism = camera_of("rational", coefficients), camera_of("thin_prism", [*coefficients, 0, 0, 0, 0])
    np.testing.assert_array_equal(prism.project(points()), rational.project(points()))
    assert prism.valid_radius == rational.valid_radius
