"""Overhangs, bridges and islands of shapes whose areas are known; and two other ways to find them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from manifold3d import CrossSection, JoinType, Manifold

from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.overhangs import LAYER_MM, check_overhangs, floating_mm2, overhangs
from mirrorcam.cad.plan.hardware import HARDWARE

PRINTER = HARDWARE.printer


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Manifold:
    return Manifold.cube((x, y, z)).translate(at)


def slope(angle_deg: float) -> Manifold:
    """A block of 10 x 20 x 10 mm, one side of which leans outwards by an angle from upright."""
    reach = 10.0 * np.tan(np.radians(angle_deg))
    section = CrossSection([[(0.0, 0.0), (10.0, 0.0), (10.0 + reach, 10.0), (0.0, 10.0)]])
    return section.extrude(20.0).rotate((90.0, 0.0, 0.0))


def portal(span: float, length: float = 20.0) -> Manifold:
    """Two walls and a plate over them."""
    return box(5, length, 10) + box(5, length, 10, (5 + span, 0, 0)) + box(10 + span, length, 3, (0, 0, 10))


def mesh_of(solid: Manifold) -> trimesh.Trimesh:
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts))


def measured(solid: Manifold) -> dict[str, float]:
    mesh = mesh_of(solid)
    return {name: check.value for name, check in check_overhangs(mesh, solid_of(mesh), PRINTER).items()}


def unborne_by_layers_mm2(solid: Manifold) -> float:
    """Area of all layers that stands out over the layer below by more than the printer can: an independent measure."""
    _, _, low, _, _, high = solid.bounding_box()
    sections = [solid.slice(height) for height in np.arange(low + LAYER_MM / 2.0, high, LAYER_MM)]
    reach = LAYER_MM * np.tan(np.radians(PRINTER.overhang_deg)) + 1e-6
    grown = [section.offset(reach, JoinType.Miter) for section in sections]
    return float(sum((above - below).area() for above, below in zip(sections[1:], grown[:-1], strict=True)))


def test_a_block_on_the_bed_hangs_nowhere() -> None:
    assert set(measured(box(20, 30, 10)).values()) == {0.0}


@given(st.floats(5.0, 80.0), st.floats(0.0, 300.0))
def test_a_leaning_side_hangs_beyond_the_printers_angle(angle_deg: float, height: float) -> None:
    found = measured(slope(angle_deg).translate((3.0, 4.0, height)))
    side = 200.0 / np.cos(np.radians(angle_deg))
    if angle_deg > PRINTER.overhang_deg + 0.6:
        assert found["overhang_mm2"] == pytest.approx(side, rel=1e-3)
    elif angle_deg < PRINTER.overhang_deg + 0.4:
        assert found["overhang_mm2"] == 0.0
    assert found["bridged_mm2"] == found["floating_mm2"] == 0.0


@pytest.mark.parametrize("angle_deg", [30.0, 45.0, 50.0, 60.0, 70.0])
def test_layers_find_the_same_overhangs_as_faces(angle_deg: float) -> None:
    """Of a side of 20 mm at angle a every layer stands out by h tan a, of which h tan 45 deg is borne."""
    hanging, _, _ = overhangs(mesh_of(slope(angle_deg)), slope(angle_deg), PRINTER)
    by_layers = unborne_by_layers_mm2(slope(angle_deg))
    assert (hanging > 0.0) == (by_layers > 0.0)
    beyond = max(np.tan(np.radians(angle_deg)) - 1.0, 0.0)
    assert by_layers == pytest.approx(49 * 20.0 * LAYER_MM * beyond, rel=1e-3, abs=1e-6)


def test_a_ceiling_between_two_walls_bridges_up_to_the_printers_length() -> None:
    short, long = measured(portal(9.5)), measured(portal(10.5))
    assert short == {"overhang_mm2": 0.0, "bridged_mm2": 190.0, "longest_bridge_mm": 9.5, "floating_mm2": 0.0}
    assert long == {"overhang_mm2": 210.0, "bridged_mm2": 0.0, "longest_bridge_mm": 0.0, "floating_mm2": 0.0}


def test_a_bridge_is_as_long_as_its_short_way_across() -> None:
    """A hollow of 6 x 50 mm, closed all round, is bridged across; turned on the bed, at most by its slant."""
    hollow = box(16, 60, 12) - box(6, 50, 8, (5, 5, 0))
    assert measured(hollow)["longest_bridge_mm"] == pytest.approx(6.0)
    turned = measured(hollow.rotate((0.0, 0.0, 32.0)))
    assert turned["overhang_mm2"] == 0.0
    assert 6.0 <= turned["longest_bridge_mm"] <= 6.0 / np.cos(np.radians(2.5)) + 1e-6


def test_a_ledge_and_a_table_are_no_bridges() -> None:
    ledge = box(10, 20, 10) + box(13, 20, 3, (0, 0, 10))
    assert measured(ledge)["overhang_mm2"] == 60.0
    table = box(4, 4, 10, (8, 8, 0)) + box(20, 20, 3, (0, 0, 10))
    assert measured(table)["overhang_mm2"] == pytest.approx(400.0 - 16.0)


def test_a_ledge_as_narrow_as_a_layers_step_is_borne() -> None:
    def ledge(width: float) -> float:
        return measured(box(10, 20, 10) + box(10 + width, 20, 3, (0, 0, 10)))["overhang_mm2"]

    assert ledge(0.19) == 0.0
    assert ledge(0.21) == pytest.approx(4.2)


def test_the_blind_end_of_an_upright_hole_bridges_but_a_step_in_a_bore_hangs() -> None:
    bore, wide = Manifold.cylinder(6.0, 2.0, circular_segments=64), Manifold.cylinder(3.0, 4.0, circular_segments=64)
    area = 32.0 * np.sin(2.0 * np.pi / 64)
    blind = measured(box(12, 12, 10, (-6, -6, 0)) - bore)
    assert blind["bridged_mm2"] == pytest.approx(area * 4.0, rel=1e-3)
    assert blind["overhang_mm2"] == 0.0
    stepped = measured(box(12, 12, 6, (-6, -6, 0)) - bore - wide)
    assert stepped["overhang_mm2"] == pytest.approx(area * 16.0 - area * 4.0, rel=1e-3)


def test_a_lying_round_hole_hangs_and_a_teardrop_does_not() -> None:
    """Of a round ceiling hang the sides within 44.5 deg of its top, but the two at the top are flat and too narrow."""
    radius, sides = 4.0, 400
    block = box(20, 10, 20, (-10, 0, 0))
    hole = (
        Manifold.cylinder(10.0, radius, circular_segments=sides).rotate((-90.0, 0.0, 0.0)).translate((0.0, 0.0, 10.0))
    )
    from_top_deg = np.abs((np.arange(sides) + 0.5) * 360.0 / sides - 180.0)
    hanging = np.count_nonzero((from_top_deg > 1.0) & (from_top_deg < 44.5))
    expected = hanging * 2.0 * radius * np.sin(np.pi / sides) * 10.0
    assert measured(block - hole)["overhang_mm2"] == pytest.approx(expected, rel=1e-3)
    tip = CrossSection([[(-4 / 2**0.5, 4 / 2**0.5), (4 / 2**0.5, 4 / 2**0.5), (0, 4 * 2**0.5)]])
    roof = tip.extrude(10.0).rotate((90.0, 0.0, 0.0)).translate((0.0, 10.0, 10.0))
    assert measured(block - (hole + roof))["overhang_mm2"] == 0.0


def test_a_tip_that_hangs_down_steeply_starts_in_the_air() -> None:
    """No face of it hangs, yet its lower half is printed on nothing: a cone of 30 deg under a bridge."""
    height, radius = 6.0, 6.0 * np.tan(np.radians(30.0))
    tip = Manifold.cylinder(height, 0.0, radius, circular_segments=64).translate((10.0, 10.0, 4.0))
    arch = measured(portal(9.5))
    hung = measured(portal(9.5) + tip)
    assert arch["floating_mm2"] == 0.0
    top = radius - LAYER_MM / 2.0 * np.tan(np.radians(30.0))
    assert hung["floating_mm2"] == pytest.approx(32.0 * np.sin(2.0 * np.pi / 64) * top**2, rel=0.01)


def test_what_floats_is_told_from_what_leans_over() -> None:
    assert floating_mm2(slope(45.0), PRINTER.overhang_deg) == 0.0
    assert floating_mm2(box(5, 5, 5) + box(5, 5, 5, (0, 0, 8)), PRINTER.overhang_deg) == pytest.approx(25.0)
