"""Print profiles: the same settings for every slicer, and those that times and masses are measured with."""

from __future__ import annotations

import json
import re

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.print_profile import SETTINGS, embedded, orca_profile, prusa_profile
from mirrorcam.cad.write.slicer import OPTIONS

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
    "enable_support": "bool",
    "inner_wall_speed": "float",
    "outer_wall_speed": "float",
    "sparse_infill_speed": "float",
    "internal_solid_infill_speed": "float",
    "top_surface_speed": "float",
    "gap_infill_speed": "float",
    "travel_speed": "float",
}
# `percent` as the presets of OrcaSlicer have it; the names of the enumeration are those of the wall generators.
ORCA_VALUES = {
    "float": r"\d+(\.\d+)?",
    "int": r"\d+",
    "percent": r"\d+(\.\d+)?%",
    "bool": r"[01]",
    "enum": "classic|arachne",
}
# `import_json_presets` of PresetBundle.cpp refuses a file without a version of two to four numbers
# (src/semver/semver.c), and knows by the name of this setting that it holds a process, not by the type.
ORCA_PROCESS = "print_settings_id"
ORCA_VERSION = r"\d+(\.\d+){1,3}"


def test_what_is_printed_with_is_what_is_measured_with() -> None:
    profile = dict(line.split(" = ") for line in prusa_profile(HARDWARE.printer).splitlines())
    assert profile.items() >= SETTINGS.items()
    assert {name.replace("-", "_"): value for name, value in OPTIONS.items()}.items() >= SETTINGS.items()
    assert profile["support_material"] == "0"
    assert profile["bed_shape"] == "0x0,220x0,220x220,0x220"
    assert list(profile) == sorted(profile)


def test_in_a_project_every_line_is_a_comment() -> None:
    first, blank, *lines = embedded("a = 1\nb = 2\n").splitlines()
    assert first.startswith(";")
    assert (blank, lines) == ("", ["; a = 1", "; b = 2"])


def test_the_other_family_of_slicers_gets_the_same_numbers() -> None:
    settings = json.loads(orca_profile())
    assert settings["type"] == "process"
    assert settings["wall_loops"] == SETTINGS["perimeters"]
    assert settings["sparse_infill_density"] == SETTINGS["fill_density"]
    assert settings["enable_support"] == "0"
    # Each with its counterpart in PrusaSlicer's names, and none besides.
    numbers = {"layer_height", "first_layer_height", *(name for name in SETTINGS if name.endswith("_speed"))}
    assert sorted(settings[name] for name, kind in ORCA_TYPES.items() if kind == "float") == sorted(
        SETTINGS[name] for name in numbers - {"small_perimeter_speed"}
    )


def test_orca_slicer_knows_every_setting_and_reads_its_value() -> None:
    settings = json.loads(orca_profile())
    assert all(isinstance(value, str) for value in settings.values())
    read = {name: value for name, value in settings.items() if name not in ORCA_HEADER | {ORCA_PROCESS}}
    assert read.keys() == ORCA_TYPES.keys()
    for name, value in read.items():
        assert re.fullmatch(ORCA_VALUES[ORCA_TYPES[name]], value), name


def test_orca_slicer_imports_it_as_a_process() -> None:
    settings = json.loads(orca_profile())
    assert settings[ORCA_PROCESS] == settings["name"]
    assert re.fullmatch(ORCA_VERSION, settings["version"])
    # These would make it a printer or a plastic, or have it stand on a preset which not everybody has.
    others = {"printer_settings_id", "filament_settings_id", "inherits", "compatible_printers"}
    assert settings.keys().isdisjoint(others)
