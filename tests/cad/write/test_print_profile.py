"""Print profiles: the same settings for every slicer, and those that times and masses are measured with."""

from __future__ import annotations

import json

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.print_profile import SETTINGS, embedded, orca_profile, prusa_profile
from mirrorcam.cad.write.slicer import OPTIONS


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
