"""Dimension lines along x and y of a view, in tiers below and left of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.guide.drawing_sheet import ARROW_MM, DrawingSheet, text_width_mm
from mirrorcam.core.values import FloatArray

LINE_MM = 0.15
TEXT_MM = 2.5
FIRST_TIER_MM, TIER_PITCH_MM, TIERS_MM = 7.5, 6.5, 27.0
BESIDE_MM = 1.0
# Gap between a text and its line, and extension of extension lines past a dimension line.
OVER_LINE_MM, PAST_LINE_MM = 0.9, 1.5
# Largest overlap of dimension lines that meet at an arrow head.
TOUCH_MM = 0.05
# Gap between a text and an extension line, and tried shifts of a text along its line, the middle first.
BESIDE_TEXT_MM = 0.6
SHIFTS = (0.0, *(sign * share / 10.0 for share in range(1, 5) for sign in (-1, 1)))


@dataclass(frozen=True)
class LinearDimension:
    """A dimension along x or y: coordinates (2,) of both ends along and across it, mm on paper, and its text."""

    along: FloatArray
    across: FloatArray
    text: str

    @property
    def span(self) -> float:
        return float(np.ptp(self.along))


def number(value_mm: float) -> str:
    """A length as text: at most two decimals, no trailing zeros."""
    return f"{value_mm:.2f}".rstrip("0").rstrip(".")


def text_fits(span: float, text: str) -> bool:
    """Return whether the text of a dimension fits between its arrows."""
    return span >= text_width_mm(text, TEXT_MM) + 2.0 * ARROW_MM[0] + 1.0


def draw_tiers(
    sheet: DrawingSheet,
    box: FloatArray,
    linears: Sequence[LinearDimension],
    free_mm: float,
    *,
    upright: bool,
    traces: Sequence[float] = (),
) -> None:
    """Draw dimensions in tiers, shorter ones nearer to the part, so that extension lines cross no dimension line.

    Consecutive dimensions share a line. Dimensions whose text would be crossed by other extension lines are outermost.
    Texts also keep clear of `traces`, the places where traces of sections may cross the tiers.
    """
    tiers: list[list[tuple[float, float]]] = []
    chosen = []
    ends = np.concatenate([linear.along for linear in linears]) if linears else np.zeros(0)
    widths = {id(linear): text_width_mm(linear.text, TEXT_MM) for linear in linears}

    def order(linear: LinearDimension) -> tuple[bool, float, float, str]:
        width = widths[id(linear)]
        crossed = all(_struck(linear, width, ends, before=before) for before in (False, True))
        return (
            crossed and not text_fits(linear.span, linear.text),
            linear.span,
            float(linear.along.min()),
            linear.text,
        )

    for linear in sorted(linears, key=order):
        width = widths[id(linear)]
        before = _struck(linear, width, ends) and not _struck(linear, width, ends, before=True)
        low, high = _covers(linear, width, before=before)
        busy = [k for k, tier in enumerate(tiers) if any(low < b - TOUCH_MM and high > a + TOUCH_MM for a, b in tier)]
        level = max(busy) + 1 if busy else 0
        if level == len(tiers):
            tiers.append([])
        tiers[level].append((low, high))
        chosen.append((level, linear, width, before))
    # An upright outermost line has its text beyond it, a level one only the ends of extension lines.
    beyond = BESIDE_MM + (TEXT_MM + OVER_LINE_MM if upright else PAST_LINE_MM)
    pitch = min(TIER_PITCH_MM, (free_mm - FIRST_TIER_MM - beyond) / max(len(tiers) - 1, 1))
    edge = float(box[0, 0 if upright else 1])
    for level, linear, width, before in chosen:
        crossing = [other.along for outer, other, _, _ in chosen if outer > level]
        middle = _text_middle(linear, width, np.concatenate([*crossing, np.array(traces, dtype=float)]))
        tier = edge - FIRST_TIER_MM - level * pitch
        _draw_linear(sheet, linear, tier, width, middle, upright=upright, before=before)


def _text_middle(linear: LinearDimension, width: float, crossing: FloatArray) -> float:
    """The place of a text along its dimension line, clear of crossing extension lines if possible."""
    middle, room = float(linear.along.mean()), linear.span - width - 2.0 * ARROW_MM[0] - 1.0
    places = [middle + share * max(room, 0.0) for share in SHIFTS]
    return min(places, key=lambda place: bool((np.abs(crossing - place) < width / 2.0 + BESIDE_TEXT_MM).any()))


def _covers(linear: LinearDimension, width: float, *, before: bool = False) -> tuple[float, float]:
    """The range of a tier that a dimension line and its text cover; text that does not fit is outside the arrows."""
    low, high = float(linear.along.min()), float(linear.along.max())
    if text_fits(linear.span, linear.text):
        return low, high
    short, long = ARROW_MM[0] + 1.5, ARROW_MM[0] + width + 2.0
    return (low - long, high + short) if before else (low - short, high + long)


def _struck(linear: LinearDimension, width: float, ends: FloatArray, *, before: bool = False) -> bool:
    """Return whether an extension line, one of `ends`, may cross the text that a dimension has outside its arrows."""
    covers = _covers(linear, width, before=before)
    low, high = (covers[0], float(linear.along.min())) if before else (float(linear.along.max()), covers[1])
    return bool(((ends > low + 1e-3) & (ends < high - 1e-3)).any())


def _draw_linear(
    sheet: DrawingSheet,
    linear: LinearDimension,
    tier: float,
    width: float,
    within: float,
    *,
    upright: bool,
    before: bool = False,
) -> None:
    """Draw a dimension line at `tier`, with its text about `within` if it fits between the arrows."""

    def on_sheet(points: Sequence[tuple[float, float]]) -> FloatArray:
        array = np.array(points)
        return array[:, ::-1] if upright else array

    order = np.argsort(linear.along)
    (low, high), starts = linear.along[order], linear.across[order]
    lines = [
        on_sheet([(at, start - BESIDE_MM), (at, tier - PAST_LINE_MM)])
        for at, start in zip((low, high), starts, strict=True)
    ]
    inside = text_fits(linear.span, linear.text)
    reach = 0.0 if inside else ARROW_MM[0] + 1.5
    beyond = 0.0 if inside else width
    line = (low - reach - beyond, high + reach) if before else (low - reach, high + reach + beyond)
    lines.append(on_sheet([(line[0], tier), (line[1], tier)]))
    sheet.lines(lines, LINE_MM)
    sign = -1.0 if inside else 1.0
    for tip, direction in ((low, sign), (high, -sign)):
        sheet.arrow_head(on_sheet([(tip, tier)])[0], on_sheet([(direction, 0.0)])[0])
    outside = low - reach - width / 2.0 if before else high + reach + width / 2.0
    middle = within if inside else outside
    if upright:
        sheet.text((tier - OVER_LINE_MM, middle), linear.text, TEXT_MM, align="center", turn_deg=90.0)
    else:
        sheet.text((middle, tier + OVER_LINE_MM), linear.text, TEXT_MM, align="center")
