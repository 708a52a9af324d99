"""Blur out of focus, against the circle of confusion."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.preview.focus_blur import out_of_focus

CAMERA = Camera.c920().binned(0.25).replaced(aperture_mm=8.0, focus_mm=500.0)


def test_what_is_in_focus_or_before_a_pinhole_stays() -> None:
    picture = np.random.default_rng(0).random((40, 50, 3)).astype(np.float32)
    assert out_of_focus(picture, np.full((40, 50), 500.0), CAMERA) is picture
    assert out_of_focus(picture, np.full((40, 50), 200.0), CAMERA.replaced(aperture_mm=0.0)) is picture


@pytest.mark.parametrize("distance", [250.0, 350.0, np.inf])
def test_a_point_gets_the_variance_of_its_circle_of_confusion(distance: float) -> None:
    picture = np.zeros((81, 81, 3), np.float32)
    picture[40, 40] = 1.0, 2.0, 3.0
    blurred = out_of_focus(picture, np.full((81, 81), distance), CAMERA)
    np.testing.assert_allclose(blurred.sum(axis=(0, 1)), [1.0, 2.0, 3.0], rtol=1e-3)
    places = np.arange(81) - 40.0
    variance = (blurred[..., 0].sum(axis=0) * places**2).sum()
    diameter = CAMERA.fx_px * 8.0 * abs(1.0 / 500.0 - 1.0 / distance)
    assert variance == pytest.approx(diameter**2 / 16.0, rel=0.03)
