"""Solids that cuts remove, in closed form: plain bores, teardrops, slots and pockets for nuts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mirrorcam.cad.parts.part_solids import bore_solid, cut_solid, hexagon_solid
from mirrorcam.cad.plan.fasteners import ROOF_DEG, Bore, Countersink, Hexagon
from mirrorcam.cad.plan.prisms import box

DOWN, UP = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
STEEP = math.radians(ROOF_DEG)
TEARDROP = math.pi - (math.pi / 2 - STEEP) + 1 / math.tan(STEEP)


def test_a_bore_without_a_direction_is_a_cylinder() -> None:
    assert bore_solid(Bore(np.zeros(3), DOWN, 2.0, 5.0)).volume == pytest.approx(math.pi * 4.0 * 5.0)


def test_a_horizontal_bore_is_a_teardrop_with_its_ridge_up() -> None:
    bore = Bore(np.zeros(3), DOWN, 2.0, 5.0, UP)
    solid = bore_solid(bore)
    assert solid.volume == pytest.approx(TEARDROP * 4.0 * 5.0)
    assert solid.bounding_box().max.X == pytest.approx(bore.roof_mm) == pytest.approx(2.0 / math.sin(STEEP))
    assert pytest.approx(-2.0) == solid.bounding_box().min.X


def test_a_flat_slot_is_two_half_circles_and_a_rectangle() -> None:
    slot = bore_solid(Bore(np.zeros(3), DOWN, 2.0, 5.0, UP, 6.0, ceiling_mm=20.0))
    assert np.ptp([slot.bounding_box().min.Y, slot.bounding_box().max.Y]) == pytest.approx(10.0)
    # Above its upper quarters the ceiling is level: corners replace the arcs between the steep tangents.
    assert slot.volume > (math.pi * 4.0 + 6.0 * 4.0) * 5.0
    assert slot.volume < 10.0 * 4.0 * 5.0
    assert pytest.approx(2.0) == slot.bounding_box().max.X


def test_a_slots_ceiling_is_higher_where_it_would_bridge_too_far() -> None:
    slot = bore_solid(Bore(np.zeros(3), DOWN, 2.0, 5.0, UP, 6.0, ceiling_mm=4.0))
    top = slot.bounding_box().max.X
    ceiling = next(face for face in slot.faces() if pytest.approx(top) == face.center().X)
    assert top > 2.0
    assert ceiling.area == pytest.approx(4.0 * 5.0)


def test_a_groove_is_the_volume_swept_by_a_countersunk_head() -> None:
    mouth, end, deep, travel = 4.0, 2.0, 2.0, 6.0
    cone = cut_solid(Countersink(np.zeros(3), DOWN, mouth, end, deep))
    groove = cut_solid(Countersink(np.zeros(3), DOWN, mouth, end, deep, UP, travel))
    assert cone.volume == pytest.approx(math.pi * deep / 3.0 * (mouth**2 + mouth * end + end**2))
    assert groove.volume == pytest.approx(cone.volume + (mouth + end) * deep * travel)
    assert tuple(groove.bounding_box().size) == pytest.approx((2.0 * mouth, 2.0 * mouth + travel, deep))


def test_a_pocket_holds_its_nut_and_has_a_roof_over_it() -> None:
    pocket = hexagon_solid(Hexagon(np.zeros(3), DOWN, UP, 5.5, 3.0))
    assert pocket.volume > math.sqrt(3.0) / 2.0 * 5.5**2 * 3.0
    size = pocket.bounding_box().size
    assert pytest.approx((5.5, 3.0)) == (size.Y, size.Z)
    assert 5.5 * 2.0 / math.sqrt(3.0) < size.X


def test_any_cut_becomes_its_solid() -> None:
    assert cut_solid(box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))).volume == pytest.approx(6.0)
    assert cut_solid(Bore(np.zeros(3), DOWN, 1.0, 1.0)).volume == pytest.approx(math.pi)
