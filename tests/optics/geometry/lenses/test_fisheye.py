"""The fisheye lens: OpenCV's values and derivatives, the inverse up to 85 degrees, and the valid radius."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.fisheye import Fisheye
from tests.optics.geometry.lenses.cameras import LENSES, assert_comes_back, assert_derivatives, camera_of, points


@pytest.fixture(params=LENSES["fisheye"], ids=["equidistant", "mild", "strong"])
def camera(request: pytest.FixtureRequest) -> Camera:
    return camera_of("fisheye", request.param)


def test_it_projects_as_opencv_does_with_its_derivatives(camera: Camera) -> None:
    at = points(half_width=4.0)
    expected, jacobian = cv2.fisheye.projectPoints(at[None], np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    pixels, _, d_intrinsics = camera.project_with_jacobians(at)
    # OpenCV's columns: fx fy, cx cy, k1 to k4, rotation, translation, alpha.
    np.testing.assert_allclose(pixels, expected[0], atol=1e-9)
    np.testing.assert_allclose(d_intrinsics, jacobian.reshape(-1, 2, 15)[:, :, :8], rtol=1e-9, atol=1e-8)


def test_it_agrees_with_differences_and_is_inverted(camera: Camera) -> None:
    assert_derivatives(camera, points(40))
    assert_derivatives(camera, points(40, half_width=2.5))
    assert_comes_back(camera)
    assert camera.project(np.array([0.0, 0.0, 3.0])).tolist() == [camera.cx_px, camera.cy_px]


def test_a_wide_picture_comes_back_up_to_85_degrees() -> None:
    camera = camera_of("fisheye", LENSES["fisheye"][1])
    r, angle = np.meshgrid(np.tan(np.radians([1.0, 40.0, 70.0, 80.0, 85.0])), np.linspace(0.0, 6.0, 7))
    normalized = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)
    found = camera.normalized_from_pixels(camera.pixels_from_normalized(normalized))
    np.testing.assert_allclose(found, normalized, rtol=1e-8)
    beyond = camera.normalized_from_pixels(np.array([[camera.cx_px + 1.6 * camera.fx_px, camera.cy_px]]))
    assert np.isnan(beyond).all()


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ([0.0, 0.0, 0.0, 0.0], np.inf),
        ([-1 / 3, 0.0, 0.0, 0.0], np.tan(1.0)),  # a - a^3 / 3 turns at 1
        ([0.0, 0.0, 0.0, -1 / 9], np.tan(1.0)),
        ([-0.1, 0.0, 0.0, 0.0], np.inf),  # turns beyond 90 degrees
    ],
)
def test_it_is_defined_as_far_as_it_grows(coefficients: list[float], expected: float) -> None:
    assert Fisheye(np.array(coefficients)).valid_radius == pytest.approx(expected)
