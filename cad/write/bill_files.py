"""The bill of materials as files: Markdown, CSV and JSON say the same."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from mirrorcam.cad.plan.prices import BASIS, hours_text
from mirrorcam.cad.write.bill_of_materials import Bom
from mirrorcam.core.disk.files import write_json, write_text
from mirrorcam.core.names import markdown_text, spreadsheet_text


def write_bom(folder: Path, bom: Bom) -> None:
    """Write `bom.md`, `bom.csv` and `bom.json` into a folder."""
    write_text(folder / "bom.md", as_markdown(bom))
    write_text(folder / "bom.csv", as_csv(bom))
    write_json(folder / "bom.json", bom.model_dump(mode="json"))


def as_markdown(bom: Bom) -> str:
    """The bill as Markdown tables: printed, cut and bought."""
    money = markdown_text(bom.currency)
    how = "as sliced" if bom.sliced else "if printed solid"
    lines = [
        "# Parts list",
        "",
        f"Layout `{bom.layout_identity}`. {markdown_text(bom.estimate)}",
        "",
        "## Printed",
        "",
        f"| number | part | file | volume, cm³ | mass solid, g | mass sliced, g | time | {money} |",
        "|---|---|---|---:|---:|---:|---:|---:|",
        *(
            f"| {line.number} | {line.title} | [{Path(line.file).name}]({line.file}) | {line.volume_cm3:.1f} "
            f"| {line.solid_g:.1f} | {_or_dash(line.print_g, '.1f')} | {hours_text(line.print_minutes)} "
            f"| {line.price:.2f} |"
            for line in bom.printed
        ),
        "",
        f"{markdown_text(bom.plastic)}: {bom.plastic_g:.0f} g {how}{_in_all(bom)}.",
        "",
        "## Mirrors",
        "",
        f"| stock sheet | mirrors | area, cm² | sheets | files | {money} |",
        "|---|---:|---:|---:|---|---:|",
        *(
            f"| {line.sheet} | {line.count} | {line.area_cm2:.1f} "
            f"| {line.sheets} of {line.sheet_mm[0]:g} x {line.sheet_mm[1]:g} mm "
            f"| {', '.join(f'[{Path(file).name}]({file})' for file in line.files)} | {line.price:.2f} |"
            for line in bom.mirrors
        ),
        "",
        "## Bought",
        "",
        f"| count | what | standard | for | {money} |",
        "|---:|---|---|---|---:|",
        *(
            f"| {_or_dash(line.count, 'd')} | {markdown_text(line.title)} | {line.standard} | {line.note} "
            f"| {_or_dash(line.price, '.2f')} |"
            for line in bom.bought
        ),
    ]
    return "\n".join(lines) + "\n"


def as_csv(bom: Bom) -> str:
    """The bill as CSV, one row per line; a cell is empty where a column does not apply."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("kind", "number", "item", "count", "file", "solid_g", "print_g", "print_minutes", "price", "note"))
    for part in bom.printed:
        printed = (part.solid_g, part.print_g, part.print_minutes, part.price)
        note = spreadsheet_text(f"{bom.plastic}, {part.volume_cm3:g} cm3")
        writer.writerow(("printed", part.number, part.title, 1, part.file, *printed, note))
    for mirror in bom.mirrors:
        note = f"{mirror.sheets} sheets of {mirror.sheet_mm[0]:g} x {mirror.sheet_mm[1]:g} mm, {mirror.area_cm2:g} cm2"
        writer.writerow(
            ("mirror", "", mirror.sheet, mirror.count, " ".join(mirror.files), "", "", "", mirror.price, note)
        )
    for line in bom.bought:
        note = ", ".join(text for text in (line.standard, line.note) if text)
        writer.writerow(("bought", "", spreadsheet_text(line.title), line.count, "", "", "", "", line.price, note))
    total = spreadsheet_text(f"{bom.currency}, {bom.prices_date}: {BASIS}; without tools")
    writer.writerow(("total", "", "", "", "", "", "", bom.print_minutes, bom.price, total))
    return stream.getvalue()


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _in_all(bom: Bom) -> str:
    """The time of all prints together, where a slicer gave the time of each."""
    return f"; {hours_text(bom.print_minutes)} of printing in all" if bom.print_minutes is not None else ""
