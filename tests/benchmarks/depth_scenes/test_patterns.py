"""Textures: periodic, of the spectrum asked for, plausible reflectances, the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.depth_scenes.patterns import (
    SIDE_PX,
    Pattern,
    bricks,
    foliage,
    noise,
    planks,
    plaster,
    repeated,
    stone,
    weave,
)

MAKERS: dict[str, Callable[[int], Pattern]] = {
    "plaster": lambda seed: plaster(seed, (0.4, 0.4, 0.3), 0.06),
    "planks": lambda seed: planks(seed, (0.4, 0.3, 0.2), boards=5),
    "bricks": lambda seed: bricks(seed, (0.4, 0.2, 0.15)),
    "weave": lambda seed: weave(seed, (0.4, 0.3, 0.2)),
    "stone": lambda seed: stone(seed, (0.4, 0.4, 0.4)),
    "foliage": lambda seed: foliage(seed, (0.2, 0.3, 0.1)),
}


@pytest.mark.parametrize("fall", [0.6, 1.0, 1.5])
def test_the_amplitude_of_noise_falls_as_asked(fall: float) -> None:
    found = noise(np.random.default_rng(0), fall=fall)
    assert found.mean() == pytest.approx(0.0, abs=1e-9)
    assert found.std() == pytest.approx(1.0)
    power = np.abs(np.fft.fft2(found)) ** 2
    radius = SIDE_PX * np.hypot(*np.meshgrid(np.fft.fftfreq(SIDE_PX), np.fft.fftfreq(SIDE_PX)))
    low, high = (np.median(power[(radius > r) & (radius < 1.2 * r)]) for r in (20, 200))
    assert 0.5 * np.log10(low / high) == pytest.approx(fall, abs=0.05)


def test_noise_goes_on_beyond_its_sides() -> None:
    found = noise(np.random.default_rng(0), fall=1.2)
    inside = np.abs(np.diff(found, axis=1)).mean()
    assert np.abs(found[:, 0] - found[:, -1]).mean() == pytest.approx(inside, rel=0.1)


def test_stretched_noise_is_longer_along_rows() -> None:
    found = noise(np.random.default_rng(0), stretch=10.0)
    assert np.abs(np.diff(found, axis=0)).mean() > 3.0 * np.abs(np.diff(found, axis=1)).mean()


@pytest.mark.parametrize("name", MAKERS)
def test_textures_are_reflectances_and_the_same_for_the_same_seed(name: str) -> None:
    one = MAKERS[name](3)
    assert one.shape == (SIDE_PX, SIDE_PX, 3)
    assert one.dtype == np.float32
    assert 0.0 < one.min() < one.max() < 1.0
    assert np.array_equal(one, MAKERS[name](3))
    assert not np.array_equal(one, MAKERS[name](4))


def test_plaster_has_the_contrast_asked_for() -> None:
    grey = MAKERS["plaster"](3).mean(axis=-1)
    assert grey.std() / grey.mean() == pytest.approx(0.06, rel=0.25)


def test_a_repeated_picture_keeps_its_mean() -> None:
    picture = np.random.default_rng(0).uniform(0.0, 1.0, (300, 500, 3)).astype(np.float32)
    found = repeated(picture)
    assert found.shape == (SIDE_PX, SIDE_PX, 3)
    assert found.mean() == pytest.approx(picture.mean(), abs=0.01)
