"""The thinnest wall of shapes with known walls.

Overhangs, bridges and islands of shapes with known areas, and two independent methods to find them.

A part passes with its own files, and fails with any others.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from build123d import Box, Compound, Cylinder, Face, Part, Pos, Shell, Solid
from hypothesis import given
from hypothesis import strategies as st
from manifold3d import CrossSection, JoinType, Manifold
from scipy.spatial.transform import Rotation

from mirrorcam.cad.checks import check_part, part_checks
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.part_checks import (
    LAYER_MM,
    MAX_WALL_MM,
    check_overhangs,
    floating_mm2,
    overhangs,
    thinnest_floor_mm,
    thinnest_wall_mm,
)
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.write.part_export import write_step, write_stl
from mirrorcam.cad.write.threemf import write_3mf
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.transforms import rigid


def wall_mm(mesh: trimesh.Trimesh) -> float:
    return thinnest_wall_mm(mesh, solid_of(mesh))


@given(st.floats(0.3, 6.0), st.floats(8.0, 40.0), st.floats(8.0, 40.0), st.integers(0, 2**32 - 1))
def test_a_plate_is_as_thick_as_it_is_however_it_lies(thickness: float, width: float, length: float, seed: int) -> None:
    mesh = trimesh.creation.box((width, length, thickness))
    mesh.apply_transform(rigid(Rotation.random(random_state=seed % 2**31).as_matrix(), np.zeros(3)))
    assert wall_mm(mesh) == pytest.approx(thickness, abs=1e-6)


def test_the_sharp_edge_of_a_wedge_is_no_wall() -> None:
    corners = [(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 11), (20, 0, 11), (0, 20, 11)]
    assert wall_mm(trimesh.convex.convex_hull(np.array(corners, dtype=np.float64))) == pytest.approx(11.0, abs=1e-6)


def test_a_tube_is_as_thick_as_its_wall() -> None:
    """Facets of n sides reduce the wall by at most the outer sagitta r (1 - cos(pi / n))."""
    inner, outer, sides = 31.5, 32.6, 90
    tube = trimesh.creation.annulus(inner, outer, 8.0, sections=sides)
    assert outer - inner - outer * (1.0 - np.cos(np.pi / sides)) - 1e-6 <= wall_mm(tube) <= outer - inner + 1e-6


@pytest.mark.parametrize(("fin_mm", "found"), [(0.9, True), (0.4, True), (2.0, False)])
def test_a_fin_on_a_block_is_found_by_its_thickness(fin_mm: float, found: bool) -> None:
    block = solid_of(trimesh.creation.box((30.0, 20.0, 4.0)))
    fin = solid_of(trimesh.creation.box((10.0, fin_mm, 8.0)))
    both = (block + fin.translate((0.0, 0.0, 5.0))).to_mesh64()
    mesh = trimesh.Trimesh(np.array(both.vert_properties)[:, :3], np.array(both.tri_verts))
    assert wall_mm(mesh) == pytest.approx(fin_mm, abs=1e-6)
    assert (wall_mm(mesh) < 1.2) == found


def test_a_wall_smaller_than_a_dot_is_not_taken_for_one() -> None:
    """A cube of 0.3 mm on a block: its four sides face each other, over a total of 0.36 mm2."""
    block = solid_of(trimesh.creation.box((10.0, 10.0, 4.0)))
    crumb = solid_of(trimesh.creation.box((0.3, 0.3, 0.5)))
    both = (block + crumb.translate((0.0, 0.0, 2.05))).to_mesh64()
    mesh = trimesh.Trimesh(np.array(both.vert_properties)[:, :3], np.array(both.tri_verts))
    assert wall_mm(mesh) > 3.9


def test_floors_and_walls_are_distinguished_by_print_orientation() -> None:
    """An open box with a floor of 0.6 mm and walls of 2 mm, and a plate that is level, vertical or oblique."""
    outer, inner = (
        solid_of(trimesh.creation.box((30.0, 20.0, 10.0))),
        solid_of(trimesh.creation.box((26.0, 16.0, 10.0))),
    )
    both = (outer - inner.translate((0.0, 0.0, 0.6))).to_mesh64()
    tray = trimesh.Trimesh(np.array(both.vert_properties)[:, :3], np.array(both.tri_verts))
    up, along = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    assert thinnest_floor_mm(tray, solid_of(tray), up) == pytest.approx(0.6, abs=1e-6)
    assert thinnest_wall_mm(tray, solid_of(tray), up) == pytest.approx(2.0, abs=1e-6)
    # Printed on its end, the floor is a wall.
    assert thinnest_wall_mm(tray, solid_of(tray), along) == pytest.approx(0.6, abs=1e-6)
    ball = trimesh.creation.icosphere(radius=20.0)
    assert thinnest_floor_mm(ball, solid_of(ball), up) == MAX_WALL_MM


PRINTER = HARDWARE.printer


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Manifold:
    return Manifold.cube((x, y, z)).translate(at)


def slope(angle_deg: float) -> Manifold:
    """A block of 10 x 20 x 10 mm with one side that leans outwards by an angle from vertical."""
    reach = 10.0 * np.tan(np.radians(angle_deg))
    section = CrossSection([[(0.0, 0.0), (10.0, 0.0), (10.0 + reach, 10.0), (0.0, 10.0)]])
    return section.extrude(20.0).rotate((90.0, 0.0, 0.0))


def portal(span: float, length: float = 20.0) -> Manifold:
    """Two walls and a plate on them."""
    return box(5, length, 10) + box(5, length, 10, (5 + span, 0, 0)) + box(10 + span, length, 3, (0, 0, 10))


def mesh_of(solid: Manifold) -> trimesh.Trimesh:
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts))


def measured(solid: Manifold) -> dict[str, float]:
    mesh = mesh_of(solid)
    return {name: check.value for name, check in check_overhangs(mesh, solid_of(mesh), PRINTER).items()}


def unborne_by_layers_mm2(solid: Manifold) -> float:
    """Area of all layers that overhangs the layer below by more than the printer's limit: an independent measure."""
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
    """Every layer of a side of 20 mm at angle a overhangs by h tan a, of which h tan 45 deg is supported."""
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
    """A hollow of 6 x 50 mm, closed all round, is bridged across; rotated on the bed, by at most an oblique bridge."""
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
    """The sides of a round ceiling within 44.5 deg of its top overhang, except the two narrow flat ones at the top."""
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
    """A cone of 30 deg under a bridge has no overhanging face, but its lower half starts in the air."""
    height, radius = 6.0, 6.0 * np.tan(np.radians(30.0))
    tip = Manifold.cylinder(height, 0.0, radius, circular_segments=64).translate((10.0, 10.0, 4.0))
    arch = measured(portal(9.5))
    hung = measured(portal(9.5) + tip)
    assert arch["floating_mm2"] == 0.0
    top = radius - LAYER_MM / 2.0 * np.tan(np.radians(30.0))
    assert hung["floating_mm2"] == pytest.approx(32.0 * np.sin(2.0 * np.pi / 64) * top**2, rel=0.01)


def test_floating_areas_are_distinguished_from_overhangs() -> None:
    assert floating_mm2(slope(45.0), PRINTER.overhang_deg) == 0.0
    assert floating_mm2(box(5, 5, 5) + box(5, 5, 5, (0, 0, 8)), PRINTER.overhang_deg) == pytest.approx(25.0)


@pytest.fixture(autouse=True)
def _without_slicer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slicer's verdict has its own tests."""
    monkeypatch.setattr(part_checks, "check_slicing", lambda path, printer: {})


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def written(
    folder: Path, part: PartPlan, solid: Part, *, stl: Part | None = None, lies: PartPlan | None = None
) -> Path:
    """The folder with a part's files: STEP of one solid, STL of it or another, 3MF of the STL in print orientation."""
    write_step(folder / f"{part.name}.step", solid)
    write_stl(folder / f"{part.name}.stl", stl or solid)
    write_3mf(folder / f"{part.name}.3mf", folder / f"{part.name}.stl", lies or part, PRINTER)
    return folder


def test_a_box_passes_with_its_volume_and_size(block: PartPlan, tmp_path: Path) -> None:
    checks = check_part(block, written(tmp_path, block, block.make(block.plan)), PRINTER)
    assert failed(checks) == set()
    values = {name: check.value for name, check in checks.items()}
    assert values["volume_cm3"] == 18.0
    assert values["wall_mm"] == 10.0
    assert [values[f"print_{side}_mm"] for side in ("length", "width", "height")] == pytest.approx([60.0, 10.0, 30.0])
    assert values["mesh_triangles"] == 12


def test_a_round_part_may_lose_what_its_facets_cut_off(block: PartPlan, tmp_path: Path) -> None:
    plan = replace(block, print_from_rig=np.eye(4))
    checks = check_part(plan, written(tmp_path, plan, Part(Pos(0, 0, 15) * Cylinder(31.5, 30.0))), PRINTER)
    assert failed(checks) == set()
    error = checks["stl_volume_error_mm3"]
    assert error.limit is not None
    assert 0.0 < error.value < error.limit


def test_files_of_different_solids_are_found(block: PartPlan, tmp_path: Path) -> None:
    """Only the STL file has a hole of 1 mm through 10 mm."""
    solid = block.make(block.plan)
    drilled = Part((solid - Pos(30, 17, 8) * Cylinder(0.5, 12.0)).solids())
    checks = check_part(block, written(tmp_path, block, solid, stl=drilled), PRINTER)
    assert {"stl_volume_error_mm3", "3mf_volume_error_mm3"} <= failed(checks)
    assert checks["stl_volume_error_mm3"].value == pytest.approx(np.pi / 4.0 * 10.0, rel=0.05)


def test_two_solids_and_none_are_found(block: PartPlan, tmp_path: Path) -> None:
    solid = block.make(block.plan)
    two = Part([*solid.solids(), *(Pos(0, 100, 8) * Box(5.0, 5.0, 10.0)).solids()])
    checks = check_part(block, written(tmp_path, block, two), PRINTER)
    assert {"solids", "mesh_pieces"} <= failed(checks)
    write_step(tmp_path / "block.step", Compound([Face.make_rect(3.0, 4.0)]))
    assert "invalid_solids" in failed(check_part(block, tmp_path, PRINTER))


def test_a_solid_that_is_not_closed_is_invalid(block: PartPlan, tmp_path: Path) -> None:
    solid = block.make(block.plan)
    written(tmp_path, block, solid)
    write_step(tmp_path / "block.step", Solid(Shell(solid.faces()[:-1])))
    checks = check_part(block, tmp_path, PRINTER)
    assert failed(checks) & {"solids", "invalid_solids"}


def test_a_part_that_lies_otherwise_than_planned_is_found(block: PartPlan, tmp_path: Path) -> None:
    flat = replace(block, print_from_rig=np.eye(4))
    checks = check_part(block, written(tmp_path, block, block.make(block.plan), lies=flat), PRINTER)
    assert failed(checks) == {"lie_error_um"}
    assert checks["lie_error_um"].value == pytest.approx(20_000.0, abs=1.0)


def test_a_part_larger_than_the_bed_or_off_it_is_detected(block: PartPlan, tmp_path: Path) -> None:
    folder = written(tmp_path, block, block.make(block.plan))
    small = PRINTER.replaced(bed_mm=(50.0, 220.0, 20.0))
    checks = check_part(block, folder, small)
    # Not centred: in the file it is in the middle of the bed of 220 mm.
    assert failed(checks) == {"print_height_mm", "off_bed_um"}
    tiny = check_part(block, folder, PRINTER.replaced(bed_mm=(50.0, 50.0, 250.0)))
    assert failed(tiny) == {"print_length_mm", "off_bed_um"}


def test_a_mesh_with_a_hole_proves_nothing(block: PartPlan, tmp_path: Path) -> None:
    folder = written(tmp_path, block, block.make(block.plan))
    mesh = trimesh.load_mesh(folder / "block.stl")
    mesh.update_faces(np.arange(len(mesh.faces)) != 3)
    mesh.export(folder / "block.stl")
    write_3mf(folder / "block.3mf", folder / "block.stl", block, PRINTER)
    checks = check_part(block, folder, PRINTER)
    assert {"mesh_watertight", "mesh_manifold", "wall_mm", "overhang_mm2"} <= failed(checks)
    assert checks["wall_mm"].value == 0.0


def test_a_thin_wall_and_an_overhang_are_found_in_the_files(block: PartPlan, tmp_path: Path) -> None:
    """A fin of 0.7 mm, and a ledge of 5 mm; the box prints with y up."""
    solid = block.make(block.plan)
    fin = Pos(30, 36, 8) * Box(20.0, 10.0, 0.7)
    thin = check_part(block, written(tmp_path, block, Part((solid + fin).solids())), PRINTER)
    assert failed(thin) == {"wall_mm"}
    assert thin["wall_mm"].value == pytest.approx(0.7, abs=1e-3)
    ledge = Pos(63.5, 20, 8) * Box(5.0, 10.0, 10.0)
    hanging = check_part(block, written(tmp_path, block, Part((solid + ledge).solids())), PRINTER)
    assert failed(hanging) == {"overhang_mm2"}
    assert hanging["overhang_mm2"].value == pytest.approx(50.0)
