"""From radiance to eight bits."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from optics.camera import Camera
from optics.values import FloatArray
from render_scenes.photograph import photograph
from render_scenes.settings import SensorModel

NO_NOISE = SensorModel(lens_blur_px=0.0, read_noise_grey=0.0)


def camera_of(width: int, height: int, focal_px: float = 1000.0) -> Camera:
    middle = {"cx_px": (width - 1) / 2.0, "cy_px": (height - 1) / 2.0}
    return Camera(width_px=width, height_px=height, fx_px=focal_px, fy_px=focal_px, **middle)


def shoot(radiance: FloatArray, cut: int, model: SensorModel, seed: int = 0) -> NDArray[np.uint8]:
    camera = camera_of(radiance.shape[1] // cut, radiance.shape[0] // cut)
    return photograph(radiance.astype(np.float32), cut, camera, model, np.random.default_rng(seed))


def test_radiance_one_is_white_and_more_is_clipped() -> None:
    levels = np.array([[0.0, 0.25, 0.5, 1.0, 3.0]])
    assert shoot(levels, 1, NO_NOISE).tolist() == [[0, 64, 128, 255, 255]]


def test_a_pixel_gathers_its_squares() -> None:
    fine = np.arange(24).reshape(4, 6) / 100.0
    expected = np.rint(255 * fine.reshape(2, 2, 3, 2).mean(axis=(1, 3)))
    np.testing.assert_array_equal(shoot(fine, 2, NO_NOISE), expected)


@pytest.mark.parametrize("cut", [1, 2])
def test_the_blur_has_its_sigma_in_pixels_and_its_middle_in_place(cut: int) -> None:
    point = np.zeros((41 * cut, 61 * cut))
    point[20 * cut : 21 * cut, 25 * cut : 26 * cut] = 10.0
    picture = shoot(point, cut, SensorModel(lens_blur_px=1.7, read_noise_grey=0.0)).astype(float)
    y, x = np.mgrid[:41, :61]
    weight = picture / picture.sum()
    assert (weight * x).sum() == pytest.approx(25.0, abs=1e-6)
    assert (weight * y).sum() == pytest.approx(20.0, abs=1e-6)
    # With fine squares the pixel's own width adds its variance, 1/12 - 1/12/cut^2.
    expected = 1.7**2 + (1.0 - 1.0 / cut**2) / 12.0
    assert (weight * (x - 25.0) ** 2).sum() == pytest.approx(expected, rel=0.03)
    assert (weight * (y - 20.0) ** 2).sum() == pytest.approx(expected, rel=0.03)


def test_noise_has_its_sigma_and_follows_its_seed() -> None:
    model = SensorModel(lens_blur_px=0.0, read_noise_grey=3.0)
    flat = np.full((200, 200), 0.5)
    picture = shoot(flat, 1, model)
    assert picture.astype(float).std() == pytest.approx(np.sqrt(9.0 + 1.0 / 12.0), rel=0.02)
    assert picture.astype(float).mean() == pytest.approx(127.5, abs=0.1)
    np.testing.assert_array_equal(picture, shoot(flat, 1, model))
    assert (picture != shoot(flat, 1, model, seed=1)).any()
