"""`borders`: near things are cut by every side of the picture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.depth_scenes.rendered_scene import FOCUS_MM, RenderedScene, depth_views


def test_every_side_cuts_something_near_and_something_else(rendered: Callable[[str], RenderedScene]) -> None:
    views = depth_views(9, 128)
    depth = rendered("borders").depth_mm(views, 4, 4)
    for side in (depth[0], depth[-1], depth[:, 0], depth[:, -1]):
        assert np.mean(side < 0.85 * FOCUS_MM) > 0.3
    for side in (depth[0], depth[:, 0]):
        assert np.mean(side > 1.2 * FOCUS_MM) > 0.1
