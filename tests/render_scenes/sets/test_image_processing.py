"""Processing of raw pictures: against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.sets.image_processing import demosaiced, mosaic, processed, srgb
from mirrorcam.render_scenes.settings import SensorModel

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
    np.testing.assert_allclose(demosaiced(raw), np.tile(colour, (12, 16, 1)), atol=1.0 / 256)


def test_a_slope_of_light_passes_through_the_mosaic() -> None:
    """Interpolation is exact for a plane, two pixels from the border."""
    v, u = np.mgrid[:20, :24].astype(np.float32)
    light = np.stack([20.0 + 3.0 * u + v, 40.0 + 2.0 * u + 3.0 * v, 90.0 + u - v], axis=-1)
    np.testing.assert_allclose(demosaiced(mosaic(light))[2:-2, 2:-2], light[2:-2, 2:-2], atol=0.51 + 1.0 / 256)


def test_a_sensor_with_a_mosaic_is_white_at_most() -> None:
    assert demosaiced(np.full((8, 8), 400.0, dtype=np.float32)).max() == 255.0
    assert demosaiced(np.full((8, 8), -3.0, dtype=np.float32)).min() == 0.0


@pytest.mark.parametrize(("linear", "coded"), [(0.0, 0.0), (0.002, 0.02584), (0.2140411, 0.5), (1.0, 1.0)])
def test_the_tone_curve_is_that_of_its_standard(linear: float, coded: float) -> None:
    assert srgb(np.array(linear)) == pytest.approx(coded, abs=1e-5)
    grey = np.full((4, 4), 255.0 * linear, dtype=np.float32)
    np.testing.assert_allclose(processed(grey, PLAIN.replaced(tone_curve="srgb")), 255.0 * coded, atol=0.03)


def test_unsharp_masking_raises_contrast_by_its_amount_where_the_blur_takes_all_of_it() -> None:
    """A wave loses exp(-(sigma k)^2 / 2) of its amplitude by the blur; the amount times the loss is added."""
    u = np.arange(400)
    for period in (4.0, 12.0):
        k = 2.0 * np.pi / period
        wave = np.tile(120.0 + 50.0 * np.sin(k * u), (8, 1)).astype(np.float32)
        sharp = processed(wave, PLAIN.replaced(sharpening=0.8))
        gain = 1.0 + 0.8 * (1.0 - np.exp(-(k**2) / 2.0))
        np.testing.assert_allclose(sharp[:, 20:-20] - 120.0, gain * (wave[:, 20:-20] - 120.0), atol=0.2)


def test_the_bilateral_filter_takes_away_noise_and_leaves_edges() -> None:
    noise = np.random.default_rng(0).normal(0.0, 2.0, (100, 100)).astype(np.float32)
    step = np.where(np.arange(100) < 50, 40.0, 200.0).astype(np.float32)
    found = processed(step + noise, PLAIN.replaced(denoising_grey=6.0))
    assert (found - step).std() < 0.5 * noise.std()
    assert abs((found - step).mean(axis=0)).max() < 0.8


def test_without_processing_a_picture_stays_as_it_is() -> None:
    grey = np.random.default_rng(0).uniform(-5.0, 300.0, (5, 7)).astype(np.float32)
    np.testing.assert_array_equal(processed(grey, PLAIN), grey)
