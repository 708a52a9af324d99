"""A camera that deviates from its model by waves: amplitude, and projection and its inverse.

Undistorted pixels between nodes are those of the camera.

Defocus against its closed form: the variance of the circle of confusion of a thin lens.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.lens import WavyCamera, defocused, true_camera, undistorted_pixels
from mirrorcam.render_scenes.settings import SENSORS

LENS = Camera.c920().replaced(distortion=[0.05, -0.1, 0.001, 0.0, 0.0])
WAVY = true_camera(LENS, SENSORS["ideal"].replaced(lens_waves_px=0.4))


@pytest.fixture(scope="module")
def pixels() -> FloatArray:
    return np.stack(np.meshgrid(np.arange(0.0, 1920.0, 16), np.arange(0.0, 1080.0, 16)), axis=-1)


def test_waves_have_their_rms(pixels: FloatArray) -> None:
    moved = WAVY.project(LENS.unproject(pixels)) - pixels
    assert np.sqrt(np.mean(moved**2, axis=(0, 1))) == pytest.approx(0.4, rel=0.1)


def test_a_ray_comes_back_to_its_pixel(pixels: FloatArray) -> None:
    np.testing.assert_allclose(WAVY.project(WAVY.unproject(pixels)), pixels, atol=1e-6)


def test_a_pixel_sees_what_the_model_sees_beside_it() -> None:
    """A quarter of a wave to the right of the origin: sin a_x = 1, cos a_y = 1."""
    at = np.array([1920.0 / 8.0, 0.0])
    np.testing.assert_allclose(WAVY.unproject(at), LENS.unproject(at - [0.8, 0.0]), atol=1e-9)


def test_a_lens_without_waves_is_that_of_its_model() -> None:
    assert true_camera(LENS, SENSORS["c920"]) is LENS


def test_a_layout_is_saved_with_the_model_alone(small_layout: Layout) -> None:
    camera = WavyCamera(**small_layout.camera.model_dump(), waves_px=0.4)
    wavy = small_layout.replaced(camera=camera)
    assert isinstance(wavy.camera, WavyCamera)
    assert wavy.identity == small_layout.identity
    assert wavy.model_dump_json() == small_layout.model_dump_json()


def test_pixels_between_nodes_are_undistorted_as_the_camera_does() -> None:
    camera = Camera.c920().replaced(distortion=[0.08, -0.18, 0.001, -0.0005, 0.02])
    u, v = np.array([-0.5, 3.3, 700.7, 1919.5]), np.array([-0.5, 500.1, 1079.5])
    found = undistorted_pixels(camera, u, v)
    assert found.shape == (3, 4, 2)
    np.testing.assert_allclose(camera.pixels_from_normalized(found), np.stack(np.meshgrid(u, v), axis=-1), atol=2e-7)


def variances(sigmas_px: list[float], subpixels: int) -> list[float]:
    """Variances (px^2) across lines, 41 px apart, of a view whose defocus grows from line to line."""
    width = 41 * subpixels
    lines = np.zeros((50, width * len(sigmas_px)), dtype=np.float32)
    lines[:, width // 2 :: width] = 1.0
    sigma = np.broadcast_to(np.repeat(sigmas_px, width).astype(np.float32), lines.shape)
    row = defocused(lines, sigma**2, subpixels)[25].reshape(len(sigmas_px), width)
    x = (np.arange(width) - width // 2) / subpixels
    return [float((light * x**2).sum() / light.sum()) for light in row]


@pytest.mark.parametrize("subpixels", [1, 2])
@pytest.mark.parametrize(
    "sigmas_px", [[0.0, 0.5, 1.0, 1.5, 2.0], [0.0, 0.05, 0.1, 0.2], [0.04], [0.1], [0.3, 0.3], [1.0, 1.1], [3.0]]
)
def test_each_line_is_blurred_by_its_own_sigma(sigmas_px: list[float], subpixels: int) -> None:
    """Blur smaller than the least sigma of a Gaussian sampled in each subpixel is exact, too."""
    expected = np.square(sigmas_px)
    np.testing.assert_allclose(variances(sigmas_px, subpixels), expected, rtol=0.02, atol=1e-4)


def test_a_picture_in_focus_is_not_changed() -> None:
    picture = np.random.default_rng(0).random((40, 60)).astype(np.float32)
    np.testing.assert_array_equal(defocused(picture, np.zeros((40, 60), dtype=np.float32), 1), picture)
    blurred = defocused(picture, np.full((40, 60), 2.25, dtype=np.float32), 1)
    assert blurred.std() < 0.5 * picture.std()
    assert blurred.mean() == pytest.approx(picture.mean(), rel=0.02)
