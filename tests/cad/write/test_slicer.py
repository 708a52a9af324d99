"""What PrusaSlicer says of parts whose answer is known, and how its files are read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh

from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.checks.exported_mesh import read_3mf, solid_of
from mirrorcam.cad.checks.part_checks import check_overhangs
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write import slicer
from mirrorcam.cad.write.part_export import write_stl
from mirrorcam.cad.write.slicer import Sliced, check_slicing, find_slicer, read_gcode, slice_3mf, slicer_version
from mirrorcam.cad.write.threemf import write_3mf
from mirrorcam.optics.geometry.layout import Layout

PRINTER = HARDWARE.printer
installed = pytest.mark.skipif(find_slicer() is None, reason="PrusaSlicer is not installed")


@pytest.fixture
def block_3mf(block: PartPlan, built_block: BuiltPart, tmp_path: Path) -> Path:
    path = tmp_path / "block.3mf"
    write_3mf(path, built_block.stl, block, PRINTER)
    return path


def test_time_grams_and_support_are_read_from_a_gcode_file() -> None:
    text = (
        ";TYPE:Perimeter\nG1 X1 Y2 E0.5\n;TYPE:Support material\nG1 X3 Y4 E0.25\nG1 E-0.8 F2100\nG1 X5 Y4 E0.125\n"
        ";TYPE:Support material interface\nG1 X1 Y1 E1\n;TYPE:Perimeter\nG1 X2 Y2 E9\n"
        "; filament used [mm] = 4136.97\n; filament used [g] = 12.34\n"
        "; estimated printing time (normal mode) = 1d 2h 3m 30s\n"
    )
    assert read_gcode(text) == Sliced(minutes=24 * 60 + 123.5, grams=12.34, support_mm=1.375)
    assert read_gcode(text.replace("12.34", "0.00")) is None
    assert read_gcode("") is None


def test_without_a_slicer_nothing_is_said(block_3mf: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slicer, "find_slicer", lambda: None)
    assert check_slicing(block_3mf, PRINTER) == {}
    with pytest.raises(FileNotFoundError, match="PrusaSlicer is not installed"):
        slice_3mf(block_3mf, PRINTER)


@installed
def test_a_block_slices_to_between_its_shell_and_its_volume(block_3mf: Path) -> None:
    """18 cm3 of PLA are 22.3 g; with an infill of 20 % it weighs more than a fifth of that."""
    assert (slicer_version() or "").startswith("PrusaSlicer")
    checks = check_slicing(block_3mf, PRINTER)
    assert all(check.passed for check in checks.values())
    assert 0.2 * 18.0 * 1.24 < checks["print_g"].value < 18.0 * 1.24
    assert 10.0 < checks["print_minutes"].value < 300.0
    assert check_slicing(block_3mf, PRINTER) == checks


@installed
def test_a_broken_file_does_not_slice(block_3mf: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.3mf"
    broken.write_bytes(block_3mf.read_bytes()[:500])
    checks = check_slicing(broken, PRINTER)
    assert set(checks) == {"slices"}
    assert not checks["slices"].passed


def box(x: float, y: float, z: float, *at: float) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube((x, y, z)).translate(at)


def leaning(lean_deg: float) -> manifold3d.Manifold:
    """A block of 10 x 20 x 10 mm, whose side at large x leans outwards."""
    reach = 10.0 * np.tan(np.radians(lean_deg))
    section = manifold3d.CrossSection([[(0.0, 0.0), (10.0, 0.0), (10.0 + reach, 10.0), (0.0, 10.0)]])
    return section.extrude(20.0).rotate((90.0, 0.0, 0.0)).translate((0.0, 20.0, 0.0))


def write_shape(solid: manifold3d.Manifold, block: PartPlan, folder: Path) -> Path:
    """A 3MF file of a shape as it stands."""
    mesh = solid.to_mesh64()
    stl, path = folder / "shape.stl", folder / "shape.3mf"
    trimesh.Trimesh(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts)).export(stl)
    write_3mf(path, stl, replace(block, print_from_rig=np.eye(4)), PRINTER)
    return path


@installed
@pytest.mark.parametrize(
    ("lean_deg", "ledge_mm", "span_mm"), [(45, 0, 9), (40, 0, 6), (47, 0, 9), (30, 3, 9), (30, 0, 8), (60, 0, 0)]
)
def test_the_slicer_supports_what_our_own_check_finds_hanging(
    block: PartPlan, tmp_path: Path, lean_deg: float, ledge_mm: float, span_mm: float
) -> None:
    """A block with a leaning side, a ledge and a bridge, in any combination."""
    solid = leaning(lean_deg) + box(10 + ledge_mm, 20, 3, -ledge_mm, 0, 10)
    if span_mm:
        solid += box(5, 20, 16, 0, 0, 10) + box(5, 20, 16, 0, 20 + span_mm, 0) + box(5, 20 + span_mm + 20, 3, 0, 0, 26)
        solid += box(5, 20, 26, 0, 20 + span_mm, 0)
    path = write_shape(solid, block, tmp_path)
    printed = read_3mf(path)
    hangs = not check_overhangs(printed, solid_of(printed), PRINTER)["overhang_mm2"].passed
    assert hangs == (lean_deg > 45 or ledge_mm > 0)
    assert check_slicing(path, PRINTER)["support_filament_mm"].passed != hangs


@installed
@pytest.mark.parametrize("turn_deg", [0, 20, 35, 50, 65])
@pytest.mark.parametrize("lean_deg", [45, 47])
def test_the_slicer_says_the_same_however_a_part_is_turned(
    block: PartPlan, tmp_path: Path, lean_deg: float, turn_deg: float
) -> None:
    """A leaning side, and a wall as thin as a mount's skin with a slot under a flat ceiling."""
    skin = box(40, 1.6, 20, -30, 0, 0) - box(8, 4, 4, -20, -1, 6)
    path = write_shape((leaning(lean_deg) + skin).rotate((0.0, 0.0, turn_deg)), block, tmp_path)
    assert check_slicing(path, PRINTER)["support_filament_mm"].passed == (lean_deg <= 45)


@installed
def test_a_holder_for_captive_nuts_needs_no_support(default_layout: Layout, tmp_path: Path) -> None:
    """Where walls end over the slots that nuts slide in by, nothing hangs."""
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind="nut"))
    parts = parts_of(plan_device(default_layout, hardware))
    (holder,) = (part for part in parts if part.name == "mirror_holder")
    assert len(holder.plan.slots) == 4
    stl, path = tmp_path / "holder.stl", tmp_path / "holder.3mf"
    write_stl(stl, holder.make(holder.plan))
    write_3mf(path, stl, holder, PRINTER)
    assert check_slicing(path, PRINTER)["support_filament_mm"].passed
