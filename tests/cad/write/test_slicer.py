"""Print profiles: the same settings for every slicer as for the stated times and masses.

PrusaSlicer's verdict on parts with known answers, and the reader of its files.
"""

from __future__ import annotations

import json
import re
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
from mirrorcam.cad.plan.hardware import HARDWARE, Printer
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write import slicer
from mirrorcam.cad.write.part_export import write_stl
from mirrorcam.cad.write.slicer import (
    SPEEDS,
    Sliced,
    check_slicing,
    embedded,
    find_slicer,
    orca_profile,
    prusa_profile,
    read_gcode,
    settings_of,
    slice_3mf,
    slicer_version,
)
from mirrorcam.cad.write.threemf import write_3mf
from mirrorcam.optics.geometry.layout import Layout
from tests.nightly import a_few

# As OrcaSlicer 2.2.0 has them (its commit 1088d0a6c713): what `load_from_json` of src/libslic3r/Config.cpp takes out of
# a preset before it reads settings, by the names in Preset.hpp; and, of the settings of a process
# (`s_Preset_print_options` in Preset.cpp), those that are used here, with their types in PrintConfig.cpp.
ORCA_HEADER = {"type", "name", "from", "version", "url", "description", "setting_id", "filament_id", "instantiation"}
ORCA_TYPES = {
    "layer_height": "float",
    "initial_layer_print_height": "float",
    "wall_loops": "int",
    "wall_generator": "enum",
    "sparse_infill_density": "percent",
    "sparse_infill_pattern": "pattern",
    "enable_support": "bool",
    "inner_wall_speed": "float",
    "outer_wall_speed": "float",
    "sparse_infill_speed": "float",
    "internal_solid_infill_speed": "float",
    "top_surface_speed": "float",
    "gap_infill_speed": "float",
    "travel_speed": "float",
    "default_acceleration": "float",
    "minimum_sparse_infill_area": "float",
}
# `percent` as the presets of OrcaSlicer have it; the names of the enumerations are those of the wall generators, and
# some of the patterns of infill.
ORCA_VALUES = {
    "float": r"\d+(\.\d+)?",
    "int": r"\d+",
    "percent": r"\d+(\.\d+)?%",
    "bool": r"[01]",
    "enum": "classic|arachne",
    "pattern": "adaptivecubic|cubic|grid|gyroid|lightning|supportcubic",
}
# `import_json_presets` of PresetBundle.cpp refuses a file without a version of two to four numbers
# (src/semver/semver.c), and knows by the name of this setting that it holds a process, not by the type.
ORCA_PROCESS = "print_settings_id"
ORCA_VERSION = r"\d+(\.\d+){1,3}"


CAREFUL = HARDWARE.printer.replaced(speeds="careful")


@pytest.mark.parametrize("printer", [HARDWARE.printer, CAREFUL])
def test_the_profile_has_the_speeds_of_its_printer(printer: Printer) -> None:
    profile = dict(line.split(" = ") for line in prusa_profile(printer).splitlines())
    assert profile.items() >= settings_of(printer).items() >= SPEEDS[printer.speeds].items()
    assert profile["support_material"] == "0"
    assert profile["bed_shape"] == "0x0,220x0,220x220,0x220"
    assert list(profile) == sorted(profile)


def test_in_a_project_every_line_is_a_comment() -> None:
    first, blank, *lines = embedded("a = 1\nb = 2\n").splitlines()
    assert first.startswith(";")
    assert (blank, lines) == ("", ["; a = 1", "; b = 2"])


def test_the_other_family_of_slicers_gets_the_same_numbers() -> None:
    settings, common = json.loads(orca_profile(HARDWARE.printer)), settings_of(HARDWARE.printer)
    assert settings["type"] == "process"
    assert settings["wall_loops"] == common["perimeters"]
    assert settings["sparse_infill_density"] == common["fill_density"]
    assert settings["enable_support"] == "0"
    # Each with its counterpart in PrusaSlicer's names, and no others.
    numbers = {"layer_height", "first_layer_height", "default_acceleration", "solid_infill_below_area"}
    numbers |= {name for name in common if name.endswith("_speed")}
    assert sorted(settings[name] for name, kind in ORCA_TYPES.items() if kind == "float") == sorted(
        common[name] for name in numbers - {"small_perimeter_speed"}
    )


def test_orca_slicer_knows_every_setting_and_reads_its_value() -> None:
    settings = json.loads(orca_profile(HARDWARE.printer))
    assert all(isinstance(value, str) for value in settings.values())
    read = {name: value for name, value in settings.items() if name not in ORCA_HEADER | {ORCA_PROCESS}}
    assert read.keys() == ORCA_TYPES.keys()
    for name, value in read.items():
        assert re.fullmatch(ORCA_VALUES[ORCA_TYPES[name]], value), name


def test_orca_slicer_imports_it_as_a_process() -> None:
    settings = json.loads(orca_profile(HARDWARE.printer))
    assert settings[ORCA_PROCESS] == settings["name"]
    assert re.fullmatch(ORCA_VERSION, settings["version"])
    # These would make it a printer or a plastic, or depend on a preset that not everybody has.
    others = {"printer_settings_id", "filament_settings_id", "inherits", "compatible_printers"}
    assert settings.keys().isdisjoint(others)


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


def test_without_a_slicer_nothing_is_reported(block_3mf: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slicer, "find_slicer", lambda: None)
    assert check_slicing(block_3mf, PRINTER) == {}
    with pytest.raises(FileNotFoundError, match="PrusaSlicer is not installed"):
        slice_3mf(block_3mf, PRINTER)


@installed
def test_a_block_slices_to_between_its_shell_and_its_volume(block_3mf: Path) -> None:
    """18 cm3 of PLA are 22.3 g; with an infill of 10 % the mass is more than a tenth of that."""
    assert (slicer_version() or "").startswith("PrusaSlicer")
    checks = check_slicing(block_3mf, PRINTER)
    assert all(check.passed for check in checks.values())
    assert 0.1 * 18.0 * 1.24 < checks["print_g"].value < 18.0 * 1.24
    assert 5.0 < checks["print_minutes"].value < 300.0
    assert check_slicing(block_3mf, PRINTER) == checks


@installed
def test_careful_speeds_take_at_least_half_as_long_again(block_3mf: Path) -> None:
    ordinary, careful = (slice_3mf(block_3mf, printer) for printer in (PRINTER, CAREFUL))
    assert ordinary and careful
    assert careful.minutes > 1.5 * ordinary.minutes
    assert careful.grams == pytest.approx(ordinary.grams, rel=0.01)


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
    """A block of 10 x 20 x 10 mm with a side at large x that leans outwards."""
    reach = 10.0 * np.tan(np.radians(lean_deg))
    section = manifold3d.CrossSection([[(0.0, 0.0), (10.0, 0.0), (10.0 + reach, 10.0), (0.0, 10.0)]])
    return section.extrude(20.0).rotate((90.0, 0.0, 0.0)).translate((0.0, 20.0, 0.0))


def write_shape(solid: manifold3d.Manifold, block: PartPlan, folder: Path) -> Path:
    """A 3MF file of a shape in its orientation."""
    mesh = solid.to_mesh64()
    stl, path = folder / "shape.stl", folder / "shape.3mf"
    trimesh.Trimesh(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts)).export(stl)
    write_3mf(path, stl, replace(block, print_from_rig=np.eye(4)), PRINTER)
    return path


@installed
@pytest.mark.parametrize(
    ("lean_deg", "ledge_mm", "span_mm"),
    a_few(2, [(45, 0, 9), (40, 0, 6), (47, 0, 9), (30, 3, 9), (30, 0, 8), (60, 0, 0)]),
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
@pytest.mark.parametrize("turn_deg", a_few(2, [0, 20, 35, 50, 65]))
@pytest.mark.parametrize("lean_deg", [45, 47])
def test_the_slicer_says_the_same_however_a_part_is_turned(
    block: PartPlan, tmp_path: Path, lean_deg: float, turn_deg: float
) -> None:
    """A leaning side, and a wall as thin as a mount's skin with a slot under a flat ceiling."""
    skin = box(40, 1.6, 20, -30, 0, 0) - box(8, 4, 4, -20, -1, 6)
    path = write_shape((leaning(lean_deg) + skin).rotate((0.0, 0.0, turn_deg)), block, tmp_path)
    assert check_slicing(path, PRINTER)["support_filament_mm"].passed == (lean_deg <= 45)


@pytest.mark.slow
@installed
def test_a_holder_for_captive_nuts_needs_no_support(default_layout: Layout, tmp_path: Path) -> None:
    """Walls that end over the slots for nuts do not overhang."""
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind="nut"))
    parts = parts_of(plan_device(default_layout, hardware))
    (holder,) = (part for part in parts if part.name == "mirror_holder")
    assert len(holder.plan.slots) == 4
    stl, path = tmp_path / "holder.stl", tmp_path / "holder.3mf"
    write_stl(stl, holder.make(holder.plan))
    write_3mf(path, stl, holder, PRINTER)
    assert check_slicing(path, PRINTER)["support_filament_mm"].passed
