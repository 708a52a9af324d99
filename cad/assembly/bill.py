"""The bill of materials of a device: what is printed, cut and bought, with prices, sources, uses and substitutes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import Field
from shapely import Polygon

from mirrorcam.cad.assembly.build_steps import also_needed, cable_ties, step_of_item, tools_of
from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import item_title
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.substitutes import substitutes
from mirrorcam.cad.holder.glue import glue_amount
from mirrorcam.cad.mirrors.stock_sheets import TEST, StockSheet
from mirrorcam.cad.plan.device_names import CARRIER, HOLDER
from mirrorcam.cad.plan.goods import CAMERA, Good, good_of, search_words
from mirrorcam.cad.plan.part_plan import BuiltPart, PurchasedItem
from mirrorcam.cad.plan.prices import BASIS, Prices
from mirrorcam.cad.plan.rectangles import coupon_mirror_mm, is_sold_in_size, size_mm
from mirrorcam.cad.plan.tightening import Tightening, tightenings
from mirrorcam.core.values import Value
from mirrorcam.optics.geometry.layout import Layout

# Common name of all mirror carriers in a note.
CARRIERS = "mirror_carriers"
# Prefixes of titles without a price.
TOOL, ALSO = "Tool: ", "Also needed: "
GLUES = {
    "acrylic": "Glue for acrylic that does not craze it (neutral silicone)",
    "glass": "Glue for mirrors that does not attack their coating (neutral silicone)",
}
SEEN_BY_LENS = (HOLDER, CARRIER)
"""Starts of the names of the parts that the lens sees, which must be matt black."""


class PrintedLine(Value):
    """A part to print."""

    number: str
    title: str
    file: str = Field(description="3MF file, relative to the folder of the bill")
    volume_cm3: float
    print_minutes: float | None = Field(
        description="by the slicer, null without one; rounded to a minute, so that the parts add up to the total"
    )
    print_g: float = Field(description="mass of plastic, infill included: by the slicer, or estimated without one")
    price: float = Field(description="price of its filament")


class Purchase(Value):
    """What is to be known to buy something: its standard, material, sources, uses and substitutes."""

    standard: str = Field(default="", description="trade designation")
    former: str = Field(default="", description="former designation, which shops still use")
    material: str = ""
    supplier: str = Field(default="", description="who sells it")
    search: str = Field(default="", description="words to search for")
    steps: tuple[str, ...] = Field(default=(), description="names of the guide's steps that use it")
    instead: tuple[str, ...] = Field(default=(), description="what may replace it, as sentences in Markdown")


class MirrorLine(Purchase):
    """The mirrors of one kind of stock: cut from sheets, or bought in their sizes with a spare one."""

    sheet: str
    names: tuple[str, ...]
    area_cm2: float
    sheets: int = Field(description="number of sheets; 0 if mirrors are bought in their sizes")
    pieces: tuple[str, ...] = Field(description="sizes to buy with their counts, such as 9 x (30 x 20 mm)")
    sheet_mm: tuple[float, float]
    files: tuple[str, ...] = Field(description="DXF files, relative to the folder of the bill")
    price: float = Field(description="price of whole sheets, or of the pieces")

    @property
    def count(self) -> int:
        return len(self.names)

    @property
    def to_buy(self) -> str:
        """The sheets or the sizes to buy."""
        width, height = self.sheet_mm
        return ", ".join(self.pieces) or f"{self.sheets} of {width:g} x {height:g} mm"


class BoughtLine(Purchase):
    """An item to buy, with its count or with the amount in its note."""

    title: str
    count: int | None
    note: str
    each: float | None = Field(
        default=None,
        description="price of one; of 1 kg of filament, whose price is that of the printed parts; null for tools, for "
        "items to be made, and if unknown",
    )
    price: float | None = Field(
        default=None, description="price of all of them, or of one pack if there is no count; null as for one"
    )

    @property
    def is_tool(self) -> bool:
        """Whether it does not become part of the device."""
        return self.title.startswith((TOOL, ALSO))


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
    sliced = all("print_g" in part.checks for part in parts)
    mirrors = _mirrors(device, sheets)
    bought = (
        *_filaments(parts, printed, sliced, device),
        *map(_priced, _bought(device, {part.name: part.title.lower() for part in parts})),
    )
    priced = [line.price for line in printed] + [line.price for line in mirrors]
    priced += [line.price for line in bought if line.price is not None]
    return Bom(
        layout_identity=device.layout.identity,
        plastic=printer.plastic,
        plastic_g=round(sum(line.print_g for line in printed), 1),
        sliced=sliced,
        printed=printed,
        mirrors=mirrors,
        bought=bought,
        currency=prices.currency,
        prices_date=prices.date,
        price=round(sum(priced), 2),
        unpriced=tuple(line.title for line in bought if line.each is None and not line.is_tool),
    )


def _filaments(
    parts: Sequence[BuiltPart], printed: Sequence[PrintedLine], sliced: bool, device: Device
) -> Iterator[BoughtLine]:
    """The filament by colour: matt black for the parts that the lens sees, any for the others."""
    prices, plastic = device.hardware.prices, device.hardware.printer.plastic
    for colour, black in (("matt black", True), ("any colour", False)):
        lines = [line for part, line in zip(parts, printed, strict=True) if part.name.startswith(SEEN_BY_LENS) == black]
        if not lines:
            continue
        grams = sum(line.print_g for line in lines)
        title = f"{plastic} filament, 1.75 mm, {colour}"
        amount = f"{grams:.0f} g {'as sliced' if sliced else 'estimated'}, priced with the printed parts"
        yield BoughtLine(
            title=title,
            count=None,
            note=f"{amount}: {', '.join(line.title.lower() for line in lines)}",
            each=prices.of_plastic(plastic, 1000.0),
            steps=("print",),
            **_source(title, good_of(title)),
        )


def _source(title: str, good: Good | None, more: Sequence[str] = ()) -> dict[str, Any]:
    """The fields of a `Purchase` from the table of goods; those that may replace it with `more` before the others."""
    if good is None:
        return {"instead": tuple(more)}
    return {
        "standard": good.standard,
        "former": good.former,
        "material": good.material,
        "supplier": good.supplier,
        "search": search_words(title, good),
        "instead": (*more, *good.instead),
    }


def _printed(part: BuiltPart, plastic: str, prices: Prices) -> PrintedLine:
    minutes, sliced_g = part.checks.get("print_minutes"), part.checks.get("print_g")
    grams = sliced_g.value if sliced_g else round(part.mass.mass_g, 1)
    return PrintedLine(
        number=part.number,
        title=part.title,
        file=f"parts/{part.name}.3mf",
        volume_cm3=round(part.mass.volume_mm3 / 1000.0, 2),
        print_minutes=float(round(minutes.value)) if minutes else None,
        print_g=grams,
        price=round(prices.of_plastic(plastic, grams), 2),
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
        bought = 0 if pieces else len(group)
        larger = "Larger pieces of the same stock, cut to these sizes."
        source = _source(kind, good_of(kind), (larger,) if pieces else ())
        if pieces:
            source["search"] += f", {', '.join(f'{size} mm' for size in pieces)}"
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
                price=round(price, 2),
                steps=("cut", "mirrors"),
                **source,
            )
        )
    return tuple(lines)


def _pieces(layout: Layout) -> Counter[str]:
    """Counts of the sizes that are bought, with a spare one of the smallest as the coupon's test mirror."""
    sizes = [*(size_mm(mirror) for mirror in layout.mirrors), coupon_mirror_mm(layout)]
    return Counter(f"{longer:g} x {shorter:g}" for longer, shorter in sorted(sizes, reverse=True))


def _bought(device: Device, titles: Mapping[str, str]) -> Iterator[BoughtLine]:
    hardware = device.hardware
    items, mount, camera, prices = purchased_items(device), hardware.mount, hardware.camera, hardware.prices
    counts = Counter((item.kind, item_title(item)) for item in items)
    torques = tightenings(items, hardware)
    order = ("screw", "washer", "spring", "insert", "nut", "pin")
    yield BoughtLine(
        title=camera.name,
        count=1,
        note="the camera",
        each=prices.of_item(camera.name),
        steps=("measure", "camera"),
        **_source(camera.name, CAMERA),
    )
    for key in sorted(counts, key=lambda key: (order.index(key[0]), key[1])):
        same_items = [pair for pair in zip(items, torques, strict=True) if (pair[0].kind, item_title(pair[0])) == key]
        note = _joined_parts(same_items, titles)
        if key[0] == "insert":
            note += f"; for a hole of {hardware.screw.insert_hole_mm:.1f} mm"
        same = [item for item, _ in same_items]
        yield BoughtLine(
            title=key[1],
            count=counts[key],
            note=note,
            each=prices.of_item(key[1]),
            steps=tuple(dict.fromkeys(step_of_item(item, hardware.screw).name for item in same)),
            **_source(key[1], good_of(key[1]), substitutes(same, device)),
        )
    tied = cable_ties(device)
    if tied:
        title, (width, height) = f"Cable tie, at most {mount.tie_mm[0]:g} mm wide", mount.tie_mm
        yield BoughtLine(
            title=title,
            count=len(tied),
            note=", ".join(what for what, _ in tied),
            each=prices.of_item(title),
            steps=tuple(dict.fromkeys(step for _, step in tied)),
            **_source(title, good_of(title), (f"Any tie whose band passes slots of {width:g} x {height:g} mm.",)),
        )
    title, note = _fixing(device)
    yield BoughtLine(
        title=title,
        count=None,
        note=note,
        each=prices.of_item(title),
        steps=("mirrors",),
        **_source(title, good_of(title)),
    )
    for kind, tools in ((TOOL, tools_of(device, items)), (ALSO, also_needed(device, items))):
        for tool in tools:
            yield BoughtLine(title=kind + tool.name, count=None, note=tool.purpose)


def _priced(line: BoughtLine) -> BoughtLine:
    return line if line.each is None else line.replaced(price=round(line.each * (line.count or 1), 2))


def _fixing(device: Device) -> tuple[str, str]:
    """What fixes the mirrors, tape or glue, and its amount."""
    holder = device.hardware.holder
    if holder.mirrors == "tape":
        squares = f"{len(device.holder.pads)} squares of {holder.tape_pad_mm:g} mm, on the pads of the seats"
        return f"Double-sided tape, clear film with acrylic adhesive, {holder.tape_mm:g} mm thick", squares
    amount = f"{glue_amount(device.holder.glue_mm3)}, {holder.bond_mm:g} mm behind every mirror"
    return GLUES[device.hardware.cutting.material], amount


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
