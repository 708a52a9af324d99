"""Light in pixels: lateral and axial chromatic aberration against closed forms.

Processing of raw pictures: against closed forms.

From radiance to eight bits: each flaw of a sensor against its closed form.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.sensor_model import (
    demosaic,
    magnify,
    mosaic,
    photograph,
    pixel_irradiance,
    process,
    srgb,
)
from mirrorcam.render_scenes.settings import SENSORS, SensorModel

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
    found = magnify(spot(x, y).astype(np.float32), CAMERA, factor)
    moved = [100.0 + factor * (x - 100.0), 90.0 + factor * (y - 90.0)]
    np.testing.assert_allclose(middle_of(found), moved, atol=2e-3)


@pytest.mark.parametrize("factor", [1.0004, 0.996, 1.03])
def test_a_magnified_edge_is_as_sharp(factor: float) -> None:
    u = np.arange(240)
    for x in np.linspace(180.0, 181.0, 5):
        soft, moved = (
            ndtr((u - at) / sigma) for at, sigma in ((x, SOFT_PX), (100.0 + factor * (x - 100.0), SOFT_PX * factor))
        )
        found = magnify(np.tile(soft, (160, 1)).astype(np.float32), CAMERA, factor)
        np.testing.assert_allclose(found, np.tile(moved, (160, 1)), atol=0.008)


def test_the_border_goes_on_where_nothing_lies_beyond_it() -> None:
    flat = np.full((160, 240), 0.7, dtype=np.float32)
    np.testing.assert_allclose(magnify(flat, CAMERA, 0.95), 0.7, rtol=1e-5)


def test_red_is_larger_than_green_and_blue_smaller() -> None:
    model = SensorModel(lens_blur_px=SOFT_PX, lateral_chromatic_percent=0.5)
    grey = np.zeros((160, 240), dtype=np.float32)
    grey[40, 200] = 1.0
    light = pixel_irradiance(grey, 1, CAMERA, model)
    for channel, factor in enumerate((1.005, 1.0, 0.995)):
        expected = [100.0 + factor * 100.0, 90.0 - factor * 50.0]
        np.testing.assert_allclose(middle_of(light[..., channel]), expected, atol=2e-3)


def test_red_and_blue_are_out_of_focus_where_green_is_not() -> None:
    model = SensorModel(lens_blur_px=1.5, axial_chromatic_px=2.0)
    white = np.zeros((160, 240, 3), dtype=np.float32)
    white[80, 120] = 1.0
    light = pixel_irradiance(white, 1, CAMERA, model).astype(np.float64)
    v = np.arange(160)[:, None]
    variances = [(light[..., k] * (v - 80) ** 2).sum() / light[..., k].sum() for k in range(3)]
    np.testing.assert_allclose(variances, [6.25, 2.25, 6.25], rtol=0.02)


def test_a_lens_without_chromatic_aberration_keeps_grey_light_grey() -> None:
    assert pixel_irradiance(np.ones((320, 480), dtype=np.float32), 2, CAMERA, SensorModel()).shape == (160, 240)


PLAIN = SensorModel(lens_blur_px=0.0, read_noise_grey=0.0)
RED, GREEN, BLUE = range(3)


def test_each_pixel_of_a_mosaic_has_one_colour() -> None:
    light = np.random.default_rng(0).random((6, 8, 3)).astype(np.float32)
    raw = mosaic(light)
    for row in range(6):
        for column in range(8):
            colour = RED if row % 2 == column % 2 == 0 else BLUE if row % 2 == column % 2 == 1 else GREEN
            assert raw[row, column] == light[row, column, colour]


def test_a_mosaic_of_an_even_colour_is_filled_in_with_it() -> None:
    colour = np.array([200.0, 90.5, 17.25], dtype=np.float32)
    raw = mosaic(np.tile(colour, (12, 16, 1)))
    np.testing.assert_allclose(demosaic(raw), np.tile(colour, (12, 16, 1)), atol=1.0 / 256)


def test_a_slope_of_light_passes_through_the_mosaic() -> None:
    """Interpolation is exact for a plane, two pixels from the border."""
    v, u = np.mgrid[:20, :24].astype(np.float32)
    light = np.stack([20.0 + 3.0 * u + v, 40.0 + 2.0 * u + 3.0 * v, 90.0 + u - v], axis=-1)
    np.testing.assert_allclose(demosaic(mosaic(light))[2:-2, 2:-2], light[2:-2, 2:-2], atol=0.51 + 1.0 / 256)


def test_a_sensor_with_a_mosaic_is_white_at_most() -> None:
    assert demosaic(np.full((8, 8), 400.0, dtype=np.float32)).max() == 255.0
    assert demosaic(np.full((8, 8), -3.0, dtype=np.float32)).min() == 0.0


@pytest.mark.parametrize(("linear", "coded"), [(0.0, 0.0), (0.002, 0.02584), (0.2140411, 0.5), (1.0, 1.0)])
def test_the_tone_curve_is_that_of_its_standard(linear: float, coded: float) -> None:
    assert srgb(np.array(linear)) == pytest.approx(coded, abs=1e-5)
    grey = np.full((4, 4), 255.0 * linear, dtype=np.float32)
    np.testing.assert_allclose(process(grey, PLAIN.replaced(tone_curve="srgb")), 255.0 * coded, atol=0.03)


def test_unsharp_masking_raises_contrast_by_its_amount_where_the_blur_takes_all_of_it() -> None:
    """A wave loses exp(-(sigma k)^2 / 2) of its amplitude by the blur; the amount times the loss is added."""
    u = np.arange(400)
    for period in (4.0, 12.0):
        k = 2.0 * np.pi / period
        wave = np.tile(120.0 + 50.0 * np.sin(k * u), (8, 1)).astype(np.float32)
        sharp = process(wave, PLAIN.replaced(sharpening=0.8))
        gain = 1.0 + 0.8 * (1.0 - np.exp(-(k**2) / 2.0))
        np.testing.assert_allclose(sharp[:, 20:-20] - 120.0, gain * (wave[:, 20:-20] - 120.0), atol=0.2)


def test_the_bilateral_filter_takes_away_noise_and_leaves_edges() -> None:
    noise = np.random.default_rng(0).normal(0.0, 2.0, (100, 100)).astype(np.float32)
    step = np.where(np.arange(100) < 50, 40.0, 200.0).astype(np.float32)
    found = process(step + noise, PLAIN.replaced(denoising_grey=6.0))
    assert (found - step).std() < 0.5 * noise.std()
    assert abs((found - step).mean(axis=0)).max() < 0.8


def test_without_processing_a_picture_stays_as_it_is() -> None:
    grey = np.random.default_rng(0).uniform(-5.0, 300.0, (5, 7)).astype(np.float32)
    np.testing.assert_array_equal(process(grey, PLAIN), grey)


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


@pytest.mark.parametrize("exponent", [2.0, 4.0])
def test_light_away_from_the_axis_falls_as_a_power_of_its_cosine(exponent: float) -> None:
    camera = camera_of(801, 601, focal_px=500.0)
    model = NO_NOISE.replaced(vignetting=exponent)
    light = photograph(np.full((601, 801), 0.9, dtype=np.float32), 1, camera, model, np.random.default_rng(0))
    for x, y in ((400, 300), (0, 300), (400, 0), (0, 0), (800, 600), (600, 450)):
        cosine = 500.0 / np.sqrt((x - 400.0) ** 2 + (y - 300.0) ** 2 + 500.0**2)
        assert light[y, x] == pytest.approx(0.9 * 255.0 * cosine**exponent, abs=0.51)
    assert light[0, 0] == pytest.approx(229.5 * 0.5 ** (exponent / 2.0), abs=0.51)  # at 45 degrees


def test_exposure_scales_the_light_before_it_is_clipped() -> None:
    levels = np.array([[0.2, 0.5, 1.0, 2.0]])
    assert shoot(levels, 1, NO_NOISE.replaced(exposure=0.5)).tolist() == [[26, 64, 128, 255]]


@pytest.mark.parametrize("exposure", [0.5, 1.0])
def test_noise_grows_with_the_light_as_counted_electrons_do(exposure: float) -> None:
    model = NO_NOISE.replaced(full_well_electrons=3000.0, read_noise_grey=1.5, exposure=exposure)
    for level in (0.1, 0.3, 0.8):
        picture = shoot(np.full((400, 400), level), 1, model, seed=int(100 * level)).astype(float)
        mean = 255.0 * exposure * level
        electrons = mean * 3000.0 / 255.0
        # A Poisson variance, in grey levels of 3000 / 255 electrons; read noise; rounding to whole levels.
        expected = electrons * (255.0 / 3000.0) ** 2 + 1.5**2 + 1.0 / 12.0
        assert picture.mean() == pytest.approx(mean, abs=0.05)
        assert picture.var() == pytest.approx(expected, rel=0.02)


def test_noise_of_neighbours_is_independent() -> None:
    model = NO_NOISE.replaced(full_well_electrons=3000.0, read_noise_grey=1.5)
    noise = shoot(np.full((400, 400), 0.5), 1, model).astype(float) - 127.5
    for shift in ((0, 1), (1, 0), (1, 1), (0, 2)):
        assert abs((noise * np.roll(noise, shift, axis=(0, 1))).mean() / noise.var()) < 0.01


def test_colours_pass_through_the_same_lens_with_noise_of_their_own() -> None:
    model = NO_NOISE.replaced(lens_blur_px=1.2, vignetting=4.0)
    colour = np.random.default_rng(1).uniform(0.0, 0.9, (60, 80, 3)).astype(np.float32)
    camera = camera_of(40, 30, 100.0)
    together = photograph(colour, 2, camera, model, np.random.default_rng(0))
    for channel in range(3):
        one = photograph(np.ascontiguousarray(colour[..., channel]), 2, camera, model, np.random.default_rng(0))
        np.testing.assert_array_equal(together[..., channel], one)
    noisy = photograph(colour, 2, camera, model.replaced(read_noise_grey=3.0), np.random.default_rng(0))
    noise = noisy.astype(float) - together
    assert abs(np.corrcoef(noise[..., 0].ravel(), noise[..., 1].ravel())[0, 1]) < 0.1


def test_glare_spreads_a_part_of_the_light_evenly() -> None:
    light = np.zeros((40, 50))
    light[:, 30:] = 0.5
    picture = shoot(light, 1, NO_NOISE.replaced(veiling_glare=0.1))
    assert np.unique(picture[:, :30]).tolist() == [round(255.0 * 0.1 * 0.2)]
    assert np.unique(picture[:, 30:]).tolist() == [round(255.0 * (0.5 + 0.1 * 0.2))]


def test_pixels_differ_in_sensitivity_by_the_same_pattern_in_all_pictures() -> None:
    model = NO_NOISE.replaced(prnu_percent=4.0)
    first, second = (shoot(np.full((300, 300), level), 1, model, seed=seed) for level, seed in ((0.8, 0), (0.4, 1)))
    assert first.astype(float).std() == pytest.approx(0.04 * 204.0, rel=0.02)
    assert second.astype(float).std() == pytest.approx(0.04 * 102.0, rel=0.03)
    np.testing.assert_allclose(second, first / 2.0, atol=0.8)


def test_a_mosaic_makes_grey_light_a_picture_in_colour_without_any() -> None:
    picture = shoot(np.full((20, 30), 0.5), 1, NO_NOISE.replaced(bayer=True))
    assert picture.shape == (20, 30, 3)
    assert np.unique(picture).tolist() == [128]


def test_lateral_chromatic_aberration_colours_edges() -> None:
    light = np.zeros((60, 80))
    light[:, 70:] = 0.5
    model = SensorModel(lens_blur_px=0.8, read_noise_grey=0.0, lateral_chromatic_percent=1.0)
    picture = shoot(light, 1, model).astype(float)
    edges = (0.5 * 255.0 - picture[30]).sum(axis=0) / (0.5 * 255.0)
    # 30 px from the principal point: red moves outwards by 0.3 px, blue inwards.
    np.testing.assert_allclose(edges - edges[1], [0.3, 0.0, -0.3], atol=0.04)


def test_presets_go_from_no_flaw_to_many() -> None:
    ideal, c920, poor = (SENSORS[name] for name in ("ideal", "c920", "poor"))
    assert ideal == SensorModel(read_noise_grey=0.0)
    for name in ("lens_blur_px", "aperture_mm", "vignetting", "veiling_glare", "prnu_percent", "readout_ms"):
        assert getattr(ideal, name) <= getattr(c920, name) < getattr(poor, name), name
    assert c920.full_well_electrons > poor.full_well_electrons
    assert c920.jpeg_quality is not None
    assert poor.jpeg_quality is not None
    assert ideal.jpeg_quality is None
    assert c920.jpeg_quality > poor.jpeg_quality


def test_noise_has_its_sigma_and_follows_its_seed() -> None:
    model = SensorModel(lens_blur_px=0.0, read_noise_grey=3.0)
    flat = np.full((200, 200), 0.5)
    picture = shoot(flat, 1, model)
    assert picture.astype(float).std() == pytest.approx(np.sqrt(9.0 + 1.0 / 12.0), rel=0.02)
    assert picture.astype(float).mean() == pytest.approx(127.5, abs=0.1)
    np.testing.assert_array_equal(picture, shoot(flat, 1, model))
    assert (picture != shoot(flat, 1, model, seed=1)).any()
