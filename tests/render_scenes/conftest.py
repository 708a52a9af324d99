"""Fixtures of the rendering tests."""

from __future__ import annotations

import pytest

from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

LENS = (0.08, -0.18, 0.001, -0.0005, 0.02)


@pytest.fixture(scope="session")
def distorted_layout(fold_90_layout: Layout) -> Layout:
    """The layout of a fold of 90 deg for a lens with every kind of distortion."""
    return fold_90_layout.replaced(camera=fold_90_layout.camera.replaced(distortion=LENS))


@pytest.fixture(scope="session")
def plates(distorted_layout: Layout) -> Layout:
    """The layout with second-surface mirrors of 2 mm acrylic that look the same along their chief rays."""
    mirrors = tuple(
        Mirror.second_surface(
            mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=2.0, refractive_index=1.49
        )
        for mirror in distorted_layout.mirrors
    )
    return distorted_layout.replaced(mirrors=mirrors, kind="as-built", spec=None)


@pytest.fixture(scope="session")
def small_layout(fold_90_layout: Layout) -> Layout:
    """The layout of a fold of 90 deg with a sensor of 480 x 270 pixels: the same mirrors, fast to render."""
    full = fold_90_layout.camera
    camera = Camera(
        name="small",
        width_px=480,
        height_px=270,
        fx_px=full.fx_px / 4.0,
        fy_px=full.fy_px / 4.0,
        cx_px=(full.cx_px + 0.5) / 4.0 - 0.5,
        cy_px=(full.cy_px + 0.5) / 4.0 - 0.5,
    )
    return fold_90_layout.replaced(camera=camera)


@pytest.fixture(scope="session")
def small_board() -> Charuco:
    """The size of the default board in squares twice as large, for the small layout."""
    return Charuco(cols=10, rows=7, square_mm=24.0, marker_mm=18.0)
