"""Scales of a print: as bright as the print, with a black border."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.fast.mipmap import build_mipmap


def test_every_scale_of_a_print_is_as_bright_as_the_print() -> None:
    radiance = np.random.default_rng(0).random((37, 50))
    pyramid = build_mipmap(radiance)
    assert len(pyramid.levels) > 3
    for index, level in enumerate(pyramid.levels):
        texels = pyramid.texels[level.begin : level.begin + level.columns * level.rows].reshape(level.rows, -1)
        assert texels.sum() * 4.0**index == pytest.approx(radiance.sum(), rel=1e-5)
        assert not texels[[0, -1]].any()
        assert not texels[:, [0, -1]].any()
