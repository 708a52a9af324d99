"""Light fields for tests of view orders: exact pinholes before two textured planes, without a layout."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.io.views_file import even_views
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

GIVEN = Assumed(step_mm=20.0, focal_px=400.0, reference_depth_mm=455.0)
NEAR_AND_FAR = (Surface(520.0, grain_mm=1.5, seed=1), Surface(400.0, bounds=(-40.0, -30.0, 5.0, 40.0), grain_mm=1.5))


@cache
def scene(rows: int, cols: int) -> LightField:
    """Return views of planes before and behind the plane of zero disparity."""
    return photograph(grid_views(rows, cols, uneven=False, layout_identity="", step_mm=10.0), NEAR_AND_FAR)[0]


def with_samples(samples: Any) -> LightField:
    """Return a light field of samples (t, s, v, u, c) with the geometry that a user assumes."""
    rows, cols, height, width = samples.shape[:4]
    views = even_views(Path("a"), GIVEN, (rows, cols), (width, height))
    return LightField.of(views, np.ascontiguousarray(samples), np.ones((rows, cols, height, width), np.float32))
