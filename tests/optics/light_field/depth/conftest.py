"""A card before a wall, and the depth estimated from their light field."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

WALL = Surface(560.0, slope=(0.25, -0.35), seed=1)


CARD = Surface(420.0, bounds=(-18.0, -30.0, 14.0, 12.0), seed=2, mean=0.35)


@pytest.fixture(scope="session")
def scene() -> tuple[LightField, FloatArray, Any]:
    """A card before a slanted wall, seen by an uneven grid."""
    return photograph(grid_views(), [WALL, CARD])


@pytest.fixture(scope="session")
def found(scene: Any) -> DepthMap:
    return DepthEstimator(scene[0]).estimate(scene[0])


def inner(number: Any, of: int, px: int = 4) -> Any:
    """Pixels of a surface, `px` away from its end."""
    import cv2

    return cv2.erode((number == of).astype(np.uint8), np.ones((2 * px + 1,) * 2, np.uint8), borderValue=0) > 0
