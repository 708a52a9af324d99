"""The hardware that a device is built from: a file, with another body, back or mounting of mirrors."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

from mirrorcam.cad.plan.back_table import BACKS, FileBack, Gen2Back
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.console.options import Adapter
from mirrorcam.core.errors import InputError
from mirrorcam.device.hardware_choice import HardwareChoice
from mirrorcam.optics.geometry.camera_library import read_body, read_camera
from mirrorcam.optics.geometry.layout import Layout


def test_what_is_not_named_stays_as_it_is() -> None:
    assert HardwareChoice().read() == HARDWARE
    other = HardwareChoice(body="board_38", mounting="screws").read()
    assert other.camera.name != HARDWARE.camera.name
    assert other.holder.mirrors == "screws"
    assert other.replaced(camera=HARDWARE.camera, holder=HARDWARE.holder) == HARDWARE


def test_the_body_is_that_of_the_layouts_camera_unless_another_is_stated(
    default_layout: Layout, tmp_path: Path
) -> None:
    other = default_layout.replaced(camera=read_camera("d435"))
    assert HardwareChoice().read(default_layout) == HARDWARE.for_mirrors_of(default_layout)
    assert HardwareChoice().read(other).camera == read_body("d435")
    assert HardwareChoice(body="brio").read(other).camera == read_body("brio")
    unknown = other.replaced(camera=other.camera.replaced(name="mine"))
    assert HardwareChoice().read(unknown).camera == HARDWARE.camera
    table = tmp_path / "hardware.toml"
    table.write_text('[screw]\nkind = "nut"\n', encoding="utf-8")
    assert HardwareChoice(hardware=table).read(other).camera == read_body("d435")
    table.write_text('camera = "oak_d"\n', encoding="utf-8")
    assert HardwareChoice(hardware=table).read(other).camera == read_body("oak_d")


def test_a_file_replaces_dimensions_and_a_bad_one_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "hardware.toml"
    table.write_text('[screw]\nkind = "nut"\n', encoding="utf-8")
    assert HardwareChoice(hardware=table).read().screw.kind == "nut"
    table.write_text("[screw]\nsort = 3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"hardware\.toml: screw\.sort"):
        HardwareChoice(hardware=table).read()


def test_the_back_is_the_one_that_is_named(tmp_path: Path) -> None:
    assert HardwareChoice().read().back.kind == "none"
    assert HardwareChoice(adapter="gen2").read().back == Gen2Back()
    table = tmp_path / "hardware.toml"
    table.write_text('[back]\nkind = "gen2"\ndiameter_mm = 65\n', encoding="utf-8")
    assert (
        HardwareChoice(hardware=table).read().back
        == HardwareChoice(hardware=table, adapter="gen2").read().back
        == Gen2Back(diameter_mm=65.0)
    )
    assert HardwareChoice(hardware=table, adapter="none").read() == HARDWARE
    table.write_text('[back]\nkind = "shelf"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"hardware\.toml: back"):
        HardwareChoice(hardware=table).read()
    with pytest.raises(InputError, match=r"adapter shelf: expected one of none, .* or a file \.py"):
        HardwareChoice(adapter=Path("shelf")).read()


def test_a_file_of_your_own_keeps_the_dimensions_of_the_table(tmp_path: Path) -> None:
    table, own = tmp_path / "hardware.toml", tmp_path / "own.py"
    own.touch()
    assert HardwareChoice(adapter=own).read().back == FileBack(file=own)
    table.write_text('[back]\nkind = "file"\ntip_deg = 7\n', encoding="utf-8")
    assert HardwareChoice(hardware=table, adapter=own).read().back == FileBack(file=own, tip_deg=7.0)


def test_the_adapters_are_the_backs_that_there_are() -> None:
    assert get_args(Adapter) == tuple(BACKS)
