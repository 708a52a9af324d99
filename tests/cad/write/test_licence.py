"""Licence and source of a device: the written source gives the same device."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.part_plan import LICENCE
from mirrorcam.cad.write.licence import hardware_toml, write_source
from mirrorcam.core.disk.files import read_model
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("camera", ["c920", "board_38"])
def test_hardware_is_read_back_as_it_was(camera: str, tmp_path: Path) -> None:
    hardware = HARDWARE.replaced(
        camera=read_body(camera),
        screw=HARDWARE.screw.replaced(kind="nut"),
        printer=HARDWARE.printer.replaced(plastic='PETG "matt" \\ Größe'),
    )
    (tmp_path / "hardware.toml").write_text(hardware_toml(hardware), encoding="utf-8")
    assert read_model(Hardware, tmp_path / "hardware.toml") == hardware


@pytest.mark.slow
def test_the_source_plans_the_same_device(small_layout: Layout, tmp_path: Path) -> None:
    write_source(tmp_path, small_layout, HARDWARE)
    layout = Layout.load(tmp_path / "source" / "layout.json")
    assert layout.identity == small_layout.identity
    device = plan_device(layout, read_model(Hardware, tmp_path / "source" / "hardware.toml"))
    assert device.hardware == HARDWARE
    notice = (tmp_path / "NOTICE.txt").read_text(encoding="utf-8")
    assert layout.identity in notice
    assert "WITHOUT ANY EXPRESS OR IMPLIED WARRANTY" in notice


def test_the_licence_is_shipped_whole() -> None:
    text = (ROOT / "LICENSES" / f"{LICENCE}.txt").read_text(encoding="utf-8")
    assert text.startswith("CERN Open Hardware Licence Version 2 - Weakly Reciprocal")
    for section in ("1 Definitions", "4 Making and Conveying Products", "6 DISCLAIMER AND LIABILITY", "8 General"):
        assert f"\n{section}\n" in text
