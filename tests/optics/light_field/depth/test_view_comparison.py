"""Gains that make pictures of views alike, and the noise that they do not share."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.parallax import other_views, parallax
from mirrorcam.optics.light_field.depth.photometry import NO_SAMPLE, ViewPicture
from mirrorcam.optics.light_field.depth.search import PyramidLevel
from mirrorcam.optics.light_field.depth.view_comparison import (
    GAIN_STRIDE_PX,
    ViewComparison,
    matching_gain,
    patch_means,
    rough_gain,
)
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


def noise_ratio(reference: np.ndarray, other: np.ndarray) -> float:
    """Noise of two views (v, u) of the reference plane, which show it at the same pixels."""
    views = grid_views(1, 2)
    sweep = PyramidLevel.of(views, 300.0, 900.0, 0).sweep
    comparison = ViewComparison(sweep, [parallax(views, index) for index in other_views(views)], map)
    planes = sweep.planes(np.full(reference.shape, 1.0 / views.reference_distance_mm, np.float32))
    pictures = [ViewPicture(p, np.zeros_like(p), np.ones(p.shape, bool)) for p in (reference, other)]
    return comparison.noise_ratio(pictures[0], pictures[1:], planes, [0])


@pytest.mark.parametrize("noise", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("blur_px", [0.0, 0.8])
def test_noise_is_what_views_do_not_share_whatever_its_spectrum(noise: float, blur_px: float) -> None:
    views = grid_views(1, 2)
    random = np.random.default_rng(4)

    def white(deviation: float) -> np.ndarray:
        picture = random.normal(0.0, 1.0, (views.height_px, views.width_px)).astype(np.float32)
        blurred = np.asarray(cv2.GaussianBlur(picture, (0, 0), blur_px)) if blur_px else picture
        return np.asarray(deviation * blurred / blurred.std(), np.float32)

    shared = 128.0 + white(10.0)
    first, second = shared + white(noise), shared + white(noise)
    expected = noise / 10.0 / np.sqrt(2.0)
    assert noise_ratio(first, second) == pytest.approx(expected, rel=0.15, abs=1e-3)
    second[:, : views.width_px // 8] = 128.0 + white(10.0)[:, : views.width_px // 8]
    assert noise_ratio(first, second) < 1.5 * expected + 0.01, "an occluded eighth counts too much"


def test_pictures_without_texture_have_no_noise_and_pictures_of_noise_nothing_else() -> None:
    views = grid_views(1, 2)
    flat = np.full((views.height_px, views.width_px), 90.0, np.float32)
    noise = np.random.default_rng(6).normal(0.0, 3.0, (2, *flat.shape)).astype(np.float32)
    assert noise_ratio(flat, flat) == 0.0
    assert noise_ratio(flat + noise[0], flat + noise[1]) > 4.0
