"""Exposure inside sub-images, and advice."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.alignment.exposure_meter import BINS, measure_exposure
from mirrorcam.optics.alignment.sub_image_masks import sub_image_masks
from mirrorcam.optics.geometry.layout import Layout


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
