"""Layouts that the tests of optics share: a small faceted parabola, and one that nothing about is tidy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings
from scipy.spatial.transform import Rotation

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.layouts import faceted_parabola

# The same examples in every run, and no limit on an example's time that a busy machine could exceed.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def parabola_layout() -> Layout:
    """The nominal 3x3 faceted parabola, scale 80 mm, of a camera like the C920 with half its resolution."""
    camera = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
    return faceted_parabola(camera, DesignSpec(), fill=0.9)


@pytest.fixture(scope="session")
def crooked_layout() -> Layout:
    """A 2x3 as-built layout: distorted lens, off-centre, unequal focal lengths, mirrors tilted and shifted."""
    camera = Camera(
        name="crooked",
        width_px=960,
        height_px=600,
        fx_px=700.0,
        fy_px=705.0,
        cx_px=470.3,
        cy_px=305.8,
        distortion=[0.08, -0.11, 1.2e-3, -0.8e-3, 0.02],
    )
    nominal = faceted_parabola(camera, DesignSpec(camera=camera, rows=2, cols=3, depths_mm=(350.0, 600.0)), fill=0.85)
    random = np.random.default_rng(7)
    mirrors = tuple(
        mirror.moved(Rotation.from_rotvec(random.normal(0, np.deg2rad(0.6), 3)).as_matrix(), random.normal(0, 0.8, 3))
        for mirror in nominal.mirrors
    )
    return nominal.replaced(kind="as-built", mirrors=mirrors)
