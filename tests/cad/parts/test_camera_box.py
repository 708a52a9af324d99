"""A camera's body in rig: the pupil in the origin."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import camera_names, read_body


def test_the_body_of_the_c920_is_that_of_its_camera() -> None:
    box = body_box(read_body("c920"))
    np.testing.assert_allclose(np.array(Camera.c920().body_mm), [box.low, box.high])


@pytest.mark.parametrize("name", camera_names())
def test_the_body_stands_with_the_pupil_in_the_origin(name: str) -> None:
    camera, body = read_body(name), body_box(read_body(name))
    lens_from_middle = np.array([camera.lens_x_mm, camera.lens_y_mm, camera.depth_mm / 2.0])
    pupil = body.middle + lens_from_middle - np.array([0.0, 0.0, camera.pupil_behind_front_mm])
    np.testing.assert_allclose(pupil, 0.0, atol=1e-12)
