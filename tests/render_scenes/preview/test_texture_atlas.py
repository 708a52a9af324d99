"""Means of textures over footprints of pixels."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.preview.texture_atlas import mean_colour, texture_atlas

RANDOM = np.random.default_rng(0)
PICTURES = [RANDOM.random((48, 64, 3)).astype(np.float32), RANDOM.random((5, 9, 3)).astype(np.float32)]
ATLAS = texture_atlas(PICTURES)


def test_each_scale_has_the_mean_of_the_texture() -> None:
    for picture, (first, count) in zip(PICTURES, ATLAS.textures, strict=True):
        for begin, columns, rows in ATLAS.scales[first : first + count]:
            texels = ATLAS.texels[begin : begin + columns * rows]
            np.testing.assert_allclose(texels.mean(axis=0), picture.mean(axis=(0, 1)), atol=1e-5)
        assert (ATLAS.scales[first + count - 1, 1:] == 1).all()


def test_a_small_footprint_has_the_colour_of_its_texel() -> None:
    for texture, picture in enumerate(PICTURES):
        rows, columns = picture.shape[:2]
        for row, column in ((0, 0), (2, 5), (rows - 1, columns - 1)):
            at = ((column + 0.5) / columns, (row + 0.5) / rows)
            found = mean_colour(*ATLAS, texture, at, (0.01 / columns, 0.0), (0.0, 0.01 / rows))
            np.testing.assert_allclose(found, picture[row, column], atol=1e-6)


@pytest.mark.parametrize("wide", [(8.0, 8.0), (8.0, 1.0), (2.0, 6.0)])
def test_a_footprint_has_about_the_mean_over_it(wide: tuple[float, float]) -> None:
    columns, rows = 64, 48
    smooth = np.linspace(0.0, 1.0, columns)[None, :, None] * np.linspace(0.5, 1.0, rows)[:, None, None]
    atlas = texture_atlas([np.repeat(smooth, 3, axis=2).astype(np.float32)])
    place = (0.4, 0.6)
    found = mean_colour(*atlas, 0, place, (wide[0] / columns, 0.0), (0.0, wide[1] / rows))
    expected = (place[0] * columns - 0.5) / (columns - 1) * (0.5 + 0.5 * (place[1] * rows - 0.5) / (rows - 1))
    np.testing.assert_allclose(found, expected, atol=4e-3)


def test_a_long_footprint_is_not_blurred_across() -> None:
    stripes = np.zeros((64, 64, 3), np.float32)
    stripes[::16] = stripes[1::16] = stripes[2::16] = stripes[3::16] = 1.0
    atlas = texture_atlas([stripes])
    along = mean_colour(*atlas, 0, (0.5, 34.0 / 64.0), (8.0 / 64.0, 0.0), (0.0, 1.0 / 64.0))
    across = mean_colour(*atlas, 0, (0.5, 34.0 / 64.0), (1.0 / 64.0, 0.0), (0.0, 16.0 / 64.0))
    assert along[0] == pytest.approx(1.0)
    assert across[0] == pytest.approx(0.25, abs=0.05)


def test_noise_finer_than_the_footprints_is_averaged() -> None:
    places = np.random.default_rng(1).uniform(0.2, 0.8, (200, 2))
    noise = texture_atlas([np.random.default_rng(2).random((256, 256, 3)).astype(np.float32)])
    wide = 16.0 / 256.0
    found = np.array([mean_colour(*noise, 0, tuple(place), (wide, 0.0), (0.0, wide)) for place in places])
    # A mean of 16 x 16 has a sixteenth of the deviation; that of fewer texels, up to twice as much.
    assert 0.5 * 0.289 / 16.0 < found.std() < 2.0 * 0.289 / 16.0
