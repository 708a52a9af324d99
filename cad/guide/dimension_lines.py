"""Dimension lines along x and y of a view, in tiers below and left of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.guide.drawing_sheet import ARROW_MM, DrawingSheet, text_width_mm
from mirrorcam.core.values import FloatArray

LINE_MM = 0.15
TEXT_MM = 2.5
FIRST_TIER_MM, TIER_PITCH_MM, MIN_PITCH_MM = 7.5, 6.5, 5.0
GAP_MM = 1.0
# Gap between text and its dimension line, and projection of extension lines past a dimension line.
TEXT_OFFSET_MM, EXTENSION_MM = 0.9, 1.5
# Largest overlap of dimension lines that meet at an arrow head.
TOUCH_MM = 0.05
# Gap between text and an extension line, and candidate shifts of text along its line, zero first.
TEXT_GAP_MM = 0.6
SHIFTS = (0.0, *(sign * tenths / 10.0 for tenths in range(1, 5) for sign in (-1, 1)))


@dataclass(frozen=True)
class LinearDimension:
    """A dimension along x or y: its `ends` (2,) in the measured direction, its text, and `starts`.

    `starts` (2,) are the other coordinates of the ends, where extension lines start. All are in mm on paper.
    """

    ends: FloatArray
    starts: FloatArray
    text: str

    @property
    def span(self) -> float:
        return float(np.ptp(self.ends))


def number(value_mm: float) -> str:
    """A length as text: at most two decimals, no trailing zeros."""
    return f"{value_mm:.2f}".rstrip("0").rstrip(".")


def text_fits(span: float, text: str) -> bool:
    """Return whether the text of a dimension and its arrows fit between its ends."""
    return span >= text_width_mm(text, TEXT_MM) + 2.0 * ARROW_MM[0] + 1.0


@dataclass(frozen=True)
class _Tiered:
    """A dimension in a tier; its text is centred at `text_centre`, outside the arrows if it does not fit between."""

    dimension: LinearDimension
    level: int
    text_centre: float

    @property
    def text_range(self) -> tuple[float, float]:
        half = text_width_mm(self.dimension.text, TEXT_MM) / 2.0
        return self.text_centre - half, self.text_centre + half


def draw_tiers(
    sheet: DrawingSheet,
    box: FloatArray,
    dimensions: Sequence[LinearDimension],
    free_mm: float,
    *,
    vertical: bool,
    cutting_lines: Sequence[float] = (),
) -> float:
    """Draw dimensions in tiers, shorter ones closer to the part, so that extension lines cross no dimension line.

    Consecutive dimensions share a line. Where extension lines would cross a text, the order is changed; if that does
    not help, they are interrupted at the text. Text is also kept clear of `cutting_lines`, the coordinates at which
    cutting-plane lines may cross the tiers. Returns the space that the tiers need, mm, of which `free_mm` is there.
    """
    tiered = _in_tiers(
        sorted(dimensions, key=lambda each: (each.span, float(each.ends.min()), each.text)),
        np.array(cutting_lines, dtype=float),
    )
    tiers = max((each.level for each in tiered), default=0)
    # A vertical dimension has its text outside its line; outside others are only the ends of extension lines.
    outside = GAP_MM + (TEXT_MM + TEXT_OFFSET_MM if vertical else EXTENSION_MM)
    pitch = min(TIER_PITCH_MM, (free_mm - FIRST_TIER_MM - outside) / max(tiers, 1))
    # In narrow tiers, extension lines end before the text of the next tier.
    extension = max(0.0, min(EXTENSION_MM, pitch - TEXT_OFFSET_MM - TEXT_MM - TEXT_GAP_MM))
    edge = float(box[0, 0 if vertical else 1])
    for each, crossed in zip(tiered, _crossed_texts(tiered, np.array(cutting_lines, dtype=float)), strict=True):
        tier = edge - FIRST_TIER_MM - each.level * pitch
        _draw_linear(sheet, each, tier, extension, vertical=vertical, over_lines=crossed)
    return FIRST_TIER_MM + tiers * MIN_PITCH_MM + outside


def _in_tiers(dimensions: Sequence[LinearDimension], cutting_lines: FloatArray) -> list[_Tiered]:
    """Place dimensions in tiers, in an order that is improved while texts are crossed.

    Candidates move all dimensions with crossed texts outwards, any pair, or any single dimension anywhere.
    """
    best = _in_order(dimensions, cutting_lines)
    while any(crossed := _crossed_texts(best, cutting_lines)):
        order = [each.dimension for each in best]
        outwards = sorted(zip(crossed, order, strict=True), key=lambda pair: pair[0])
        candidates = [[dimension for _, dimension in outwards]]
        for index, dimension in enumerate(order):
            rest = [*order[:index], *order[index + 1 :]]
            candidates += [[*rest[:target], dimension, *rest[target:]] for target in range(len(order))]
            candidates += [[*rest[:other], *rest[other + 1 :], rest[other], dimension] for other in range(len(rest))]
        found = min(
            (_in_order(candidate, cutting_lines) for candidate in candidates),
            key=lambda tiered: _cost(tiered, cutting_lines),
        )
        if _cost(found, cutting_lines) >= _cost(best, cutting_lines):
            break
        best = found
    return best


def _in_order(dimensions: Sequence[LinearDimension], cutting_lines: FloatArray) -> list[_Tiered]:
    """Place each dimension in the first tier outside the full ones, its text clear of extension lines if possible."""
    tiers: list[list[tuple[float, float]]] = []
    tiered = []
    for index, dimension in enumerate(dimensions):
        crossing = np.concatenate([*(other.ends for other in dimensions[index + 1 :]), cutting_lines])
        centre = _text_centre(dimension, crossing)
        half = text_width_mm(dimension.text, TEXT_MM) / 2.0
        arrow = 0.0 if text_fits(dimension.span, dimension.text) else ARROW_MM[0] + 1.5
        low = min(float(dimension.ends.min()) - arrow, centre - half - 0.5)
        high = max(float(dimension.ends.max()) + arrow, centre + half + 0.5)
        full = [k for k, tier in enumerate(tiers) if any(low < b - TOUCH_MM and high > a + TOUCH_MM for a, b in tier)]
        level = max(full) + 1 if full else 0
        if level == len(tiers):
            tiers.append([])
        tiers[level].append((low, high))
        tiered.append(_Tiered(dimension, level, centre))
    return tiered


def _crossed_texts(tiered: Sequence[_Tiered], cutting_lines: FloatArray) -> list[bool]:
    """Whether each text is crossed by an extension line of an outer tier, or by a cutting-plane line."""
    return [
        _is_crossed(*each.text_range, np.concatenate([cutting_lines, *_outer_ends(each, tiered)])) for each in tiered
    ]


def _cost(tiered: Sequence[_Tiered], cutting_lines: FloatArray) -> tuple[int, int, int]:
    """Numbers of crossed texts, of dimension lines that extension lines cross, and of tiers."""
    lines = sum(
        float(each.dimension.ends.min()) + TOUCH_MM < end < float(each.dimension.ends.max()) - TOUCH_MM
        for each in tiered
        for ends in _outer_ends(each, tiered)
        for end in ends
    )
    return sum(_crossed_texts(tiered, cutting_lines)), lines, max((each.level for each in tiered), default=0)


def _outer_ends(tiered: _Tiered, others: Sequence[_Tiered]) -> list[FloatArray]:
    return [other.dimension.ends for other in others if other.level > tiered.level]


def _text_centre(dimension: LinearDimension, crossing: FloatArray) -> float:
    """The centre of a text along its dimension line, clear of crossing lines if possible.

    It is between the ends if it fits there, otherwise outside the arrows at the upper end, or else at the lower one.
    """
    width = text_width_mm(dimension.text, TEXT_MM)
    arrows = 2.0 * ARROW_MM[0] if text_fits(dimension.span, dimension.text) else 0.0
    slack = dimension.span - width - arrows - 1.0
    outside = ARROW_MM[0] + 1.5 + width / 2.0
    positions = [float(dimension.ends.mean()) + shift * slack for shift in SHIFTS] if slack >= 0.0 else []
    positions += [float(dimension.ends.max()) + outside, float(dimension.ends.min()) - outside]
    half = width / 2.0 + TEXT_GAP_MM
    return min(positions, key=lambda position: _is_crossed(position - half, position + half, crossing))


def _is_crossed(low: float, high: float, crossing: FloatArray) -> bool:
    return bool(((crossing > low) & (crossing < high)).any())


def _draw_linear(
    sheet: DrawingSheet, tiered: _Tiered, tier: float, extension_mm: float, *, vertical: bool, over_lines: bool
) -> None:
    """Draw a dimension line at `tier` with its text, which a line outside the arrows underlines."""
    dimension, centre = tiered.dimension, tiered.text_centre

    def on_sheet(points: Sequence[tuple[float, float]]) -> FloatArray:
        array = np.array(points)
        return array[:, ::-1] if vertical else array

    order = np.argsort(dimension.ends)
    (low, high), starts = dimension.ends[order], dimension.starts[order]
    lines = [
        on_sheet([(end, start - GAP_MM), (end, tier - extension_mm)])
        for end, start in zip((low, high), starts, strict=True)
    ]
    inside = text_fits(dimension.span, dimension.text)
    arrow = 0.0 if inside else ARROW_MM[0] + 1.5
    text_low, text_high = tiered.text_range
    lines.append(on_sheet([(min(low - arrow, text_low), tier), (max(high + arrow, text_high), tier)]))
    sheet.lines(lines, LINE_MM)
    sign = -1.0 if inside else 1.0
    for tip, direction in ((low, sign), (high, -sign)):
        sheet.arrow_head(on_sheet([(tip, tier)])[0], on_sheet([(direction, 0.0)])[0])
    start = (tier - TEXT_OFFSET_MM, centre) if vertical else (centre, tier + TEXT_OFFSET_MM)
    rotation_deg = 90.0 if vertical else 0.0
    sheet.text(start, dimension.text, TEXT_MM, align="center", rotation_deg=rotation_deg, over_lines=over_lines)
