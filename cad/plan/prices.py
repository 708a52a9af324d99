"""Prices of a device's plastic, mirrors and purchased items, as of a stated month.

They are estimates of typical retail prices of small quantities in Europe with tax. They serve to compare devices and to
give the order of magnitude of the cost. The table `[prices]` of a hardware file replaces any of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer

from mirrorcam.cad.plan.goods import AREA, PIECE, by_name, good_of, plain_title, price_eur
from mirrorcam.core.bounds import Bounds
from mirrorcam.core.names import Name
from mirrorcam.core.values import Metric, Value

BASIS = "typical retail prices of small quantities, estimated: check before you buy"
# EUR per kg of filament, by the start of the plastic's name; OTHER_PLASTIC for any other.
PLASTICS = {"PLA": 22.0, "PETG": 22.0, "ASA": 30.0, "ABS": 24.0, "PC": 45.0, "PA": 55.0}
OTHER_PLASTIC = 40.0


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
        price = by_name(plastic, PLASTICS | dict(self.plastic_per_kg))
        return (OTHER_PLASTIC if price is None else price) * grams / 1000.0

    def of_mirrors(self, stock: str, area_cm2: float) -> float:
        """Price of an area of stock, given by its name, such as "first-surface acrylic mirror, 1 mm"."""
        return _price_of(stock, AREA, self.mirror_per_100_cm2) * area_cm2 / 100.0

    def of_mirror_pieces(self, stock: str, count: int) -> float:
        """Price of mirrors that are sold in their sizes; a pack's price divided by their number."""
        return _price_of(stock, PIECE, self.mirror_each) * count

    def of_item(self, title: str) -> float | None:
        """Price of one purchased item by its title; None if unknown."""
        price = by_name(plain_title(title), dict(self.each))
        return price_eur(title) if price is None else price


def _price_of(stock: str, unit: str, overrides: tuple[tuple[str, float], ...]) -> float:
    """Price of stock in its unit; raises ValueError for unknown stock."""
    price, good = by_name(stock, dict(overrides)), good_of(stock)
    if good is None or unit not in good.eur:
        raise ValueError(f"stock {stock}: expected a mirror, such as first-surface glass mirror")
    return good.eur[unit] if price is None else price


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
