"""The bill of materials: one value, written as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import Field
from shapely import Polygon

from mirrorcam.cad.assembly.catalogue import bought_items
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.pieces import item_title, standard_of
from mirrorcam.cad.holder.glue import glue_amount
from mirrorcam.cad.mirrors.stock_sheets import StockSheet
from mirrorcam.cad.plan.part_plan import BoughtItem, BuiltPart
from mirrorcam.cad.plan.tightening import Tightening, tightenings
from mirrorcam.optics.base.files import write_json, write_text
from mirrorcam.optics.base.names import markdown_text, spreadsheet_text
from mirrorcam.optics.base.values import Value

# All carriers of mirrors in a note.
CARRIERS = "mirror_carriers"
GLUES = {
    "acrylic": "Glue for acrylic that does not craze it (neutral silicone)",
    "glass": "Glue for mirrors that does not attack their coating (neutral silicone)",
}


class PrintedLine(Value):
    """A part to print. Time and plastic are a slicer's, with its infill, where one was available."""

    number: str
    title: str
    file: str = Field(description="3MF, from the folder of the bill")
    volume_cm3: float
    solid_g: float = Field(description="mass if printed solid")
    print_minutes: float | None
    print_g: float | None


class MirrorLine(Value):
    """The mirrors cut from one kind of stock sheet."""

    sheet: str
    names: tuple[str, ...]
    area_cm2: float
    sheets: int
    sheet_mm: tuple[float, float]
    files: tuple[str, ...] = Field(description="DXF, from the folder of the bill")

    @property
    def count(self) -> int:
        return len(self.names)


class BoughtLine(Value):
    """An item to buy, by its number or by the amount in its note; `standard` is its trade designation."""

    title: str
    count: int | None
    standard: str = ""
    note: str


class Bom(Value):
    """All that a device is made of, and the fit coupon; `plastic_g` is a slicer's where all parts were `sliced`."""

    layout_identity: str
    plastic: str
    plastic_g: float
    sliced: bool
    printed: tuple[PrintedLine, ...]
    mirrors: tuple[MirrorLine, ...]
    bought: tuple[BoughtLine, ...]


def bill_of(device: Device, parts: Sequence[BuiltPart], sheets: Sequence[StockSheet]) -> Bom:
    """Make the bill of materials of a device from its built parts and its stock sheets."""
    printed = tuple(_printed(part) for part in parts)
    grams = [line.print_g for line in printed]
    sliced = None not in grams
    return Bom(
        layout_identity=device.layout.identity,
        plastic=device.hardware.printer.plastic,
        plastic_g=round(sum(g for g in grams if g is not None) if sliced else sum(p.solid_g for p in printed), 1),
        sliced=sliced,
        printed=printed,
        mirrors=_mirrors(device, sheets),
        bought=_bought(device, {part.name: part.title.lower() for part in parts}),
    )


def _printed(part: BuiltPart) -> PrintedLine:
    minutes, grams = part.checks.get("print_minutes"), part.checks.get("print_g")
    return PrintedLine(
        number=part.number,
        title=part.title,
        file=f"parts/{part.name}.3mf",
        volume_cm3=round(part.mass.volume_mm3 / 1000.0, 2),
        solid_g=round(part.mass.mass_g, 1),
        print_minutes=minutes.value if minutes else None,
        print_g=grams.value if grams else None,
    )


def _mirrors(device: Device, sheets: Sequence[StockSheet]) -> tuple[MirrorLine, ...]:
    kinds: dict[str, list[StockSheet]] = {}
    for sheet in sheets:
        kinds.setdefault(sheet.kind, []).append(sheet)
    areas = {
        name: Polygon(mirror.outline_in_plane_mm).area
        for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True)
    }
    lines = []
    for kind, group in kinds.items():
        names = tuple(cut.name for sheet in group for cut in sheet.cuts)
        lines.append(
            MirrorLine(
                sheet=kind,
                names=names,
                area_cm2=round(sum(areas[name] for name in names) / 100.0, 1),
                sheets=len(group),
                sheet_mm=device.hardware.cutting.sheet_mm,
                files=tuple(f"mirrors/{sheet.stem}.dxf" for sheet in group),
            )
        )
    return tuple(lines)


def _bought(device: Device, titles: Mapping[str, str]) -> tuple[BoughtLine, ...]:
    items, mount = bought_items(device), device.hardware.mount
    counted = Counter((item.kind, item_title(item)) for item in items)
    torques = tightenings(items, device.hardware)
    order = ("screw", "washer", "spring", "insert", "nut", "pin")
    lines = [BoughtLine(title=device.hardware.camera.name, count=1, note="the camera")]
    for key in sorted(counted, key=lambda key: (order.index(key[0]), key[1])):
        same = [each for each in zip(items, torques, strict=True) if (each[0].kind, item_title(each[0])) == key]
        lines.append(
            BoughtLine(title=key[1], count=counted[key], standard=standard_of(key[1]), note=_where(same, titles))
        )
    tied = ["cable to camera clip", "cable to mount"] if device.hardware.camera.has_cable else []
    tied += ["lens to camera clip"] if device.hardware.camera.rest_mm is not None else []
    if tied:
        title = f"Cable tie, at most {mount.tie_mm[0]:g} mm wide"
        lines.append(BoughtLine(title=title, count=len(tied), note=", ".join(tied)))
    lines.append(
        BoughtLine(
            title=GLUES[device.hardware.cutting.material],
            count=None,
            note=f"{glue_amount(device.holder.glue_mm3)}, {device.hardware.holder.bond_mm:g} mm behind every mirror",
        )
    )
    lines.append(BoughtLine(title="Tool: syringe of 5 ml", count=None, note="to lay beads of glue"))
    if any(item.kind == "insert" for item in items):
        lines.append(
            BoughtLine(
                title="Tool: soldering iron with a tip for M3 inserts", count=None, note="at about 220 °C in PLA"
            )
        )
    return tuple(lines)


def _where(items: Sequence[tuple[BoughtItem, Tightening | None]], titles: Mapping[str, str]) -> str:
    """The parts that items join, and how far screws among them may be tightened."""
    joined: dict[str, set[str]] = {}
    for item, tightening in items:
        joined.setdefault(tightening.text if tightening else "", set()).update(item.joins)
    places = []
    for text, names in joined.items():
        kinds = {CARRIERS if name.startswith("carrier_") else name for name in names}
        where = ", ".join(titles.get(name, name.replace("_", " ")) for name in sorted(kinds))
        places.append(f"{where}: at most {text}" if text else where)
    return "; ".join(places)


def write_bom(folder: Path, bom: Bom) -> None:
    """Write `bom.md`, `bom.csv` and `bom.json` into a folder."""
    write_text(folder / "bom.md", as_markdown(bom))
    write_text(folder / "bom.csv", as_csv(bom))
    write_json(folder / "bom.json", bom.model_dump(mode="json"))


def as_markdown(bom: Bom) -> str:
    """The bill as Markdown tables: printed, cut and bought."""
    how = "as sliced" if bom.sliced else "if printed solid"
    lines = [
        "# Parts list",
        "",
        f"Layout `{bom.layout_identity}`.",
        "",
        "## Printed",
        "",
        "| number | part | file | volume, cm³ | mass solid, g | mass sliced, g | time |",
        "|---|---|---|---:|---:|---:|---:|",
        *(
            f"| {line.number} | {line.title} | [{Path(line.file).name}]({line.file}) | {line.volume_cm3:.1f} "
            f"| {line.solid_g:.1f} | {_or_dash(line.print_g, '.1f')} | {_hours(line.print_minutes)} |"
            for line in bom.printed
        ),
        "",
        f"{markdown_text(bom.plastic)}: {bom.plastic_g:.0f} g {how}{_in_all(bom)}.",
        "",
        "## Mirrors",
        "",
        "| stock sheet | mirrors | area, cm² | sheets | files |",
        "|---|---:|---:|---:|---|",
        *(
            f"| {line.sheet} | {line.count} | {line.area_cm2:.1f} "
            f"| {line.sheets} of {line.sheet_mm[0]:g} x {line.sheet_mm[1]:g} mm "
            f"| {', '.join(f'[{Path(file).name}]({file})' for file in line.files)} |"
            for line in bom.mirrors
        ),
        "",
        "## Bought",
        "",
        "| count | what | standard | for |",
        "|---:|---|---|---|",
        *(
            f"| {_or_dash(line.count, 'd')} | {markdown_text(line.title)} | {line.standard} | {line.note} |"
            for line in bom.bought
        ),
    ]
    return "\n".join(lines) + "\n"


def as_csv(bom: Bom) -> str:
    """The bill as CSV, one row per line; a cell is empty where a column does not apply."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("kind", "number", "item", "count", "file", "solid_g", "print_g", "print_minutes", "note"))
    for part in bom.printed:
        printed = (part.solid_g, part.print_g, part.print_minutes)
        note = spreadsheet_text(f"{bom.plastic}, {part.volume_cm3:g} cm3")
        writer.writerow(("printed", part.number, part.title, 1, part.file, *printed, note))
    for mirror in bom.mirrors:
        note = f"{mirror.sheets} sheets of {mirror.sheet_mm[0]:g} x {mirror.sheet_mm[1]:g} mm, {mirror.area_cm2:g} cm2"
        writer.writerow(("mirror", "", mirror.sheet, mirror.count, " ".join(mirror.files), "", "", "", note))
    for line in bom.bought:
        note = ", ".join(text for text in (line.standard, line.note) if text)
        writer.writerow(("bought", "", spreadsheet_text(line.title), line.count, "", "", "", "", note))
    return stream.getvalue()


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _in_all(bom: Bom) -> str:
    """The time of all prints together, where a slicer gave the time of each."""
    minutes = [line.print_minutes for line in bom.printed if line.print_minutes is not None]
    return f"; {_hours(sum(minutes))} of printing in all" if len(minutes) == len(bom.printed) else ""


def _hours(minutes: float | None) -> str:
    return "-" if minutes is None else f"{int(minutes) // 60}:{int(minutes) % 60:02d} h"
