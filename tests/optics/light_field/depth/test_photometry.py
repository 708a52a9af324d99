"""Noise of views and its smoothing, and gains that make pictures of views alike."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.photometry import (
    GAIN_STRIDE_PX,
    NO_SAMPLE,
    ViewPicture,
    matching_gain,
    noise_grey,
    patch_means,
    rough_gain,
    smoothed,
)
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import grid_views

EVERY = slice(GAIN_STRIDE_PX // 2, None, GAIN_STRIDE_PX)


def texture(seed: int = 3) -> np.ndarray:
    coarse = np.random.default_rng(seed).uniform(40, 200, (24, 32)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_CUBIC))


def test_a_gain_with_a_gradient_is_found_though_a_third_is_hidden() -> None:
    picture = texture()
    rows, columns = np.mgrid[:120, :160].astype(np.float32)
    gain = 0.8 + 0.3 * (columns / 160 - 0.5) - 0.1 * (rows / 120 - 0.5)
    darker = (picture / gain).astype(np.float32)
    darker[:, :50] = 90.0 + 0.3 * texture(9)[:, :50]
    found = matching_gain(darker, columns[EVERY, EVERY], rows[EVERY, EVERY], patch_means(picture)[EVERY, EVERY])
    assert np.abs(found - gain)[:, 60:].max() < 0.03
    assert np.abs(darker - picture)[:, 60:].mean() > 10


def test_unrelated_or_black_pictures_are_unchanged() -> None:
    picture = texture()
    rows, columns = np.mgrid[:120, :160].astype(np.float32)
    far = columns[EVERY, EVERY] + 1000.0
    assert (matching_gain(picture, far, rows[EVERY, EVERY], patch_means(picture)[EVERY, EVERY]) == 1).all()
    black = np.zeros_like(picture)
    found = matching_gain(black, columns[EVERY, EVERY], rows[EVERY, EVERY], patch_means(black)[EVERY, EVERY])
    assert np.abs(found - 1.0).max() < 1e-6


def test_an_initial_gain_fits_most_of_the_picture_and_is_one_if_it_is_small() -> None:
    picture = texture()
    other = picture.copy()
    other[:, :40] = texture(9)[:, :40]
    assert rough_gain(np.float32(0.8) * other, picture) == pytest.approx(1.25, rel=0.03)
    assert rough_gain(np.float32(0.99) * other, picture) == 1.0
    assert rough_gain(np.full_like(picture, NO_SAMPLE), picture) == 1.0


def test_a_view_is_the_same_from_bytes_and_floats_and_masks_its_samples() -> None:
    views = grid_views(1, 2)
    samples = np.random.default_rng(0).integers(0, 255, (1, 2, 90, 120, 3), dtype=np.uint8)
    weights = np.ones((1, 2, 90, 120), np.float32)
    weights[0, 1, :5] = 0.0
    complete = ViewPicture.of(LightField.of(views, samples, weights), (0, 1))
    part = ViewPicture.of(LightField.of(views, (samples / 255).astype(np.float32), weights), (0, 1))
    assert (complete.grey[:5] == NO_SAMPLE).all()
    for name in ("brightness", "chroma"):
        assert np.abs(getattr(complete, name) - getattr(part, name)).max() <= 0.51
    red, green, blue = np.moveaxis(samples[0, 1, 5:].astype(float), -1, 0)
    np.testing.assert_allclose(complete.brightness[5:], 0.299 * red + 0.587 * green + 0.114 * blue, atol=1e-3)
    np.testing.assert_allclose(complete.chroma[5:], (red - blue) / 2, atol=1e-3)
    assert (complete.interior[:6] == 0).all() and (complete.interior[6:] == 1).all()
    # There is no false edge next to the samples: their mean continues.
    assert np.abs(complete.brightness[4] - complete.brightness[5:7].mean(axis=0)).mean() < 60.0
    single = ViewPicture.of(LightField.of(views, samples[..., :1].copy(), weights), (0, 1))
    assert (single.brightness[5:] == samples[0, 1, 5:, :, 0]).all() and (single.chroma == 0).all()


def test_half_a_view_is_the_mean_of_four_where_all_are_known() -> None:
    brightness, chroma = np.random.default_rng(1).uniform(0, 255, (2, 9, 12)).astype(np.float32)
    valid = np.ones((9, 12), bool)
    valid[3, 5] = False
    half = ViewPicture(brightness, chroma, valid).halved
    np.testing.assert_allclose(half.brightness[2, 1], brightness[4:6, 2:4].mean(), rtol=1e-4)
    np.testing.assert_allclose(half.chroma[2, 1], chroma[4:6, 2:4].mean(), rtol=1e-4)
    assert half.valid.shape == (4, 6)
    assert (~half.valid).sum() == 1 and not half.valid[1, 2]


@pytest.mark.parametrize("deviation", [3.0, 10.0, 20.0])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_white_noise_is_measured_in_spite_of_texture(deviation: float, dtype: type) -> None:
    views = grid_views(1, 2)
    shape = (1, 2, views.height_px, views.width_px)
    random = np.random.default_rng(4)
    smooth = np.broadcast_to(cv2.resize(texture(), shape[:1:-1])[..., None], (*shape, 3))
    noisy = np.clip(smooth + deviation * random.standard_normal((*shape, 3)), 0, 255)
    samples = np.rint(noisy).astype(np.uint8) if dtype is np.uint8 else (noisy / 255).astype(np.float32)
    found = noise_grey(LightField.of(views, samples, np.ones(shape, np.float32)), (0, 1))
    assert found == pytest.approx(deviation, rel=0.2)


def test_little_noise_is_not_smoothed_and_more_noise_is_smoothed_more() -> None:
    picture = np.random.default_rng(5).normal(128.0, 10.0, (60, 80)).astype(np.float32)
    assert smoothed(picture, 1.5) is picture
    deviations = [smoothed(picture, noise).std() for noise in (3.0, 8.0, 20.0)]
    assert 10.0 > deviations[0] > 2.0 * deviations[1] > 2.5 * deviations[2]
    np.testing.assert_allclose(smoothed(np.full_like(picture, 7.0), 20.0), 7.0, rtol=1e-5)
