"""Pixels well inside sub-images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import shapely

from mirrorcam.optics.alignment.meters import BINS, MARGIN_PX, FocusMeter, measure_exposure, sharpness, sub_image_masks
from mirrorcam.optics.geometry.layout import Layout


def test_masks_are_inside_their_outlines_and_apart(default_layout: Layout) -> None:
    count = np.zeros((1080, 1920), int)
    for k, each in enumerate(sub_image_masks(default_layout)):
        assert each is not None and each.pixels > 50_000
        count[each.window] += each.mask > 0
        rows, columns = np.nonzero(each.mask)
        inner = shapely.Polygon(default_layout.outline_px(k)).buffer(-MARGIN_PX + 3.0)
        some = np.random.default_rng(k).integers(len(rows), size=200)
        x, y = columns[some] + each.window[1].start, rows[some] + each.window[0].start
        beyond = (x < MARGIN_PX) | (y < MARGIN_PX) | (x > 1919 - MARGIN_PX) | (y > 1079 - MARGIN_PX)
        assert (shapely.contains_xy(inner, x, y) | beyond).all()
    assert count.max() == 1


def test_a_mirror_that_shows_nothing_has_none(default_layout: Layout) -> None:
    assert all(each is None for each in sub_image_masks(default_layout, margin_px=600))


@pytest.mark.parametrize(
    ("low", "high", "advice"),
    [
        (20, 180, "good"),
        (0, 20, "too dark: expose longer"),
        (150, 300, "too bright: "),
        (20, 252, "a little too bright: "),
        (205, 240, "bright, nothing is clipped yet"),
    ],
)
def test_advice_follows_the_histogram(default_layout: Layout, low: int, high: int, advice: str) -> None:
    random = np.random.default_rng(0)
    frame = np.clip(random.integers(low, high, (1080, 1920, 3)), 0, 255).astype(np.uint8)
    found = measure_exposure(frame, sub_image_masks(default_layout))
    assert found.advice.startswith(advice)
    assert len(found.histogram) == BINS and sum(found.histogram) == pytest.approx(1.0)


def test_what_lies_between_mirrors_does_not_count(default_layout: Layout) -> None:
    masks = sub_image_masks(default_layout)
    frame = np.full((1080, 1920, 3), 255, np.uint8)
    for each in masks:
        assert each is not None
        frame[each.window][each.mask > 0] = 100
    found = measure_exposure(frame, masks)
    assert found.clipped == 0.0 and found.median == 100.0 and found.advice == "good"


def test_the_brightest_channel_is_the_one_that_clips(default_layout: Layout) -> None:
    frame = np.full((1080, 1920, 3), 60, np.uint8)
    frame[..., 0] = 255
    assert measure_exposure(frame, sub_image_masks(default_layout)).clipped == 1.0
    assert measure_exposure(frame[..., 1], sub_image_masks(default_layout)).clipped == 0.0


def test_a_dark_scene_wants_light(default_layout: Layout) -> None:
    frame = np.zeros((1080, 1920), np.uint8)
    frame[::8, ::2] = 120
    assert measure_exposure(frame, sub_image_masks(default_layout)).advice.startswith("dark: ")


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
