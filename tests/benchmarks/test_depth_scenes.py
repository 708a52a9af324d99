"""Scenes: true depth against closed forms, pictures that agree with it, the same bytes for the same request."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.depth_scenes.__main__ import write_scene
from benchmarks.depth_scenes.patterns import stone
from benchmarks.depth_scenes.rendered_scene import (
    Finish,
    Item,
    Lamp,
    RenderedScene,
    Scene,
    depth_views,
)
from benchmarks.depth_scenes.surfaces import block, sheet
from mirrorcam.render_scenes.variant import SCALAR, use_variant

SIZE_PX = 48


@pytest.fixture(scope="module")
def plain() -> RenderedScene:
    """A floor and a wall, with a box before it, seen from 600 mm above and 5 deg downward."""
    if use_variant(colour=True) == SCALAR:
        pytest.skip("nothing compiles in colour")
    cloth = Finish(pattern=stone(0, (0.5, 0.4, 0.4), contrast=0.4), tile_mm=4000.0)
    items = (
        Item("floor", sheet((-5000.0, 1000.0, 0.0), (1e4, 0.0, 0.0), (0.0, 1e4, 0.0)), cloth),
        Item("wall", sheet((-5000.0, 7000.0, 0.0), (1e4, 0.0, 0.0), (0.0, 0.0, 5000.0)), cloth),
        Item("box", block((500.0, 500.0, 900.0), (0.0, 4250.0, 0.0)), cloth),
    )
    lamp = Lamp((0.0, 2000.0, 3000.0), (0.0, 4000.0, 0.0), (400.0, 400.0), (30.0, 30.0, 30.0))
    return RenderedScene(Scene(items, (lamp,), (0.3, 0.3, 0.3), eye_mm=600.0, pitch_deg=5.0))


def test_depth_is_that_of_the_planes(plain: RenderedScene) -> None:
    views = depth_views(3, SIZE_PX)
    found = plain.depth_mm(views, 1, 1)
    pitch = np.radians(5.0)
    column, row = np.meshgrid(*(np.arange(SIZE_PX) - (SIZE_PX - 1) / 2.0,) * 2)
    x, down = column / views.focal_px, row / views.focal_px
    # Per mm of depth, a ray gains this much away from the camera and this much height.
    away, up = np.cos(pitch) - down * np.sin(pitch), -np.sin(pitch) - down * np.cos(pitch)
    floor = np.where(up < 0.0, 600.0 / np.maximum(-up, 1e-9), np.inf)
    front = 4000.0 / away
    is_box = (np.abs(x * front) < 250.0) & (600.0 + up * front < 900.0) & (600.0 + up * front > 0.0)
    top = np.where(np.abs(up) > 0, 300.0 / up, np.inf)
    is_top = (up > 0) & (np.abs(x * top) < 250.0) & (top * away > 4000.0) & (top * away < 4500.0)
    expected = np.where(is_box, front, np.where(is_top, top, np.minimum(floor, 7000.0 / away)))
    np.testing.assert_allclose(found, expected, rtol=2e-6)


@pytest.mark.slow
def test_views_agree_with_the_truth(tmp_path: Path) -> None:
    if use_variant(colour=True) == SCALAR:
        pytest.skip("nothing compiles in colour")
    made = write_scene(tmp_path / "slant", "slant", count=3, size_px=96, spp=64)
    assert made is not None and float(made[0]) < 2.0
