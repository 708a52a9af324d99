"""ESLF: the disparity that other readers of the format find."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.light_field.io.mosaic import write_mosaic
from tests.optics.light_field.io.formats.planes import CANDIDATES, plane, shift_that_agrees


def test_eslf_has_a_picture_of_the_aperture_for_every_pixel(tmp_path: Path) -> None:
    light_field = plane(2, 3, -1.7)
    write_mosaic(tmp_path / "a.png", light_field, "eslf")
    picture = read_image(tmp_path / "a.png")
    assert picture.shape == (2 * 90, 3 * 120, 3)
    views = np.array([[picture[t::2, s::3] for s in range(3)] for t in range(2)])
    assert shift_that_agrees(views, lambda k, t, s: (-k * s, -k * t), CANDIDATES) == pytest.approx(-1.7, abs=0.02)
