"""Recordings of a device, shared by the tests of drift."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.optics.drift.calibrated_device import device
from tests.optics.drift.textured_scenes import Shot, fractal, photograph, scene


@pytest.fixture(scope="session")
def frames() -> list[Any]:
    """Two frames of a textured scene, taken by the device as calibrated."""
    random, truth = np.random.default_rng(1), device().truth
    textures = [fractal(random, slope=slope) for slope in (0.8, 1.2)]
    sheets = scene(random, (250.0, 600.0), textures, truth.camera.fx_px)
    return [photograph(truth, sheets, Shot(), random) for _ in range(2)]
