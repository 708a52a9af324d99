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
    """Return whether the text of a dimension fits between its arrows."""
    return span >= text_width_mm(text, TEXT_MM) + 2.0 * ARROW_MM[0] + 1.0


def draw_tiers(
    sheet: DrawingSheet,
    box: FloatArray,
    dimensions: Sequence[LinearDimension],
    free_mm: float,
    *,
    vertical: bool,
    cutting_lines: Sequence[float] = (),
) -> None:
    """Draw dimensions in tiers, shorter ones closer to the part, so that extension lines cross no dimension line.

    Consecutive dimensions share a line. Dimensions whose text would be crossed by other extension lines are outermost.
    Text is also kept clear of `cutting_lines`, the coordinates at which cutting-plane lines may cross the tiers.
    """
    tiers: list[list[tuple[float, float]]] = []
    placed = []
    ends = np.concatenate([dimension.ends for dimension in dimensions]) if dimensions else np.zeros(0)
    widths = {id(dimension): text_width_mm(dimension.text, TEXT_MM) for dimension in dimensions}

    def order(dimension: LinearDimension) -> tuple[bool, float, float, str]:
        width = widths[id(dimension)]
        always_crossed = all(_text_is_crossed(dimension, width, ends, low_text=low_text) for low_text in (False, True))
        return (
            always_crossed and not text_fits(dimension.span, dimension.text),
            dimension.span,
            float(dimension.ends.min()),
            dimension.text,
        )

    for dimension in sorted(dimensions, key=order):
        width = widths[id(dimension)]
        low_text = _text_is_crossed(dimension, width, ends) and not _text_is_crossed(
            dimension, width, ends, low_text=True
        )
        low, high = _covered_range(dimension, width, low_text=low_text)
        full = [k for k, tier in enumerate(tiers) if any(low < b - TOUCH_MM and high > a + TOUCH_MM for a, b in tier)]
        level = max(full) + 1 if full else 0
        if level == len(tiers):
            tiers.append([])
        tiers[level].append((low, high))
        placed.append((level, dimension, width, low_text))
    # A vertical dimension has its text outside its line; outside others are only the ends of extension lines.
    outside = GAP_MM + (TEXT_MM + TEXT_OFFSET_MM if vertical else EXTENSION_MM)
    pitch = min(TIER_PITCH_MM, (free_mm - FIRST_TIER_MM - outside) / max(len(tiers) - 1, 1))
    # In narrow tiers, extension lines end before the text of the next tier.
    extension = max(0.0, min(EXTENSION_MM, pitch - TEXT_OFFSET_MM - TEXT_MM - TEXT_GAP_MM))
    edge = float(box[0, 0 if vertical else 1])
    for level, dimension, width, low_text in placed:
        crossing = [other.ends for outer, other, _, _ in placed if outer > level]
        centre = _text_centre(dimension, width, np.concatenate([*crossing, np.array(cutting_lines, dtype=float)]))
        tier = edge - FIRST_TIER_MM - level * pitch
        _draw_linear(sheet, dimension, tier, width, centre, extension, vertical=vertical, low_text=low_text)


def _text_centre(dimension: LinearDimension, width: float, crossing: FloatArray) -> float:
    """The centre of a text along its dimension line, clear of crossing extension lines if possible."""
    centre, slack = float(dimension.ends.mean()), dimension.span - width - 2.0 * ARROW_MM[0] - 1.0
    positions = [centre + shift * max(slack, 0.0) for shift in SHIFTS]
    return min(positions, key=lambda position: bool((np.abs(crossing - position) < width / 2.0 + TEXT_GAP_MM).any()))


def _covered_range(dimension: LinearDimension, width: float, *, low_text: bool = False) -> tuple[float, float]:
    """The range of a tier that a dimension line and its text cover; text that does not fit is outside the arrows.

    It is then at the upper end or, with `low_text`, at the lower end.
    """
    low, high = float(dimension.ends.min()), float(dimension.ends.max())
    if text_fits(dimension.span, dimension.text):
        return low, high
    arrow, text = ARROW_MM[0] + 1.5, ARROW_MM[0] + width + 2.0
    return (low - text, high + arrow) if low_text else (low - arrow, high + text)


def _text_is_crossed(dimension: LinearDimension, width: float, ends: FloatArray, *, low_text: bool = False) -> bool:
    """Return whether an extension line, one of `ends`, may cross the text of a dimension outside its arrows."""
    covered = _covered_range(dimension, width, low_text=low_text)
    low, high = (covered[0], float(dimension.ends.min())) if low_text else (float(dimension.ends.max()), covered[1])
    return bool(((ends > low + 1e-3) & (ends < high - 1e-3)).any())


def _draw_linear(
    sheet: DrawingSheet,
    dimension: LinearDimension,
    tier: float,
    width: float,
    text_centre: float,
    extension_mm: float,
    *,
    vertical: bool,
    low_text: bool = False,
) -> None:
    """Draw a dimension line at `tier`, with its text centred at `text_centre` if it fits between the arrows."""

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
    text = 0.0 if inside else width
    line = (low - arrow - text, high + arrow) if low_text else (low - arrow, high + arrow + text)
    lines.append(on_sheet([(line[0], tier), (line[1], tier)]))
    sheet.lines(lines, LINE_MM)
    sign = -1.0 if inside else 1.0
    for tip, direction in ((low, sign), (high, -sign)):
        sheet.arrow_head(on_sheet([(tip, tier)])[0], on_sheet([(direction, 0.0)])[0])
    outside = low - arrow - width / 2.0 if low_text else high + arrow + width / 2.0
    centre = text_centre if inside else outside
    if vertical:
        sheet.text((tier - TEXT_OFFSET_MM, centre), dimension.text, TEXT_MM, align="center", rotation_deg=90.0)
    else:
        sheet.text((centre, tier + TEXT_OFFSET_MM), dimension.text, TEXT_MM, align="center")
