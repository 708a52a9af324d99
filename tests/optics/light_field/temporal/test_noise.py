"""Noise measured between frames: by brightness, despite motion, and its independence."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.temporal.noise import (
    BINS,
    BLOCK_PX,
    MIN_VARIANCE,
    ROUNDING,
    SMALL_STRIDE_PX,
    Blocks,
    Noise,
    lighting_gains,
    measure_noise,
    row_gains,
)
from tests.optics.light_field.temporal.videos import HEIGHT_PX, SIGMA, picture, shot


def measured(frames: list[LightField], least: float = ROUNDING, trust: float = 1.0) -> Noise:
    """Return the noise measured in the last of some frames, in even light."""
    gains = np.ones((9, 11, 3), np.float32)
    blocks = [Blocks.of(frames[0])]
    for frame in frames[1:]:
        blocks.append(Blocks.of(frame).with_differences(blocks[-1], gains))
    return measure_noise(blocks[-1], blocks[-2], gains, least, trust)


def sigma_grey(noise: Noise, level: int = 7) -> float:
    return float(np.sqrt(noise.colours[level] / 3.0) * 255.0)


def frames(count: int, scenes: Any, sigma: float = SIGMA) -> list[LightField]:
    random = np.random.default_rng(4)
    return [shot(scenes(number), random, sigma) for number in range(count)]


@pytest.mark.parametrize("count", [2, 3])
def test_noise_matches_the_frames(count: int) -> None:
    found = measured(frames(count, lambda number: picture()))
    assert sigma_grey(found) == pytest.approx(SIGMA, rel=0.04)
    # The mean of three channels has a third of the variance of one, a ninth of their sum.
    assert found.brightness[7] == pytest.approx(found.colours[7] / 9.0, rel=0.08)


def test_noise_grows_with_brightness_like_photon_noise() -> None:
    random = np.random.default_rng(5)
    ramp = np.broadcast_to(np.linspace(10.0, 245.0, 120)[None, :, None], (3, 3, 90, 120, 3))
    noisy = [ramp + np.sqrt(ramp / 30.0) * random.normal(size=ramp.shape) for _ in range(2)]
    found = measured([shot(each, random, 0.0) for each in noisy])
    levels = (np.arange(BINS) + 0.5) / BINS * 255.0
    expected = np.sqrt(levels / 30.0 + 1.0 / 12.0)
    assert np.sqrt(found.colours / 3.0)[1:-1] * 255.0 == pytest.approx(expected[1:-1], rel=0.15)
    assert found.information()[0, 128] == pytest.approx(1.0 / found.colours[7:9].mean(), rel=0.1)


def test_slow_motion_of_all_and_fast_motion_of_most_is_not_noise() -> None:
    wide = cv2.resize(picture(contrast=40.0), (480, 360), interpolation=cv2.INTER_CUBIC)

    def slowly(number: int) -> Any:
        return cv2.warpAffine(wide, np.array([[1.0, 0.0, -50 - 0.4 * number], [0.0, 1.0, -50.0]]), (120, 90))

    assert sigma_grey(measured(frames(3, slowly))) == pytest.approx(SIGMA, rel=0.1)

    def mostly(number: int) -> Any:
        scene = picture()
        scene[:, :72] = picture(seed=number + 1)[:, :72]
        return scene

    assert sigma_grey(measured(frames(3, mostly))) == pytest.approx(SIGMA, rel=0.15)


def test_the_spread_gives_the_number_of_independent_values() -> None:
    white = measured(frames(3, lambda number: picture()))
    # Chi-squared of n values: 2 / (9 n) is the variance of its cube root.
    assert white.spread[0] == pytest.approx(np.sqrt(2.0 / (9 * 75)), rel=0.15)
    assert white.spread[1] == pytest.approx(np.sqrt(2.0 / (9 * 25)), rel=0.15)
    assert white.limits(2.0) == pytest.approx((1.36, 1.65), abs=0.1)
    random = np.random.default_rng(6)
    joined = []
    for _ in range(3):
        noise = SIGMA * random.normal(size=(9, 90, 120, 3))
        blurred = np.stack([cv2.blur(each, (2, 2)) for each in noise]).reshape(3, 3, 90, 120, 3)
        joined.append(shot(picture() + 3.0 * blurred, random, 0.0))
    assert measured(joined).spread[0] > 1.2 * white.spread[0]


def test_without_noise_there_is_rounding_noise_or_none() -> None:
    still = frames(3, lambda number: picture(), sigma=0.0)
    assert measured(still).colours == pytest.approx(3.0 * ROUNDING)
    assert measured(still, MIN_VARIANCE).colours == pytest.approx(3.0 * MIN_VARIANCE)


def test_the_estimate_falls_at_once_and_rises_slowly_and_only_if_trusted() -> None:
    def noise(variance: float, trust: float) -> Noise:
        return Noise(np.full(BINS, variance, np.float32), np.full(BINS, variance, np.float32), (0.1, 0.1), trust)

    assert noise(4.0, 1.0).updated(noise(1.0, 1.0)).colours[0] == pytest.approx(2.5)
    assert noise(1.0, 1.0).updated(noise(4.0, 1.0)).colours[0] == pytest.approx(1.0 + 3.0 / 16.0)
    assert noise(1.0, 1.0).updated(noise(4.0, 0.0)).colours[0] == 1.0
    first = noise(9.0, 0.0).updated(noise(4.0, 1.0))
    assert (first.colours[0], first.trust) == (4.0, 1.0)
    # Without trust, no difference is taken for noise.
    assert noise(1.0, 0.0).information().min() >= 999.0


def test_blocks_follow_the_picture() -> None:
    frame = shot(picture(), np.random.default_rng(0))
    blocks = Blocks.of(frame)
    assert blocks.samples.shape == (9, HEIGHT_PX // SMALL_STRIDE_PX, 120 // SMALL_STRIDE_PX, BLOCK_PX**2, 3)
    first = (SMALL_STRIDE_PX - BLOCK_PX) // 2
    top, left = 2 * SMALL_STRIDE_PX + first, 3 * SMALL_STRIDE_PX + first
    part = frame.samples[1, 2, top : top + BLOCK_PX, left : left + BLOCK_PX] / 255.0
    assert blocks.samples[5, 2, 3] == pytest.approx(part.reshape(-1, 3))
    assert blocks.means[5, 2, 3] == pytest.approx(part.mean(axis=(0, 1)))
    after = blocks.with_differences(blocks, np.full((9, 11, 3), 0.5, np.float32)).differences
    assert after == pytest.approx(blocks.samples / 2)


def test_lighting_is_found_per_row_though_a_part_is_covered() -> None:
    random = np.random.default_rng(1)
    scene = picture(contrast=40.0)
    before = Blocks.of(shot(scene, random)).means
    rows = 1.0 + 0.04 * np.sin(np.arange(HEIGHT_PX) / HEIGHT_PX * 2 * np.pi)
    changed = scene * rows[:, None, None] * [1.0, 1.0, 0.98]
    changed[20:70, 10:55] = 230.0
    gains = row_gains(lighting_gains(Blocks.of(shot(changed, random)).means, before), HEIGHT_PX)
    assert gains.shape == (9, HEIGHT_PX, 3)
    assert np.abs(gains / (rows[:, None] * [1.0, 1.0, 0.98]) - 1.0).max() < 0.025


def test_in_even_light_gains_are_one() -> None:
    random = np.random.default_rng(2)
    means = [Blocks.of(shot(picture(), random)).means for _ in range(2)]
    assert np.abs(lighting_gains(*means) - 1.0).max() < 0.005
    assert np.all(lighting_gains(means[0], means[0]) == 1.0)
    dark = np.full((9, 4, 5, 3), 0.01, np.float32)
    assert np.all(lighting_gains(dark, 2.0 * dark) == 1.0)


def test_corrections_do_not_grow_from_frame_to_frame() -> None:
    """Gains for an error of the mean reduce it, in any pattern of rows."""
    for pattern in (np.where(np.arange(11) % 2 == 0, 1.01, 0.99), np.where(np.arange(11) % 3 == 0, 1.02, 0.99)):
        means = np.broadcast_to(0.5 * pattern[:, None, None], (9, 11, 15, 3)).astype(np.float32)
        gains = lighting_gains(np.full((9, 11, 15, 3), 0.5, np.float32), means)
        assert np.abs(gains * pattern[:, None] - 1.0).max() <= 1.02 * np.abs(pattern - 1.0).max()
