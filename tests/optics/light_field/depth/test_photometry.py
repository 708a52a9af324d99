"""Preparation of views: samples, masks, halving and smoothing."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.photometry import NO_SAMPLE, ViewPicture, smoothed, smoothing_px
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import grid_views


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


def test_more_noise_is_smoothed_more_up_to_a_limit_and_little_noise_not_at_all() -> None:
    deviations = [smoothing_px(ratio) for ratio in (0.0, 0.3, 0.6, 1.0, 3.0, 7.0, 100.0)]
    assert deviations[:2] == [0.0, 0.0]
    assert deviations == sorted(deviations)
    assert deviations[-1] == pytest.approx(deviations[-2], abs=0.1) and 0.5 < deviations[3] < 1.0


def test_smoothing_lowers_noise_and_keeps_the_mean_and_the_mask() -> None:
    picture = np.random.default_rng(5).normal(128.0, 10.0, (60, 80)).astype(np.float32)
    view = ViewPicture(picture, picture, picture > 100.0)
    assert view.smoothed(0.0) is view
    # White noise that is smoothed by a Gaussian of sigma s falls to 1 / (2 s sqrt(pi)).
    assert view.smoothed(1.5).brightness.std() == pytest.approx(10.0 / (3.0 * np.sqrt(np.pi)), rel=0.1)
    assert view.smoothed(1.5).valid is view.valid
    np.testing.assert_allclose(smoothed(np.full_like(picture, 7.0), 2.0), 7.0, rtol=1e-5)
