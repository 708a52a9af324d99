"""The bill of materials, written as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from mirrorcam.cad.assembly.bill import Bom
from mirrorcam.cad.plan.prices import BASIS, hours_text
from mirrorcam.core.disk.files import write_json, write_text
from mirrorcam.core.names import anchor_of, markdown_text, spreadsheet_text
from mirrorcam.core.values import Metric


def bom_metrics(bom: Bom) -> dict[str, Metric]:
    """The device's figures in its bill: the price and, if sliced, the time of all prints."""
    metrics = {"device.price": Metric(value=bom.price, unit=bom.currency)}
    if bom.print_minutes is not None:
        metrics["device.print_minutes"] = Metric(value=bom.print_minutes, unit="min")
    return metrics


def write_bom(folder: Path, bom: Bom) -> None:
    """Write `bom.md`, `bom.csv` and `bom.json` into a folder."""
    write_text(folder / "bom.md", as_markdown(bom))
    write_text(folder / "bom.csv", as_csv(bom))
    write_json(folder / "bom.json", bom.model_dump(mode="json"))


def as_markdown(bom: Bom) -> str:
    """The bill as Markdown tables: printed, cut and bought."""
    money = markdown_text(bom.currency)
    basis = "as sliced" if bom.sliced else "estimated (install PrusaSlicer and build again for the mass as sliced)"
    lines = [
        "# Parts list",
        "",
        f"Layout `{bom.layout_identity}`. {markdown_text(bom.estimate)}",
        "",
        "## Printed",
        "",
        f"| number | part | file | volume, cm³ | mass, g | time | {money} |",
        "|---|---|---|---:|---:|---:|---:|",
        *(
            f"| {line.number} | {line.title} | [{Path(line.file).name}]({line.file}) | {line.volume_cm3:.1f} "
            f"| {line.print_g:.1f} | {hours_text(line.print_minutes)} "
            f"| {line.price:.2f} |"
            for line in bom.printed
        ),
        "",
        f"{markdown_text(bom.plastic)}: {bom.plastic_g:.0f} g {basis}{_total_time(bom)}.",
        "",
        "## Mirrors",
        "",
        f"| stock | mirrors | area, cm² | to buy | files | where | search words | {money} |",
        "|---|---:|---:|---|---|---|---|---:|",
        *(
            f"| {_linked(line.sheet)} | {line.count} | {line.area_cm2:.1f} | {line.to_buy} "
            f"| {', '.join(f'[{Path(file).name}]({file})' for file in line.files)} "
            f"| {line.supplier} | {line.search} | {line.price:.2f} |"
            for line in bom.mirrors
        ),
        "",
        "## Bought",
        "",
        f"| count | item | standard | used for | {money} |",
        "|---:|---|---|---|---:|",
        *(
            f"| {_or_dash(line.count, 'd')} | {markdown_text(line.title) if line.is_tool else _linked(line.title)} "
            f"| {line.standard} | {line.note} "
            f"| {_or_dash(line.price, '.2f')} |"
            for line in bom.bought
        ),
    ]
    return "\n".join(lines) + "\n"


def as_csv(bom: Bom) -> str:
    """The bill as CSV, one row per line; a cell is empty where a column does not apply."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("kind", "number", "item", "count", "file", "print_g", "print_minutes", "price", "note"))
    for part in bom.printed:
        printed = (part.print_g, part.print_minutes, part.price)
        note = spreadsheet_text(f"{bom.plastic}, {part.volume_cm3:g} cm3")
        writer.writerow(("printed", part.number, part.title, 1, part.file, *printed, note))
    for mirror in bom.mirrors:
        note = f"{mirror.to_buy}; {mirror.area_cm2:g} cm2; {mirror.supplier}: {mirror.search}"
        writer.writerow(("mirror", "", mirror.sheet, mirror.count, " ".join(mirror.files), "", "", mirror.price, note))
    for line in bom.bought:
        note = ", ".join(text for text in (line.standard, line.note) if text)
        writer.writerow(("bought", "", spreadsheet_text(line.title), line.count, "", "", "", line.price, note))
    total = spreadsheet_text(f"{bom.currency}, {bom.prices_date}: {BASIS}; without tools")
    writer.writerow(("total", "", "", "", "", "", bom.print_minutes, bom.price, total))
    return stream.getvalue()


def _linked(title: str) -> str:
    """A title that leads to its section of the guide."""
    return f"[{markdown_text(title)}](guide.md#{anchor_of(title)})"


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _total_time(bom: Bom) -> str:
    """The total time of all prints, if every part was sliced."""
    return f"; {hours_text(bom.print_minutes)} of printing in all" if bom.print_minutes is not None else ""
