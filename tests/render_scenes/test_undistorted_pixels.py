"""Undistorted pixels between nodes are those of the camera."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.undistorted_pixels import undistorted_pixels


def test_pixels_between_nodes_are_undistorted_as_the_camera_does() -> None:
    camera = Camera.c920().replaced(distortion=[0.08, -0.18, 0.001, -0.0005, 0.02])
    u, v = np.array([-0.5, 3.3, 700.7, 1919.5]), np.array([-0.5, 500.1, 1079.5])
    found = undistorted_pixels(camera, u, v)
    assert found.shape == (3, 4, 2)
    np.testing.assert_allclose(camera.pixels_from_normalized(found), np.stack(np.meshgrid(u, v), axis=-1), atol=2e-7)
