"""A layout small enough for tests of the command and its page."""

from __future__ import annotations

import numpy as np
import pytest

from optics.camera import Camera
from optics.layout import Layout
from optics.mirror import Mirror


def _folding_mirror(left: float, right: float) -> Mirror:
    """A mirror at 45 degrees, 80 mm up the axis, turned inwards, cut along image coordinates left..right."""
    normal = np.array([-(left + right) / 2.0, 1.0, -1.0])
    rays = np.array([[left, -0.15, 1], [right, -0.15, 1], [right, 0.15, 1], [left, 0.15, 1]])
    outline = rays * (80.0 * normal[2] / (rays @ normal))[:, None]
    return Mirror.from_plane(np.array([0.0, 0.0, 80.0]), normal, outline_in_rig_mm=outline)


@pytest.fixture(scope="session")
def small_layout() -> Layout:
    """Two mirrors beside each other before a C920."""
    mirrors = (_folding_mirror(-0.3, -0.02), _folding_mirror(0.02, 0.3))
    return Layout(rows=1, cols=2, camera=Camera.c920(), mirrors=mirrors)
