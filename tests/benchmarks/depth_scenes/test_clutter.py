"""`clutter`: steps of depth in every part of the shelf, and dark compartments."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.depth_scenes.rendered_scene import RenderedScene, depth_views


def test_narrow_things_and_dark_corners(rendered: Callable[[str], RenderedScene]) -> None:
    views = depth_views(3, 128)
    depth = rendered("clutter").depth_mm(views, 1, 1)
    edges = rendered("clutter").edges(views)
    assert edges.mean() > 0.1
    shelf = depth < 3500.0
    assert 0.4 < shelf.mean() < 0.9
    dark = rendered("clutter").picture(views, 1, 1, spp=16).mean(axis=-1) < 25.0
    assert np.mean(dark & shelf) > 0.05
