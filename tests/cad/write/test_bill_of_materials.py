"""The bill of materials: counts and prices.

The three files of a bill of materials: equal content, and safe to open.
"""

from __future__ import annotations

import csv
import html
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w
from markdown_it import MarkdownIt
from shapely import Polygon

from mirrorcam.cad.assembly.bill import Bom, bill_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.cad.write.bill_of_materials import bom_metrics, write_bom
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.camera_library import read_body


def test_pieces_are_counted_by_kind_and_length(bom: Bom) -> None:
    assert [(line.title, line.count) for line in bom.bought] == [
        ("PLA filament, 1.75 mm, any colour", None),
        ("Logitech C920", 1),
        ("M3 x 12 screw", 2),
        ("M3 x 8 screw", 5),
        ("M3 x 5.7 heat-set insert", 4),
        ("Cable tie, at most 4 mm wide", 2),
        ("Glue for mirrors that does not attack their coating (neutral silicone)", None),
        *((f"Tool: {tool}", None) for tool in ("calipers", "kitchen scale", "steel ruler", "blade")),
        *((f"Tool: {tool}", None) for tool in ("goggles and cut-resistant gloves", "paint marker")),
        ("Tool: soldering iron with a tip for M3 inserts", None),
        *((f"Tool: {tool}", None) for tool in ("5 ml syringe", "cotton gloves", "2.5 mm hex key", "side cutters")),
        ("Tool: dental floss", None),
        ("Also needed: calibration board, printed on paper", None),
        ("Also needed: flat stiff plate of the same size, glass or aluminium", None),
    ]
    assert [line.standard for line in bom.bought[2:5]] == ["ISO 4762, socket head"] * 2 + ["brass"]
    assert bom.bought[4].note == "mirror holder; for a hole of 4.0 mm"
    assert bom.bought[3].note == "adapter cap, mirror holder, mount: at most 0.097 N m"


@pytest.mark.parametrize(("name", "ties"), [("c920", 2), ("pi_hq_cs", 3), ("iphone_13", 0)])
def test_ties_are_bought_for_what_is_tied(
    name: str, ties: int, device: Device, built_block: BuiltPart, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mirrorcam.cad.assembly.bill.purchased_items", lambda _: ())
    other = replace(device, hardware=HARDWARE.replaced(camera=read_body(name)))
    bought = bill_of(other, [built_block], plan_sheets(device.layout, HARDWARE.cutting)).bought
    assert sum(line.count or 0 for line in bought if line.title.startswith("Cable tie")) == ties


def test_plastic_and_mirrors_add_up(bom: Bom, device: Device, built_block: BuiltPart) -> None:
    assert bom.sliced
    assert bom.plastic_g == 19.0
    assert bom.bought[0].note.startswith("19 g as sliced")
    seen = [built_block.replaced(name="mirror_holder"), built_block.replaced(name="other", number="MC-98")]
    grams = [float(line.note.split()[0]) for line in bill_of(device, seen, ()).bought[:2]]
    assert [line.title for line in bill_of(device, seen, ()).bought[:2]] == [
        "PLA filament, 1.75 mm, matt black",
        "PLA filament, 1.75 mm, any colour",
    ]
    assert grams == pytest.approx([18.0 * 1.24] * 2, abs=0.5)
    (mirrors,) = bom.mirrors
    assert mirrors.count == 9
    area = sum(Polygon(mirror.outline_in_plane_mm).area for mirror in device.layout.mirrors)
    assert mirrors.area_cm2 == pytest.approx(area / 100.0, abs=0.05)
    assert mirrors.files == ("mirrors/mirrors.dxf",)
    unsliced = bill_of(device, [built_block], plan_sheets(device.layout, HARDWARE.cutting))
    assert not unsliced.sliced
    assert unsliced.plastic_g == pytest.approx(18.0 * 1.24, abs=0.05)


def test_every_line_has_its_price_and_the_sum_is_the_devices(bom: Bom, device: Device, built_block: BuiltPart) -> None:
    # 9.5 g at 22 EUR per kg; 5 screws at 12 cents; the camera.
    assert [line.price for line in bom.printed] == [0.21, 0.21]
    prices = {line.title: line.price for line in bom.bought}
    assert prices["M3 x 8 screw"] == 0.6
    assert prices["M3 x 5.7 heat-set insert"] == 0.6
    assert prices["Logitech C920"] == 70.0
    assert {title for title, price in prices.items() if price is None} == {
        t for t in prices if t.startswith(("Tool: ", "Also needed: ", "PLA filament"))
    }
    assert "filament" not in bom.estimate
    # A whole sheet of 300 x 200 mm at 8 EUR per 100 cm2.
    assert bom.mirrors[0].price == 48.0
    assert bom.mirrors[0].to_buy == "1 of 300 x 200 mm"
    lines = [*(line.price for line in bom.printed), *(line.price for line in bom.mirrors), *prices.values()]
    assert bom.price == pytest.approx(sum(price for price in lines if price is not None))
    assert bom.unpriced == ()
    assert f"About {bom.price:.0f} EUR, as of 2026-11 (typical retail prices" in bom.estimate
    assert bom_metrics(bom) == {
        "device.price": Metric(value=bom.price, unit="EUR"),
        "device.print_minutes": Metric(value=150.0, unit="min"),
    }
    assert list(bom_metrics(bill_of(device, [built_block], ()))) == ["device.price"]


def test_a_hardware_file_replaces_prices_and_what_has_none_is_named(
    device: Device, built_block: BuiltPart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mirrorcam.cad.assembly.bill.purchased_items", lambda _: ())
    (tmp_path / "mine.toml").write_text(
        """[prices]
currency = "CHF"
date = "2027-02"
[prices.plastic_per_kg]
PLA = 100
[prices.each]
"Cable tie" = 3.5

"""
        + tomli_w.dumps(
            {"camera": device.hardware.camera.replaced(name="A camera").model_dump(mode="json", exclude_none=True)}
        )
    )
    hardware = read_model(Hardware, tmp_path / "mine.toml")
    bill = bill_of(replace(device, hardware=hardware), [built_block], plan_sheets(device.layout, HARDWARE.cutting))
    assert bill.printed[0].price == pytest.approx(18.0 * 1.24 * 0.1, abs=0.006)
    (tie,) = (line for line in bill.bought if line.title.startswith("Cable tie"))
    assert tie.count
    assert tie.price == 3.5 * tie.count
    assert bill.unpriced == ("A camera",)
    assert bill.estimate.startswith(f"About {bill.price:.0f} CHF without A camera, as of 2027-02")


def test_a_hostile_name_is_text_in_every_file(
    device: Device, built_block: BuiltPart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mirrorcam.cad.assembly.bill.purchased_items", lambda _: ())
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
    # The plastic, its filament, the camera, and the camera among the items without a price.
    assert html.unescape(page).count(name) == 4
    rows = list(csv.reader((tmp_path / "bom.csv").read_text(encoding="utf-8").splitlines()))
    assert [row[2] for row in rows if row[8] == "the camera"] == [f"'{name}"]
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
    assert "| MC-99 | Block | [block.3mf](parts/block.3mf) | 18.0 | 9.5 | 1:15 h | 0.21 |" in text
    assert "PLA: 19 g as sliced; 2:30 h of printing in all." in text
    # No row has more or fewer cells than its header.
    for table in re.split(r"\n\n", text):
        widths = {line.count("|") for line in table.splitlines() if line.startswith("|")}
        assert len(widths) <= 1
