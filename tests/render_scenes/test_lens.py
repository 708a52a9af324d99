"""A camera off its model: waves of their size, there and back.

Undistorted pixels between nodes are those of the camera.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.lens import WavyCamera, as_it_is, undistorted_pixels
from mirrorcam.render_scenes.settings import SENSORS

LENS = Camera.c920().replaced(distortion=[0.05, -0.1, 0.001, 0.0, 0.0])
WAVY = as_it_is(LENS, SENSORS["ideal"].replaced(lens_waves_px=0.4))


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
    assert as_it_is(LENS, SENSORS["c920"]) is LENS


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
