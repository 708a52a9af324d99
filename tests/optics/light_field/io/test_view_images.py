"""Views as 8-bit pictures: round trips of weights, opacity and colours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.light_field.io.view_images import (
    INVALID_GREY,
    SEPARATOR_GREY,
    SEPARATOR_PX,
    as_bytes,
    read_rgba,
    rgb,
    tiled_views,
    weight_bytes,
    weights_of,
    write_rgba,
)
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import grid_views

ROWS, COLS, HEIGHT, WIDTH = 2, 3, 40, 60


def test_weights_survive_and_positive_ones_stay_positive() -> None:
    weights = (np.arange(256) / 255.0).astype(np.float32)
    assert np.array_equal(weights_of(weight_bytes(weights)), weights)
    assert weight_bytes(np.array([0.0, 1e-9, 1.0], np.float32)).tolist() == [0, 1, 255]


def test_samples_of_floats_are_rounded_and_clipped() -> None:
    assert as_bytes(np.array([-1.0, 0.0, 0.5, 1.0, 3.0], np.float32)).tolist() == [0, 0, 128, 255, 255]
    grey = np.array([[[7]]], np.uint8)
    assert rgb(grey).tolist() == [[[7, 7, 7]]]


def test_colours_and_opacity_survive_in_png(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    colours = random.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    opacity = random.integers(0, 256, (5, 7), dtype=np.uint8)
    write_rgba(tmp_path / "a.png", colours, opacity)
    found, seen = read_rgba(tmp_path / "a.png")
    assert np.array_equal(found, colours)
    assert np.array_equal(seen, opacity)
    write_rgba(tmp_path / "b.png", colours, None)
    assert (read_rgba(tmp_path / "b.png")[1] == 255).all()


def light_field(samples: Any, weights: Any = None) -> LightField:
    weights = np.ones((ROWS, COLS, HEIGHT, WIDTH), np.float32) if weights is None else weights
    return LightField.of(grid_views(ROWS, COLS, width_px=WIDTH, height_px=HEIGHT), samples, weights)


def test_tiles_are_ordered_views_with_separators() -> None:
    samples = np.zeros((ROWS, COLS, HEIGHT, WIDTH, 3), np.uint8)
    for t, s in np.ndindex(ROWS, COLS):
        samples[t, s] = [10 + 40 * t, 10 + 40 * s, 5]
    weights = np.ones((ROWS, COLS, HEIGHT, WIDTH), np.float32)
    weights[1, 2, :10] = 0
    picture = tiled_views(light_field(samples, weights))
    assert picture.dtype == np.uint8
    assert picture.shape == (2 * HEIGHT + SEPARATOR_PX, 3 * WIDTH + 2 * SEPARATOR_PX, 3)
    for t, s in np.ndindex(ROWS, COLS):
        top, left = t * (HEIGHT + SEPARATOR_PX), s * (WIDTH + SEPARATOR_PX)
        tile = picture[top : top + HEIGHT, left : left + WIDTH]
        assert (tile[10:] == samples[t, s, 10:]).all()
        assert (tile[:10] == (INVALID_GREY if (t, s) == (1, 2) else samples[t, s, :10])).all()
    assert (picture[HEIGHT : HEIGHT + SEPARATOR_PX] == SEPARATOR_GREY).all()
    assert (picture[:, WIDTH : WIDTH + SEPARATOR_PX] == SEPARATOR_GREY).all()


def test_tiles_of_grey_and_of_float_samples() -> None:
    grey = np.full((ROWS, COLS, HEIGHT, WIDTH, 1), 90, np.uint8)
    assert (tiled_views(light_field(grey))[0, 0] == [90, 90, 90]).all()
    bright = np.full((ROWS, COLS, HEIGHT, WIDTH, 3), [0.5, 1.7, -0.2], np.float32)
    assert (tiled_views(light_field(bright))[0, 0] == [128, 255, 0]).all()


def test_views_in_a_pattern_are_placed_as_in_space_without_overlap() -> None:
    places = 20.0 * Pattern.hexagonal(1).positions
    views = grid_views(
        1, 7, width_px=WIDTH, height_px=HEIGHT, positions_mm=np.column_stack([places, np.zeros(7)])[None]
    )
    samples = np.broadcast_to(np.arange(1, 8, dtype=np.uint8)[None, :, None, None, None], (1, 7, HEIGHT, WIDTH, 3))
    picture = tiled_views(LightField.of(views, samples, np.ones((1, 7, HEIGHT, WIDTH), np.float32)))
    middles = []
    for number in range(1, 8):
        v, u = np.nonzero((picture == number).all(axis=-1))
        assert len(v) == HEIGHT * WIDTH
        middles.append([u.mean(), v.mean()])
    fit = [np.polyfit(places[:, axis], np.array(middles)[:, axis], 1, full=True)[1] for axis in (0, 1)]
    assert np.sqrt(np.concatenate(fit).max() / 7) < 0.5
