"""The bill of materials: counted right, and the same in its three files."""

from __future__ import annotations

import csv
import html
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from markdown_it import MarkdownIt
from shapely import Polygon

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BoughtItem, BoughtKind, BuiltPart
from mirrorcam.cad.write import bill_of_materials
from mirrorcam.cad.write.bill_of_materials import Bom, bill_of, write_bom
from mirrorcam.optics.base.files import read_model
from mirrorcam.optics.base.values import Metric
from mirrorcam.optics.geometry.camera_library import read_body


@pytest.fixture
def bom(device: Device, built_block: BuiltPart, monkeypatch: pytest.MonkeyPatch) -> Bom:
    items: list[tuple[BoughtKind, float, tuple[str, ...]]] = [
        *(("screw", 8.0, ("mount", "mirror_holder")),) * 4,
        *(("screw", 12.0, ("camera_clip", "mount")),) * 2,
        ("screw", 8.0, ("adapter_cap",)),
        *(("insert", 5.7, ("mirror_holder",)),) * 4,
    ]
    bought = tuple(BoughtItem(kind, "M3", length, np.eye(4), np.zeros(3), joins) for kind, length, joins in items)
    monkeypatch.setattr(bill_of_materials, "bought_items", lambda _: bought)
    sliced = {"print_minutes": Metric(value=75.4, unit="min"), "print_g": Metric(value=9.5, unit="g")}
    parts = [built_block.replaced(checks=sliced), built_block.replaced(name="other", number="MC-98", checks=sliced)]
    return bill_of(device, parts, plan_sheets(device.layout, HARDWARE.cutting))


def test_pieces_are_counted_by_kind_and_length(bom: Bom) -> None:
    assert [(line.title, line.count) for line in bom.bought] == [
        ("Logitech C920", 1),
        ("M3 x 12 screw", 2),
        ("M3 x 8 screw", 5),
        ("M3 x 5.7 heat-set insert", 4),
        ("Cable tie, at most 4 mm wide", 2),
        ("Glue for acrylic that does not craze it (neutral silicone)", None),
        ("Tool: syringe of 5 ml", None),
        ("Tool: soldering iron with a tip for M3 inserts", None),
    ]
    assert [line.standard for line in bom.bought[1:4]] == ["ISO 4762, socket head"] * 2 + ["brass"]
    assert bom.bought[2].note == "adapter cap, mirror holder, mount: at most 0.097 N m"


@pytest.mark.parametrize(("name", "ties"), [("c920", 2), ("pi_hq_cs", 3), ("iphone_13", 0)])
def test_ties_are_bought_for_what_is_tied(
    name: str, ties: int, device: Device, built_block: BuiltPart, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bill_of_materials, "bought_items", lambda _: ())
    other = replace(device, hardware=HARDWARE.replaced(camera=read_body(name)))
    bought = bill_of(other, [built_block], plan_sheets(device.layout, HARDWARE.cutting)).bought
    assert sum(line.count or 0 for line in bought if line.title.startswith("Cable tie")) == ties


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
    assert html.unescape(page).count(name) == 2
    rows = list(csv.reader((tmp_path / "bom.csv").read_text(encoding="utf-8").splitlines()))
    assert [row[2] for row in rows if row[8] == "the camera"] == [f"'{name}"]
    assert not [cell for row in rows for cell in row if cell.startswith(("=", "+", "@"))]
    assert json.loads((tmp_path / "bom.json").read_text(encoding="utf-8"))["plastic"] == name


def test_plastic_and_mirrors_add_up(bom: Bom, device: Device, built_block: BuiltPart) -> None:
    assert bom.sliced
    assert bom.plastic_g == 19.0
    assert bom.printed[0].solid_g == pytest.approx(18.0 * 1.24, abs=0.05)
    (mirrors,) = bom.mirrors
    assert mirrors.count == 9
    area = sum(Polygon(mirror.outline_in_plane_mm).area for mirror in device.layout.mirrors)
    assert mirrors.area_cm2 == pytest.approx(area / 100.0, abs=0.05)
    assert mirrors.files == ("mirrors/mirrors.dxf",)
    unsliced = bill_of(device, [built_block], plan_sheets(device.layout, HARDWARE.cutting))
    assert not unsliced.sliced
    assert unsliced.plastic_g == pytest.approx(18.0 * 1.24, abs=0.05)


def test_the_three_files_say_the_same(bom: Bom, tmp_path: Path) -> None:
    write_bom(tmp_path, bom)
    assert read_model(Bom, tmp_path / "bom.json") == bom
    assert json.loads((tmp_path / "bom.json").read_text(encoding="utf-8"))["printed"][0]["print_minutes"] == 75.4
    rows = list(csv.DictReader((tmp_path / "bom.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(bom.printed) + len(bom.mirrors) + len(bom.bought)
    assert {row["item"]: row["count"] for row in rows}["M3 x 8 screw"] == "5"
    text = (tmp_path / "bom.md").read_text(encoding="utf-8")
    tables = [line for line in text.splitlines() if line.startswith("|") and not line.startswith("|---")]
    assert len(tables) == len(rows) + 3
    assert "| MC-99 | Block | [block.3mf](parts/block.3mf) | 18.0 | 22.3 | 9.5 | 1:15 h |" in text
    assert "PLA: 19 g as sliced; 2:30 h of printing in all." in text
    # No row has more or fewer cells than its header.
    for table in re.split(r"\n\n", text):
        widths = {line.count("|") for line in table.splitlines() if line.startswith("|")}
        assert len(widths) <= 1
