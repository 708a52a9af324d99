"""Blocks of views, and lighting that changes between frames."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.temporal.blocks import BLOCK_PX, SMALL_STRIDE_PX, Blocks, lighting, row_gains
from tests.optics.light_field.temporal.videos import HEIGHT_PX, picture, shot


def test_blocks_are_those_of_the_picture() -> None:
    frame = shot(picture(), np.random.default_rng(0))
    blocks = Blocks.of(frame)
    assert blocks.samples.shape == (9, HEIGHT_PX // SMALL_STRIDE_PX, 120 // SMALL_STRIDE_PX, BLOCK_PX**2, 3)
    first = (SMALL_STRIDE_PX - BLOCK_PX) // 2
    top, left = 2 * SMALL_STRIDE_PX + first, 3 * SMALL_STRIDE_PX + first
    part = frame.samples[1, 2, top : top + BLOCK_PX, left : left + BLOCK_PX] / 255.0
    assert blocks.samples[5, 2, 3] == pytest.approx(part.reshape(-1, 3))
    assert blocks.means[5, 2, 3] == pytest.approx(part.mean(axis=(0, 1)))
    after = blocks.after(blocks, np.full((9, 11, 3), 0.5, np.float32)).differences
    assert after == pytest.approx(blocks.samples / 2)


def test_lighting_is_that_of_each_row_though_something_covers_a_part_of_it() -> None:
    random = np.random.default_rng(1)
    scene = picture(contrast=40.0)
    before = Blocks.of(shot(scene, random)).means
    rows = 1.0 + 0.04 * np.sin(np.arange(HEIGHT_PX) / HEIGHT_PX * 2 * np.pi)
    changed = scene * rows[:, None, None] * [1.0, 1.0, 0.98]
    changed[20:70, 10:55] = 230.0
    gains = row_gains(lighting(Blocks.of(shot(changed, random)).means, before), HEIGHT_PX)
    assert gains.shape == (9, HEIGHT_PX, 3)
    assert np.abs(gains / (rows[:, None] * [1.0, 1.0, 0.98]) - 1.0).max() < 0.025


def test_in_even_light_gains_are_one() -> None:
    random = np.random.default_rng(2)
    means = [Blocks.of(shot(picture(), random)).means for _ in range(2)]
    assert np.abs(lighting(*means) - 1.0).max() < 0.005
    assert np.all(lighting(means[0], means[0]) == 1.0)
    dark = np.full((9, 4, 5, 3), 0.01, np.float32)
    assert np.all(lighting(dark, 2.0 * dark) == 1.0)


def test_what_is_corrected_does_not_grow_from_frame_to_frame() -> None:
    """The gains of an error of the mean, in any pattern of rows, leave less of it."""
    for pattern in (np.where(np.arange(11) % 2 == 0, 1.01, 0.99), np.where(np.arange(11) % 3 == 0, 1.02, 0.99)):
        means = np.broadcast_to(0.5 * pattern[:, None, None], (9, 11, 15, 3)).astype(np.float32)
        gains = lighting(np.full((9, 11, 15, 3), 0.5, np.float32), means)
        assert np.abs(gains * pattern[:, None] - 1.0).max() <= 1.02 * np.abs(pattern - 1.0).max()
