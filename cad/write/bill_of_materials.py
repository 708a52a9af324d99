"""The bill of materials, written as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import Field
from shapely import Polygon

from mirrorcam.cad.assembly.build_steps import also_needed, tools_of
from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import item_title, standard_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.glue import glue_amount
from mirrorcam.cad.mirrors.stock_sheets import TEST, StockSheet
from mirrorcam.cad.plan.part_plan import BuiltPart, PurchasedItem
from mirrorcam.cad.plan.prices import BASIS, Prices, hours_text, mirror_source
from mirrorcam.cad.plan.rectangles import coupon_mirror_mm, is_sold_in_size, size_mm
from mirrorcam.cad.plan.tightening import Tightening, tightenings
from mirrorcam.core.disk.files import write_json, write_text
from mirrorcam.core.names import markdown_text, spreadsheet_text
from mirrorcam.core.values import Metric, Value
from mirrorcam.optics.geometry.layout import Layout

# Common name of all mirror carriers in a note.
CARRIERS = "mirror_carriers"
# Prefixes of titles without a price.
TOOL, ALSO = "Tool: ", "Also needed: "
GLUES = {
    "acrylic": "Glue for acrylic that does not craze it (neutral silicone)",
    "glass": "Glue for mirrors that does not attack their coating (neutral silicone)",
}


class PrintedLine(Value):
    """A part to print. Time and mass of plastic, including infill, are from the slicer; null without a slicer."""

    number: str
    title: str
    file: str = Field(description="3MF file, relative to the folder of the bill")
    volume_cm3: float
    solid_g: float = Field(description="mass if printed solid")
    print_minutes: float | None = Field(description="rounded to a minute, so that the parts add up to the total")
    print_g: float | None
    price: float = Field(description="price of its filament")


class MirrorLine(Value):
    """The mirrors of one kind of stock: cut from sheets, or bought in their sizes with a spare one."""

    sheet: str
    names: tuple[str, ...]
    area_cm2: float
    sheets: int = Field(description="number of sheets; 0 if mirrors are bought in their sizes")
    pieces: tuple[str, ...] = Field(description="sizes to buy with their counts, such as 9 x (30 x 20 mm)")
    sheet_mm: tuple[float, float]
    files: tuple[str, ...] = Field(description="DXF files, relative to the folder of the bill")
    supplier: str = Field(description="who sells the stock")
    search: str = Field(description="words to search for")
    price: float = Field(description="price of whole sheets, or of the pieces")

    @property
    def count(self) -> int:
        return len(self.names)

    @property
    def to_buy(self) -> str:
        """The sheets or the sizes to buy."""
        width, height = self.sheet_mm
        return ", ".join(self.pieces) or f"{self.sheets} of {width:g} x {height:g} mm"


class BoughtLine(Value):
    """An item to buy, with its count or with the amount in its note; `standard` is its trade designation."""

    title: str
    count: int | None
    standard: str = ""
    note: str
    price: float | None = Field(
        default=None, description="price of all of them; null for tools, for items to be made, and if unknown"
    )


class Bom(Value):
    """All materials of a device, including the fit coupon; `plastic_g` is from the slicer if all parts were `sliced`.

    Prices are in `currency`, as of `prices_date`. `price` is the sum of all lines with a price; `unpriced` has the
    titles of the others.
    """

    layout_identity: str
    plastic: str
    plastic_g: float
    sliced: bool
    printed: tuple[PrintedLine, ...]
    mirrors: tuple[MirrorLine, ...]
    bought: tuple[BoughtLine, ...]
    currency: str
    prices_date: str
    price: float
    unpriced: tuple[str, ...]

    @property
    def print_minutes(self) -> float | None:
        """The total time of all prints; None unless every part was sliced."""
        minutes = [line.print_minutes for line in self.printed if line.print_minutes is not None]
        return sum(minutes) if len(minutes) == len(self.printed) else None

    @property
    def estimate(self) -> str:
        """The total cost, as a sentence."""
        exclusions = f" without {', '.join(self.unpriced)}" if self.unpriced else ""
        return f"About {self.price:.0f} {self.currency}{exclusions}, as of {self.prices_date} ({BASIS}; without tools)."


def bill_of(device: Device, parts: Sequence[BuiltPart], sheets: Sequence[StockSheet]) -> Bom:
    """Make the bill of materials of a device from its built parts and its stock sheets."""
    printer, prices = device.hardware.printer, device.hardware.prices
    printed = tuple(_printed(part, printer.plastic, prices) for part in parts)
    grams = [line.print_g for line in printed]
    sliced = None not in grams
    mirrors = _mirrors(device, sheets)
    plastic_g = round(sum(g for g in grams if g is not None) if sliced else sum(p.solid_g for p in printed), 1)
    filament = BoughtLine(
        title=f"{printer.plastic} filament, 1.75 mm, matt black",
        count=None,
        note=f"{plastic_g:.0f} g {'as sliced' if sliced else 'if printed solid'}, priced with the printed parts; "
        "only the mirror holder must be matt black",
    )
    bought = (filament, *_bought(device, {part.name: part.title.lower() for part in parts}))
    priced = [line.price for line in printed] + [line.price for line in mirrors]
    priced += [line.price for line in bought if line.price is not None]
    return Bom(
        layout_identity=device.layout.identity,
        plastic=printer.plastic,
        plastic_g=plastic_g,
        sliced=sliced,
        printed=printed,
        mirrors=mirrors,
        bought=bought,
        currency=prices.currency,
        prices_date=prices.date,
        price=round(sum(priced), 2),
        unpriced=tuple(line.title for line in bought[1:] if _lacks_price(line)),
    )


def _lacks_price(line: BoughtLine) -> bool:
    return line.price is None and not line.title.startswith((TOOL, ALSO))


def _printed(part: BuiltPart, plastic: str, prices: Prices) -> PrintedLine:
    minutes, grams = part.checks.get("print_minutes"), part.checks.get("print_g")
    return PrintedLine(
        number=part.number,
        title=part.title,
        file=f"parts/{part.name}.3mf",
        volume_cm3=round(part.mass.volume_mm3 / 1000.0, 2),
        solid_g=round(part.mass.mass_g, 1),
        print_minutes=float(round(minutes.value)) if minutes else None,
        print_g=grams.value if grams else None,
        price=round(prices.of_plastic(plastic, grams.value if grams else part.mass.mass_g), 2),
    )


def _mirrors(device: Device, sheets: Sequence[StockSheet]) -> tuple[MirrorLine, ...]:
    kinds: dict[str, list[StockSheet]] = {}
    for sheet in sheets:
        kinds.setdefault(sheet.kind, []).append(sheet)
    areas = {
        name: Polygon(mirror.outline_in_plane_mm).area
        for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True)
    }
    lines, prices, sheet_mm = [], device.hardware.prices, device.hardware.cutting.sheet_mm
    pieces = _pieces(device.layout) if is_sold_in_size(device.layout) else {}
    for kind, group in kinds.items():
        names = tuple(cut.name for sheet in group for cut in sheet.cuts if cut.name != TEST)
        source, bought = mirror_source(kind), 0 if pieces else len(group)
        price = prices.of_mirror_pieces(kind, sum(pieces.values()))
        if not pieces:
            price = prices.of_mirrors(kind, bought * sheet_mm[0] * sheet_mm[1] / 100.0)
        lines.append(
            MirrorLine(
                sheet=kind,
                names=names,
                area_cm2=round(sum(areas[name] for name in names) / 100.0, 1),
                sheets=bought,
                pieces=tuple(f"{count} x ({size} mm)" for size, count in pieces.items()),
                sheet_mm=sheet_mm,
                files=tuple(f"mirrors/{sheet.stem}.dxf" for sheet in group),
                supplier=source.supplier,
                search=source.search,
                price=round(price, 2),
            )
        )
    return tuple(lines)


def _pieces(layout: Layout) -> Counter[str]:
    """Counts of the sizes that are bought, with a spare one of the smallest as the coupon's test mirror."""
    sizes = [*(size_mm(mirror) for mirror in layout.mirrors), coupon_mirror_mm(layout)]
    return Counter(f"{longer:g} x {shorter:g}" for longer, shorter in sorted(sizes, reverse=True))


def _bought(device: Device, titles: Mapping[str, str]) -> tuple[BoughtLine, ...]:
    items, mount = purchased_items(device), device.hardware.mount
    counts = Counter((item.kind, item_title(item)) for item in items)
    torques = tightenings(items, device.hardware)
    order = ("screw", "washer", "spring", "insert", "nut", "pin")
    lines = [BoughtLine(title=device.hardware.camera.name, count=1, note="the camera")]
    for key in sorted(counts, key=lambda key: (order.index(key[0]), key[1])):
        same_items = [pair for pair in zip(items, torques, strict=True) if (pair[0].kind, item_title(pair[0])) == key]
        note = _joined_parts(same_items, titles)
        if key[0] == "insert":
            note += f"; for a hole of {device.hardware.screw.insert_hole_mm:.1f} mm"
        lines.append(BoughtLine(title=key[1], count=counts[key], standard=standard_of(key[1]), note=note))
    tied_items = ["cable to camera clip", "cable to mount"] if device.hardware.camera.has_cable else []
    tied_items += ["camera to camera clip"] * len(device.clip.straps_mm)
    tied_items += ["lens to camera clip"] if device.hardware.camera.rest_mm is not None else []
    if tied_items:
        title = f"Cable tie, at most {mount.tie_mm[0]:g} mm wide"
        lines.append(BoughtLine(title=title, count=len(tied_items), note=", ".join(tied_items)))
    lines.append(_fixing(device))
    for kind, tools in ((TOOL, tools_of(device, items)), (ALSO, also_needed(device))):
        lines += [BoughtLine(title=kind + tool.name, count=None, note=tool.purpose) for tool in tools]
    return tuple(_priced(line, device.hardware.prices) for line in lines)


def _fixing(device: Device) -> BoughtLine:
    """What fixes the mirrors: tape or glue."""
    holder = device.hardware.holder
    if holder.mirrors == "tape":
        squares = f"{len(device.holder.pads)} squares of {holder.tape_pad_mm:g} mm, on the pads of the seats"
        title = f"Double-sided tape, clear film with acrylic adhesive, {holder.tape_mm:g} mm thick"
        return BoughtLine(title=title, count=None, note=squares)
    amount = f"{glue_amount(device.holder.glue_mm3)}, {holder.bond_mm:g} mm behind every mirror"
    return BoughtLine(title=GLUES[device.hardware.cutting.material], count=None, note=amount)


def _priced(line: BoughtLine, prices: Prices) -> BoughtLine:
    """A line with the price of its items; a line without a count, such as glue, has the price of a pack."""
    price = None if line.title.startswith((TOOL, ALSO)) else prices.of_item(line.title)
    return line if price is None else line.replaced(price=round(price * (line.count or 1), 2))


def _joined_parts(items: Sequence[tuple[PurchasedItem, Tightening | None]], titles: Mapping[str, str]) -> str:
    """The parts that items join, and the largest tightening torques of the screws among them."""
    parts_by_torque: dict[str, set[str]] = {}
    for item, tightening in items:
        parts_by_torque.setdefault(tightening.text if tightening else "", set()).update(item.joins)
    texts = []
    for text, names in parts_by_torque.items():
        kinds = {CARRIERS if name.startswith("carrier_") else name for name in names}
        parts = ", ".join(titles.get(name, name.replace("_", " ")) for name in sorted(kinds))
        texts.append(f"{parts}: at most {text}" if text else parts)
    return "; ".join(texts)


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
    basis = (
        "as sliced" if bom.sliced else "if printed solid (install PrusaSlicer and build again for the mass as sliced)"
    )
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
        f"{markdown_text(bom.plastic)}: {bom.plastic_g:.0f} g {basis}{_total_time(bom)}.",
        "",
        "## Mirrors",
        "",
        f"| stock | mirrors | area, cm² | to buy | files | where | search words | {money} |",
        "|---|---:|---:|---|---|---|---|---:|",
        *(
            f"| {line.sheet} | {line.count} | {line.area_cm2:.1f} | {line.to_buy} "
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
        note = f"{mirror.to_buy}; {mirror.area_cm2:g} cm2; {mirror.supplier}: {mirror.search}"
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


def _total_time(bom: Bom) -> str:
    """The total time of all prints, if every part was sliced."""
    return f"; {hours_text(bom.print_minutes)} of printing in all" if bom.print_minutes is not None else ""
