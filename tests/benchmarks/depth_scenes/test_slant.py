"""`slant`: nearly all of it is slanted, and its texture is weak."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from benchmarks.depth_scenes.rendered_scene import RenderedScene, depth_views


def test_most_of_it_is_slanted_and_weak(rendered: Callable[[str], RenderedScene]) -> None:
    views = depth_views(3, 128)
    disparity = views.disparity_px_from_depth(rendered("slant").depth_mm(views, 1, 1).astype(np.float64), "s")
    slope = np.hypot(*np.gradient(disparity))
    assert np.mean(slope > 0.01) > 0.5
    grey = cv2.cvtColor(rendered("slant").picture(views, 1, 1, spp=64), cv2.COLOR_RGB2GRAY).astype(np.float64)
    contrast = np.sqrt(np.maximum(cv2.blur(grey**2, (5, 5)) - cv2.blur(grey, (5, 5)) ** 2, 0.0))
    assert 0.7 < np.median(contrast) < 4.0
