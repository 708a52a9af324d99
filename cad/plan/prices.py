"""Prices of a device's plastic, mirrors and purchased items, as of a stated month.

They are estimates of typical retail prices of small quantities in Europe with tax. They serve to compare devices and to
give the order of magnitude of the cost. The table `[prices]` of a hardware file replaces any of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple, TypeVar

from pydantic import BeforeValidator, Field, PlainSerializer

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.names import Name
from mirrorcam.core.values import Metric, Value

BASIS = "typical retail prices of small quantities, estimated: check before you buy"
# EUR per kg of filament, by the start of the plastic's name; OTHER_PLASTIC for any other.
PLASTICS = {"PLA": 22.0, "PETG": 22.0, "ASA": 30.0, "ABS": 24.0, "PC": 45.0, "PA": 55.0}
OTHER_PLASTIC = 40.0


class MirrorSource(NamedTuple):
    """Price of stock in EUR per 100 cm2 and per small piece, who sells it, and words to search for."""

    per_100_cm2: float
    piece: float
    supplier: str
    search: str


# By the start of the stock's name in a parts list, without the cost of a cutting service. Suppliers are the kinds that
# public pages named in 2026-11: shops for kaleidoscopes and stained glass sell first-surface glass in sheets to score
# (clarityglass.com, theavenuestainedglass.com), its makers state 94 % of reflectance and 8 waves per inch for 1/8 in
# (firstsurfacemirrors.com); laser shops stock second-surface acrylic of 3 mm, others to order
# (lasersoverlosangeles.com); glaziers and hardware stores cut second-surface glass of 3 and 4 mm to size
# (engineerfix.com), for 8 to 15 USD per square foot installed (thisoldhouse.com), which is 0.9 to 1.6 USD per 100 cm2.
# No page offered first-surface acrylic. The other prices are estimates.
MIRRORS = {
    "first-surface acrylic mirror": MirrorSource(
        6.0, 2.0, "to order from a coating company: no shop found", "first surface acrylic mirror sheet"
    ),
    "second-surface acrylic mirror": MirrorSource(
        2.0, 0.5, "plastics shop or laser cutting service", "silver acrylic mirror sheet laser cut to size"
    ),
    "first-surface glass mirror": MirrorSource(
        8.0, 3.0, "maker of first-surface mirrors, or shop for kaleidoscopes", "front surface mirror glass sheet"
    ),
    "second-surface glass mirror": MirrorSource(
        1.5,
        0.3,
        "glazier or hardware store; craft shop for small sizes",
        "mirror cut to size; mosaic mirror tiles",
    ),
}
# EUR per item, by the start or end of its title in a parts list, without its length; for small items, the price of a
# bag divided by their number.
ITEM_PRICES = {
    "M2 screw": 0.10,
    "M2 countersunk screw": 0.10,
    "M2.5 screw": 0.10,
    "M2.5 countersunk screw": 0.10,
    "M3 screw": 0.12,
    "M3 countersunk screw": 0.12,
    "M3 thread-forming screw": 0.12,
    "M4 screw": 0.15,
    "M4 countersunk screw": 0.15,
    "M5 screw": 0.20,
    "M6 screw": 0.25,
    "M2 washer": 0.04,
    "M2.5 washer": 0.04,
    "M3 washer": 0.04,
    "M4 washer": 0.04,
    "M2 heat-set insert": 0.15,
    "M2.5 heat-set insert": 0.15,
    "M3 heat-set insert": 0.15,
    "M4 heat-set insert": 0.25,
    "M2 nut": 0.05,
    "M2.5 nut": 0.05,
    "M3 nut": 0.05,
    "M4 nut": 0.06,
    "M5 T-slot nut": 0.40,
    "1/4-20 UNC hexagon nut": 0.40,
    "3 pin": 0.30,
    "compression spring": 0.60,
    "Cable tie": 0.10,
    "Double-sided tape": 7.0,
    "Glue for acrylic": 8.0,
    "Glue for mirrors": 8.0,
    "Arducam B0196": 35.0,
    "Intel RealSense D435, colour": 330.0,
    "ELP 4K USB board, 3.6 mm": 60.0,
    "Logitech Brio": 160.0,
    "Logitech C920": 70.0,
    "Logitech C922": 90.0,
    "Luxonis OAK-D, colour": 260.0,
    "Raspberry Pi Camera Module 2": 17.0,
    "Raspberry Pi Camera Module 3": 30.0,
    "Raspberry Pi HQ, CS 6 mm": 85.0,
    "Raspberry Pi HQ, M12 8 mm": 75.0,
    "38 mm USB board, M12 lens": 45.0,
}

Entry = TypeVar("Entry")
PRICE = Bounds(0.0, 1e6)


def _pairs(prices: object) -> object:
    return tuple(sorted(prices.items())) if isinstance(prices, dict) else prices


_Price = Annotated[float, PRICE.limits]
_PriceList = Annotated[
    tuple[tuple[Name, _Price], ...],
    BeforeValidator(_pairs, json_schema_input_type=dict[Name, _Price]),
    PlainSerializer(dict),
]


def _price_list(description: str) -> Any:
    return Field(default=(), description=description)


class Prices(Value):
    """Overrides of the default prices; `currency` and `date` apply to all prices."""

    currency: Name = Field(
        default="EUR", description="currency of all prices; with another one, give every price that a device needs"
    )
    date: Name = Field(default="2026-11", description="month of the prices")
    plastic_per_kg: _PriceList = _price_list("filament by the name of its plastic")
    mirror_per_100_cm2: _PriceList = _price_list('stock by name, such as "first-surface acrylic mirror"')
    mirror_each: _PriceList = _price_list("mirrors sold in their sizes, by the name of their stock")
    each: _PriceList = _price_list('purchased items by title without their length, such as "M3 screw"; cameras by name')

    def of_plastic(self, plastic: str, grams: float) -> float:
        """Price of a mass of filament, by the longest known name with which the plastic's name starts."""
        price = _by_name(plastic, PLASTICS | dict(self.plastic_per_kg))
        return (OTHER_PLASTIC if price is None else price) * grams / 1000.0

    def of_mirrors(self, stock: str, area_cm2: float) -> float:
        """Price of an area of stock, given by its name, such as "first-surface acrylic mirror, 1 mm"."""
        price = _by_name(stock, dict(self.mirror_per_100_cm2))
        return (mirror_source(stock).per_100_cm2 if price is None else price) * area_cm2 / 100.0

    def of_mirror_pieces(self, stock: str, count: int) -> float:
        """Price of mirrors that are sold in their sizes; a pack's price divided by their number."""
        price = _by_name(stock, dict(self.mirror_each))
        return (mirror_source(stock).piece if price is None else price) * count

    def of_item(self, title: str) -> float | None:
        """Price of one purchased item by its title; None if unknown."""
        plain = re.sub(r" x [\d.]+(?= )", "", title)
        return _by_name(plain, ITEM_PRICES | dict(self.each))


def mirror_source(stock: str) -> MirrorSource:
    """Price and source of stock by its name; raises ValueError for an unknown one."""
    source = _by_name(stock, MIRRORS)
    if source is None:
        raise ValueError(f"stock {stock}: expected one of {', '.join(MIRRORS)}")
    return source


def hours_text(minutes: float | None) -> str:
    """A time in hours and minutes, rounded; a dash if unknown."""
    if minutes is None:
        return "-"
    hours, rest = divmod(round(minutes), 60)
    return f"{hours}:{rest:02d} h"


def summary_of(checks: Mapping[str, Metric]) -> str:
    """Mass, price and printing time of a device in one line, from its figures; missing figures are omitted."""
    mass, price, time = (checks.get(f"device.{name}") for name in ("mass_g", "price", "print_minutes"))
    texts = [f"{mass.value:.0f} g"] if mass else []
    texts += [f"about {price.value:.0f} {price.unit}"] if price else []
    texts += [f"{hours_text(time.value)} of printing"] if time else []
    return ", ".join(texts)


def _by_name(title: str, prices: dict[str, Entry]) -> Entry | None:
    """The entry of the longest known name with which a title starts or ends; None if there is none."""
    matches = [name for name in prices if title.startswith(name) or title.endswith(name)]
    return prices[max(matches, key=len)] if matches else None
