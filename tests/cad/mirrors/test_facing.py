"""Which face of the stock lies up: never the coating, and the side that drawings are seen from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.mirrors.facing import FACINGS, Material, Surface, facing_of
from mirrorcam.cad.mirrors.stock_sheets import outline_from_back
from mirrorcam.cad.plan.hardware import Cutting
from mirrorcam.optics.geometry.layout import Layout


@pytest.mark.parametrize("material", ["acrylic", "glass"])
@pytest.mark.parametrize("surface", ["first", "second"])
def test_the_laser_meets_the_face_that_is_glued(default_layout: Layout, surface: Surface, material: Material) -> None:
    """The back, at the lower of the two heights over the reflecting surface; the coating is engraved in neither."""
    facing = facing_of(surface, material)
    mirror = default_layout.mirrors[0].replaced(surface=surface)
    assert facing.up == "back"
    assert mirror.back_mm < mirror.front_mm
    coating_is_up = mirror.is_second_surface
    assert ("paint" in facing.marked.replace("paint marker", "")) == coating_is_up
    if material == "acrylic":
        assert ("not the paint" in facing.marked) == coating_is_up
    else:
        assert "marker" in facing.marked
    np.testing.assert_array_equal(
        facing.seen(mirror.outline_in_plane_mm), outline_from_back(mirror, Cutting(material=material))
    )


def test_a_drawing_from_the_front_is_the_mirror_image() -> None:
    facing = FACINGS["acrylic", "first"]
    outline = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 1.0)])
    np.testing.assert_array_equal(replace(facing, up="front").seen(outline), facing.seen(outline) * (1.0, -1.0))
