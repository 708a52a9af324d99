"""What makes pictures of views alike."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.light_field.depth.photometry import (
    GAIN_STRIDE_PX,
    NO_SAMPLE,
    brightened,
    grey,
    normalised,
    patches,
)
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import grid_views

EVERY = slice(GAIN_STRIDE_PX // 2, None, GAIN_STRIDE_PX)


def texture(seed: int = 3) -> np.ndarray:
    import cv2

    coarse = np.random.default_rng(seed).uniform(40, 200, (24, 32)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_CUBIC))


def test_brightness_and_contrast_do_not_matter_to_the_search() -> None:
    picture = texture()
    same = normalised(np.float32(0.7) * picture + np.float32(20.0))
    assert np.abs(normalised(picture).astype(int) - same).max() <= 24
    assert np.abs(normalised(picture).astype(int) - same).mean() < 4
    assert normalised(picture).std() > 30
    assert np.abs(normalised(texture(4)).astype(int) - same).mean() > 30


def test_what_is_no_sample_leaves_its_neighbours_alone() -> None:
    picture = texture()
    cut = picture.copy()
    cut[:, 80:] = NO_SAMPLE
    found = normalised(cut)
    assert (found[:, 80:] == 128).all()
    assert (found[:, :74] == normalised(picture)[:, :74]).all()
    assert np.abs(found[:, 79].astype(int) - 128).max() < 128


def test_a_gain_that_leans_is_found_though_a_third_is_hidden() -> None:
    picture = texture()
    rows, columns = np.mgrid[:120, :160].astype(np.float32)
    gain = 0.8 + 0.3 * (columns / 160 - 0.5) - 0.1 * (rows / 120 - 0.5)
    darker = (picture / gain).astype(np.float32)
    darker[:, :50] = 90.0 + 0.3 * texture(9)[:, :50]
    found = brightened(darker, columns[EVERY, EVERY], rows[EVERY, EVERY], patches(picture)[EVERY, EVERY])
    assert np.abs(found / darker - gain)[:, 60:].max() < 0.03
    assert np.abs(darker - picture)[:, 60:].mean() > 10


def test_pictures_that_share_nothing_or_are_black_stay() -> None:
    picture = texture()
    rows, columns = np.mgrid[:120, :160].astype(np.float32)
    far = columns[EVERY, EVERY] + 1000.0
    assert brightened(picture, far, rows[EVERY, EVERY], patches(picture)[EVERY, EVERY]) is picture
    black = np.zeros_like(picture)
    found = brightened(black, columns[EVERY, EVERY], rows[EVERY, EVERY], patches(black)[EVERY, EVERY])
    assert (found == 0).all()


def test_grey_is_the_same_of_bytes_and_floats_and_marks_what_is_no_sample() -> None:
    views = grid_views(1, 2)
    samples = np.random.default_rng(0).integers(0, 255, (1, 2, 90, 120, 3), dtype=np.uint8)
    weights = np.ones((1, 2, 90, 120), np.float32)
    weights[0, 1, :5] = 0.0
    whole = grey(LightField.of(views, samples, weights), (0, 1))
    part = grey(LightField.of(views, (samples / 255).astype(np.float32), weights), (0, 1))
    assert (whole[:5] == NO_SAMPLE).all()
    assert (part[:5] == NO_SAMPLE).all()
    assert np.abs(whole - part)[5:].max() <= 0.51
    single = LightField.of(views, samples[..., :1].copy(), weights)
    assert (grey(single, (0, 1))[5:] == samples[0, 1, 5:, :, 0]).all()
