"""The three files of a bill of materials: the same, and safe to open."""

from __future__ import annotations

import csv
import html
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.cad.write import bill_of_materials
from mirrorcam.cad.write.bill_files import write_bom
from mirrorcam.cad.write.bill_of_materials import Bom, bill_of
from mirrorcam.core.disk.files import read_model


def test_a_hostile_name_is_text_in_every_file(
    device: Device, built_block: BuiltPart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bill_of_materials, "bought_items", lambda _: ())
    name = '=HYPERLINK("http://x") <img src=x onerror=alert(1)> | a'
    hardware = device.hardware.replaced(
        camera=device.hardware.camera.replaced(name=name), printer=device.hardware.printer.replaced(plastic=name)
    )
    bill = bill_of(replace(device, hardware=hardware), [built_block], plan_sheets(device.layout, HARDWARE.cutting))
    write_bom(tmp_path, bill)
    markdown = (tmp_path / "bom.md").read_text(encoding="utf-8")
    assert "<img" not in markdown
    page = MarkdownIt("commonmark", {"html": True}).enable("table").render(markdown)
    assert "<img" not in page
    # The plastic, the camera, and the camera as what has no price.
    assert html.unescape(page).count(name) == 3
    rows = list(csv.reader((tmp_path / "bom.csv").read_text(encoding="utf-8").splitlines()))
    assert [row[2] for row in rows if row[9] == "the camera"] == [f"'{name}"]
    assert not [cell for row in rows for cell in row if cell.startswith(("=", "+", "@"))]
    assert json.loads((tmp_path / "bom.json").read_text(encoding="utf-8"))["plastic"] == name


def test_the_three_files_say_the_same(bom: Bom, tmp_path: Path) -> None:
    write_bom(tmp_path, bom)
    assert read_model(Bom, tmp_path / "bom.json") == bom
    assert json.loads((tmp_path / "bom.json").read_text(encoding="utf-8"))["printed"][0]["print_minutes"] == 75.0
    rows = list(csv.DictReader((tmp_path / "bom.csv").read_text(encoding="utf-8").splitlines()))
    total = rows.pop()
    assert len(rows) == len(bom.printed) + len(bom.mirrors) + len(bom.bought)
    assert (total["kind"], float(total["print_minutes"]), float(total["price"])) == ("total", 150.0, bom.price)
    assert sum(float(row["price"] or 0.0) for row in rows) == pytest.approx(bom.price)
    assert {row["item"]: row["count"] for row in rows}["M3 x 8 screw"] == "5"
    text = (tmp_path / "bom.md").read_text(encoding="utf-8")
    tables = [line for line in text.splitlines() if line.startswith("|") and not line.startswith("|---")]
    assert len(tables) == len(rows) + 3
    assert "| MC-99 | Block | [block.3mf](parts/block.3mf) | 18.0 | 22.3 | 9.5 | 1:15 h | 0.21 |" in text
    assert "PLA: 19 g as sliced; 2:30 h of printing in all." in text
    # No row has more or fewer cells than its header.
    for table in re.split(r"\n\n", text):
        widths = {line.count("|") for line in table.splitlines() if line.startswith("|")}
        assert len(widths) <= 1
