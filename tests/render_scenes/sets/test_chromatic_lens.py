"""Light in pixels: lateral and axial chromatic aberration against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.chromatic_lens import light_of_pixels, magnified
from mirrorcam.render_scenes.settings import SensorModel

CAMERA = Camera(width_px=240, height_px=160, fx_px=300.0, fy_px=300.0, cx_px=100.0, cy_px=90.0)
SOFT_PX = 0.85


def spot(x: float, y: float, sigma: float = SOFT_PX) -> FloatArray:
    v, u = np.mgrid[:160, :240]
    return np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2.0 * sigma**2))


def middle_of(plane: NDArray[np.float32]) -> FloatArray:
    v, u = np.mgrid[:160, :240]
    weight = plane.astype(np.float64) / plane.sum(dtype=np.float64)
    return np.array([(weight * u).sum(), (weight * v).sum()])


@pytest.mark.parametrize("factor", [1.0, 1.0004, 0.996, 1.03])
def test_a_magnified_spot_is_where_the_factor_puts_it(factor: float) -> None:
    x, y = 204.3, 21.6
    found = magnified(spot(x, y).astype(np.float32), CAMERA, factor)
    moved = [100.0 + factor * (x - 100.0), 90.0 + factor * (y - 90.0)]
    np.testing.assert_allclose(middle_of(found), moved, atol=2e-3)


@pytest.mark.parametrize("factor", [1.0004, 0.996, 1.03])
def test_a_magnified_edge_is_as_sharp(factor: float) -> None:
    u = np.arange(240)
    for x in np.linspace(180.0, 181.0, 5):
        soft, moved = (
            ndtr((u - at) / sigma) for at, sigma in ((x, SOFT_PX), (100.0 + factor * (x - 100.0), SOFT_PX * factor))
        )
        found = magnified(np.tile(soft, (160, 1)).astype(np.float32), CAMERA, factor)
        np.testing.assert_allclose(found, np.tile(moved, (160, 1)), atol=0.008)


def test_the_border_goes_on_where_nothing_lies_beyond_it() -> None:
    flat = np.full((160, 240), 0.7, dtype=np.float32)
    np.testing.assert_allclose(magnified(flat, CAMERA, 0.95), 0.7, rtol=1e-5)


def test_red_is_larger_than_green_and_blue_smaller() -> None:
    model = SensorModel(lens_blur_px=SOFT_PX, lateral_chromatic_percent=0.5)
    grey = np.zeros((160, 240), dtype=np.float32)
    grey[40, 200] = 1.0
    light = light_of_pixels(grey, 1, CAMERA, model)
    for channel, factor in enumerate((1.005, 1.0, 0.995)):
        expected = [100.0 + factor * 100.0, 90.0 - factor * 50.0]
        np.testing.assert_allclose(middle_of(light[..., channel]), expected, atol=2e-3)


def test_red_and_blue_are_out_of_focus_where_green_is_not() -> None:
    model = SensorModel(lens_blur_px=1.5, axial_chromatic_px=2.0)
    white = np.zeros((160, 240, 3), dtype=np.float32)
    white[80, 120] = 1.0
    light = light_of_pixels(white, 1, CAMERA, model).astype(np.float64)
    v = np.arange(160)[:, None]
    variances = [(light[..., k] * (v - 80) ** 2).sum() / light[..., k].sum() for k in range(3)]
    np.testing.assert_allclose(variances, [6.25, 2.25, 6.25], rtol=0.02)


def test_a_lens_without_chromatic_aberration_keeps_grey_light_grey() -> None:
    assert light_of_pixels(np.ones((320, 480), dtype=np.float32), 2, CAMERA, SensorModel()).shape == (160, 240)
