"""Light and grey levels, against values from the standard."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.light_field.render.linear_light import levels_from_light, light_from_levels, light_per_level


def test_known_levels_have_their_known_light() -> None:
    # Grey 188 is half the light of white, grey 118 about the 18 % of a grey card (both rounded to bytes).
    light = light_from_levels(np.array([[0, 10, 118, 188, 255]], np.uint8))
    np.testing.assert_allclose(light[0], [0.0, 10 / 255 / 12.92, 0.1812, 0.5029, 1.0], atol=1e-4)


def test_levels_survive_the_round_trip() -> None:
    levels = np.linspace(0.0, 1.0, 501, dtype=np.float32).reshape(-1, 1)
    np.testing.assert_allclose(levels_from_light(light_from_levels(levels)), levels, atol=2e-6)
    every = np.arange(256, dtype=np.uint8).reshape(16, 16)
    np.testing.assert_array_equal(np.rint(levels_from_light(light_from_levels(every)) * 255.0), every)
    assert light_from_levels(np.zeros((4, 5, 1), np.uint8)).shape == (4, 5, 1)


def test_overshooting_values_stay_in_order() -> None:
    levels = levels_from_light(np.array([[-0.1, -0.01, 0.0, 0.9, 1.0, 1.2]], np.float32))
    assert (np.diff(levels) > 0).all()


def test_light_per_level_is_the_derivative() -> None:
    levels, step = np.array([[0.02, 0.1, 0.5, 0.9]], np.float32), np.float32(1e-3)
    slope = (light_from_levels(levels + step) - light_from_levels(levels - step)) / (2 * step)
    np.testing.assert_allclose(light_per_level(light_from_levels(levels)), slope, rtol=2e-3)
    assert light_per_level(np.array([-0.5], np.float32)) == light_per_level(np.zeros(1, np.float32))
