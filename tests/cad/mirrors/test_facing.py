"""Which face of the stock lies up: never the coating, and the side that drawings are seen from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.mirrors.facing import FACINGS, Surface
from mirrorcam.cad.mirrors.stock_sheets import outline_from_back
from mirrorcam.optics.geometry.layout import Layout


@pytest.mark.parametrize("surface", ["first", "second"])
def test_the_laser_meets_the_face_that_is_glued(default_layout: Layout, surface: Surface) -> None:
    """The back, at the lower of the two heights over the reflecting surface; the coating is engraved in neither."""
    facing = FACINGS[surface]
    mirror = default_layout.mirrors[0].replaced(surface=surface)
    assert facing.up == "back"
    assert mirror.back_mm < mirror.front_mm
    coating_is_up = mirror.is_second_surface
    assert ("not the paint" in facing.marked) == coating_is_up
    np.testing.assert_array_equal(facing.seen(mirror.outline_in_plane_mm), outline_from_back(mirror))


def test_a_drawing_from_the_front_is_the_mirror_image() -> None:
    facing = FACINGS["first"]
    outline = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 1.0)])
    np.testing.assert_array_equal(replace(facing, up="front").seen(outline), facing.seen(outline) * (1.0, -1.0))
