"""Polynomial lenses: values by hand and by OpenCV, derivatives, the inverse, and the valid radius."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.polynomial import BrownConrady, Rational
from tests.optics.geometry.lenses.cameras import LENSES, assert_comes_back, assert_derivatives, camera_of, points

PRISM = camera_of("thin_prism", LENSES["thin_prism"][0])


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


def test_it_agrees_with_differences_and_is_inverted(camera: Camera) -> None:
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
