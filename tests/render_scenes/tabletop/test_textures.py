"""Procedural textures: seeded, in range, and with detail down to their texels."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from mirrorcam.render_scenes.tabletop.textures import TextureName, grain, texture


@pytest.mark.parametrize("name", get_args(TextureName))
def test_a_texture_follows_from_its_seed_and_has_fine_detail(name: TextureName) -> None:
    picture, again, other = (texture(name, (160, 120), seed) for seed in (1, 1, 2))
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.float32
    assert picture.min() >= np.float32(0.02)
    assert picture.max() <= np.float32(0.9)
    np.testing.assert_array_equal(picture, again)
    assert (picture != other).any()
    # Neighbouring texels differ nearly everywhere, so that views can be matched.
    assert (np.abs(np.diff(picture, axis=1)).max(axis=-1) > 1e-3).mean() > 0.8


def test_noise_has_mean_zero_and_unit_deviation_at_every_fall() -> None:
    for fall in (0.5, 1.0):
        noise = np.stack(
            [grain(64, 64, np.random.default_rng(seed), cell=(16.0, 16.0), fall=fall) for seed in range(20)]
        )
        assert abs(noise.mean()) < 0.1
        assert 0.6 < noise.std() < 1.2
