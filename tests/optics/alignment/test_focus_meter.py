"""Sharpness falls with blur, and with nothing else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.alignment.focus_meter import FocusMeter, sharpness
from mirrorcam.optics.alignment.sub_image_masks import sub_image_masks
from mirrorcam.optics.geometry.layout import Layout


def picture(blur_px: float, noise: float = 0.0, gain: float = 1.0) -> np.ndarray:
    random = np.random.default_rng(0)
    coarse = random.uniform(40.0, 180.0, (135, 240)).astype(np.float32)
    image = cv2.GaussianBlur(cv2.resize(coarse, (1920, 1080), interpolation=cv2.INTER_NEAREST), (0, 0), 0.6 + blur_px)
    return np.clip(gain * image + random.normal(0.0, noise, image.shape), 0, 255).astype(np.uint8)


def test_blur_lowers_sharpness_of_all_mirrors(default_layout: Layout) -> None:
    masks = sub_image_masks(default_layout)
    values = np.array([sharpness(picture(blur), masks) for blur in (0.0, 0.5, 1.0, 2.0, 4.0)])
    assert (np.diff(values, axis=0) < 0.0).all()


def test_exposure_and_noise_hardly_change_it(default_layout: Layout) -> None:
    masks = sub_image_masks(default_layout)
    plain = sharpness(picture(0.5), masks)
    assert sharpness(picture(0.5, gain=0.5), masks) == pytest.approx(plain, rel=0.1)
    assert sharpness(picture(0.5, noise=2.0), masks) == pytest.approx(plain, rel=0.15)


def test_the_dark_is_not_judged(default_layout: Layout) -> None:
    masks = [*sub_image_masks(default_layout)[:8], None]
    assert np.isnan(sharpness(np.ones((1080, 1920), np.uint8), masks)).all()
    assert np.isfinite(sharpness(picture(0.0), masks)).tolist() == [True] * 8 + [False]


def test_it_is_relative_to_the_best_so_far() -> None:
    meter = FocusMeter(2)
    assert meter.measure(np.array([2.0, np.nan]))[0] == 1.0
    assert np.isnan(meter.measure(np.array([2.0, np.nan]))[1])
    assert meter.measure(np.array([1.0, 3.0])).tolist() == [0.5, 1.0]
    meter.reset()
    assert meter.measure(np.array([1.0, 1.5])).tolist() == [1.0, 1.0]
