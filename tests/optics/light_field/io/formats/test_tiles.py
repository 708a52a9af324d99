"""Tiles: the disparity between views cut out of the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.light_field.io.mosaic import write_mosaic
from tests.optics.light_field.io.formats.planes import CANDIDATES, plane, shift_that_agrees


def test_tiles_are_adjacent_views(tmp_path: Path) -> None:
    light_field = plane(2, 3, 0.8)
    write_mosaic(tmp_path / "a.png", light_field, "tiles")
    picture = read_image(tmp_path / "a.png")
    views = np.array([[picture[90 * t :, 120 * s :][:90, :120] for s in range(3)] for t in range(2)])
    assert shift_that_agrees(views, lambda k, t, s: (-k * s, -k * t), CANDIDATES) == pytest.approx(0.8, abs=0.02)
