"""Depth maps: disparity and points of a depth, and refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth import DepthMap
from mirrorcam.optics.light_field.depth.depth_map import DepthMap as MapFunction
from tests.optics.light_field.depth.conftest import inner


def test_disparity_and_points_follow_from_the_depth(scene: Any, found: DepthMap) -> None:
    light_field, depth, number = scene
    on_card = inner(number, 1)
    assert np.allclose(found.disparity_px()[on_card], light_field.disparity_px_from_depth(depth[on_card]), atol=0.15)
    points = found.points_in_rig()
    assert np.allclose(points[..., 1], found.depth_mm, atol=1e-3, equal_nan=True)
    pixels = light_field.project(points[on_card])[found.view]
    assert np.allclose(pixels, light_field.pixel_grid()[on_card], atol=1e-3)


def test_depth_maps_check_themselves_and_are_read_only(found: DepthMap) -> None:
    wrong: Any = found.sigma_mm.astype(float)
    with pytest.raises(ValueError, match=r"sigma_mm is float64 of shape \(90, 120\), expected float32"):
        MapFunction(
            views=found.views,
            view=found.view,
            depth_mm=found.depth_mm,
            sigma_mm=wrong,
            confidence=found.confidence,
        )
    with pytest.raises(ValueError, match="read-only"):
        found.depth_mm[0, 0] = 1.0
