"""Cameras with lenses of every family, and points in their view."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName

LENSES = {
    "rational": [[0.4, -0.1, 3e-4, -5e-4, 0.02, 0.5, -0.05, 0.01], [2.0, 0.5, 1e-3, 5e-4, 0.1, 2.3, 0.9, 0.15]],
    "thin_prism": [[0.1, -0.2, 3e-4, -5e-4, 0.05, 0.2, -0.1, 0.03, 1.5e-3, -8e-4, -1e-3, 6e-4]],
    "fisheye": [[0.0, 0.0, 0.0, 0.0], [-0.02, 0.006, -0.004, 0.001], [0.08, -0.03, 0.02, -0.01]],
}


def camera_of(model: LensName, distortion: list[float]) -> Camera:
    """A camera with unequal focal lengths and a principal point off the centre."""
    return Camera(
        width_px=1280,
        height_px=720,
        fx_px=900.0,
        fy_px=910.0,
        cx_px=650.25,
        cy_px=350.75,
        lens_model=model,
        distortion=np.array(distortion),
    )


def points(count: int = 200, half_width: float = 0.7) -> FloatArray:
    """Points (n, 3) in front of a camera, in mm."""
    random = np.random.default_rng(4)
    z = random.uniform(50, 2000, count)
    x, y = random.uniform(-half_width, half_width, count), random.uniform(-0.4, 0.4, count)
    return np.stack([x * z, y * z, z], axis=1)


def assert_derivatives(camera: Camera, at: FloatArray) -> None:
    """Derivatives by points and intrinsics agree with central differences."""
    pixels, d_points, d_intrinsics = camera.project_with_jacobians(at)
    np.testing.assert_allclose(pixels, camera.project(at), atol=1e-10)
    for column in range(3):
        step = 1e-4 * np.eye(3)[column]
        difference = (camera.project(at + step) - camera.project(at - step)) / 2e-4
        np.testing.assert_allclose(d_points[:, :, column], difference, rtol=1e-6, atol=1e-6)
    size = len(camera.intrinsic_names)
    assert d_intrinsics.shape == (len(at), 2, size)
    for column, name in enumerate(camera.intrinsic_names):
        h = 1e-2 if name.endswith("px") else 1e-6
        there, back = (camera.with_intrinsics(camera.intrinsics + sign * h * np.eye(size)[column]) for sign in (1, -1))
        difference = (there.project(at) - back.project(at)) / (2 * h)
        np.testing.assert_allclose(d_intrinsics[:, :, column], difference, rtol=1e-6, atol=3e-6, err_msg=name)


def assert_comes_back(camera: Camera) -> None:
    """Unprojection inverts projection over the entire sensor, and a flipped lens sees the flipped picture."""
    u, v = np.meshgrid(np.linspace(0, camera.width_px - 1, 33), np.linspace(0, camera.height_px - 1, 21))
    pixels = np.stack([u, v], axis=-1)
    np.testing.assert_allclose(camera.project(77.0 * camera.unproject(pixels)), pixels, atol=1e-8)
    x, y = np.random.default_rng(1).uniform(-0.5, 0.5, (2, 50))
    xd, yd = camera.lens.distorted(x, y)
    np.testing.assert_allclose(camera.lens.flipped(0).distorted(-x, y), [-xd, yd], atol=1e-14)
    np.testing.assert_allclose(camera.lens.flipped(1).distorted(x, -y), [xd, -yd], atol=1e-14)
