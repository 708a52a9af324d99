"""The table of dimensions that a device is built from: a file, with another camera or other fasteners."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.base.values import InputError
from mirrorcam.workflow.device_folder import read_hardware


def test_what_is_not_named_stays_as_it_is() -> None:
    assert read_hardware() == HARDWARE
    other = read_hardware(camera="board_38", fasteners="nut")
    assert other.camera.name != HARDWARE.camera.name
    assert other.screw.kind == "nut"
    assert other.replaced(camera=HARDWARE.camera, screw=HARDWARE.screw) == HARDWARE


def test_a_file_replaces_dimensions_and_a_bad_one_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "hardware.toml"
    table.write_text('[screw]\nkind = "nut"\n', encoding="utf-8")
    assert read_hardware(table).screw.kind == "nut"
    assert read_hardware(table, fasteners="insert").screw.kind == "insert"
    table.write_text("[screw]\nsort = 3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"hardware\.toml: screw\.sort"):
        read_hardware(table)
