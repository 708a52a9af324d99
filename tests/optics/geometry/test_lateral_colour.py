"""Lateral colour: red and blue against green, and all three against grey."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lateral_colour import LUMA, LateralColour

COLOUR = LateralColour(red=[4e-4, 1e-4], blue=[-3e-4, 2e-4], red_sigma=[1e-6, 1e-6], blue_sigma=[1e-6, 1e-6])
CAMERA = Camera.c920().replaced(lateral_colour=COLOUR)
PIXELS = np.array([[0.0, 0.0], [959.5, 539.5], [1700.0, 300.0]])


def test_red_is_displaced_against_green_as_stated() -> None:
    red, green, blue = CAMERA.colour_pixels(PIXELS)
    offset = PIXELS - [CAMERA.cx_px, CAMERA.cy_px]
    squared = np.square(offset / CAMERA.fx_px).sum(axis=1)[:, None]
    np.testing.assert_allclose(red - green, (4e-4 + 1e-4 * squared) * offset, atol=1e-12)
    np.testing.assert_allclose(blue - green, (-3e-4 + 2e-4 * squared) * offset, atol=1e-12)


def test_grey_stays_where_the_lens_puts_it() -> None:
    np.testing.assert_allclose(np.einsum("c,cni->ni", LUMA, CAMERA.colour_pixels(PIXELS)), PIXELS, atol=1e-9)


def test_a_camera_keeps_it_in_files() -> None:
    assert Camera.model_validate_json(CAMERA.model_dump_json()) == CAMERA
    assert "lateral_colour" not in Camera.c920().model_dump()
