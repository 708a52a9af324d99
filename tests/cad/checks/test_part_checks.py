"""A part passes with the files that belong to it, and fails with any that do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from build123d import Box, Compound, Cylinder, Face, Part, Pos, Shell, Solid

from mirrorcam.cad.checks import check_part, part_checks
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.write.part_export import write_step, write_stl
from mirrorcam.cad.write.threemf import write_3mf
from mirrorcam.core.values import Metric

PRINTER = HARDWARE.printer


@pytest.fixture(autouse=True)
def _without_slicer(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the slicer says has tests of its own."""
    monkeypatch.setattr(part_checks, "check_slicing", lambda path, printer: {})


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def written(
    folder: Path, part: PartPlan, solid: Part, *, stl: Part | None = None, lies: PartPlan | None = None
) -> Path:
    """The folder with the files of a part: STEP of one solid, STL of it or another, 3MF of the STL as a plan lies."""
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
    """A hole of 1 mm through 10 mm is in the STL file only."""
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


def test_a_part_larger_than_the_bed_or_beside_it_is_found(block: PartPlan, tmp_path: Path) -> None:
    folder = written(tmp_path, block, block.make(block.plan))
    small = PRINTER.replaced(bed_mm=(50.0, 220.0, 20.0))
    checks = check_part(block, folder, small)
    # Beside: the file has it in the middle of the bed of 220 mm.
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
    """A fin of 0.9 mm, and a ledge of 5 mm; the box prints with y up."""
    solid = block.make(block.plan)
    fin = Pos(30, 36, 8) * Box(20.0, 10.0, 0.9)
    thin = check_part(block, written(tmp_path, block, Part((solid + fin).solids())), PRINTER)
    assert failed(thin) == {"wall_mm"}
    assert thin["wall_mm"].value == pytest.approx(0.9, abs=1e-3)
    ledge = Pos(63.5, 20, 8) * Box(5.0, 10.0, 10.0)
    hanging = check_part(block, written(tmp_path, block, Part((solid + ledge).solids())), PRINTER)
    assert failed(hanging) == {"overhang_mm2"}
    assert hanging["overhang_mm2"].value == pytest.approx(50.0)
