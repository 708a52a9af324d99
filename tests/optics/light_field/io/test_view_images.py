"""Views as pictures of 8 bits: weights, opacity and colours that come back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.optics.light_field.io.view_images import as_bytes, read_rgba, rgb, weight_bytes, weights_of, write_rgba


def test_weights_come_back_and_none_that_is_positive_becomes_zero() -> None:
    weights = (np.arange(256) / 255.0).astype(np.float32)
    assert np.array_equal(weights_of(weight_bytes(weights)), weights)
    assert weight_bytes(np.array([0.0, 1e-9, 1.0], np.float32)).tolist() == [0, 1, 255]


def test_samples_of_floats_are_rounded_and_clipped() -> None:
    assert as_bytes(np.array([-1.0, 0.0, 0.5, 1.0, 3.0], np.float32)).tolist() == [0, 0, 128, 255, 255]
    grey = np.array([[[7]]], np.uint8)
    assert rgb(grey).tolist() == [[[7, 7, 7]]]


def test_colours_and_opacity_come_back_from_png(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    colours = random.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    opacity = random.integers(0, 256, (5, 7), dtype=np.uint8)
    write_rgba(tmp_path / "a.png", colours, opacity)
    found, seen = read_rgba(tmp_path / "a.png")
    assert np.array_equal(found, colours)
    assert np.array_equal(seen, opacity)
    write_rgba(tmp_path / "b.png", colours, None)
    assert (read_rgba(tmp_path / "b.png")[1] == 255).all()
