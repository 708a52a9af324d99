"""A scene of two surfaces, as light field and depth, for formats of cameras and points."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.formats.ply import point_cloud
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

SURFACES = (Surface(520.0, slope=(0.2, -0.1), seed=1), Surface(430.0, bounds=(-30.0, -20.0, 5.0, 60.0), seed=2))


@pytest.fixture(scope="session")
def scene() -> tuple[LightField, FloatArray]:
    """Uneven views, some with a principal point outside their picture, and the depth of the middle one."""
    light_field, depth, _ = photograph(
        grid_views(width_px=240, height_px=180, focal_px=700.0, centre_px=np.array([120.0, 20.0])), SURFACES
    )
    return light_field, depth


def points(scene: tuple[LightField, FloatArray]) -> FloatArray:
    """The points (n, 3) of every tenth pixel, in rig."""
    cloud = point_cloud(*scene)[0]
    return cloud[::10]
