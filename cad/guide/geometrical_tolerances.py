"""Geometrical tolerances (ISO 1101) and datums (ISO 5459): tolerance frames, datum triangles, and the holder's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mirrorcam.cad.guide.dimension_lines import LINE_MM, TEXT_MM
from mirrorcam.cad.guide.drawing_sheet import INK, DrawingSheet, text_width_mm
from mirrorcam.cad.guide.hole_callouts import DEPTH
from mirrorcam.cad.guide.part_views import PlacedView
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.tolerances import Tolerances

Characteristic = Literal["flatness", "angularity", "profile"]
FRAME_MM, FRAME_LINE_MM, SYMBOL_MM = 5.0, 0.2, 0.25
ROW_MM = 6.5
TRIANGLE_MM = (1.6, 2.0)
"""Half of the base and height of a datum triangle."""

STEM_MM = 2.0
RESERVED_MM = 50.0
"""Height that the tolerances of a holder take up below its table."""


@dataclass(frozen=True)
class GeometricalTolerance:
    """A tolerance zone `zone_mm` wide for `of`, features in words, against datums."""

    of: str
    characteristic: Characteristic
    zone_mm: float
    datums: tuple[str, ...] = ()


def holder_tolerances(plan: HolderPlan, built: Tolerances) -> tuple[GeometricalTolerance, ...]:
    """The tolerances of a holder's seats, of which the layout's figures as built are made (`built`).

    Datum A is the flat back, B the holes of the mount's screws in it. A seat may lie anywhere within the shift of a
    mirror either way along its normal; the zone of its angularity, which contains its flatness, is the step that tilts
    the smallest mirror by as much as one is tilted as built. The back is as flat as the seats.
    """
    side = float(np.sqrt(min(_area_mm2(core.top) for core in plan.cores)))
    flat = round(side * float(np.tan(np.deg2rad(built.tilt_deg))), 2)
    seats = f"{len(plan.cores)}x seat"
    return (
        GeometricalTolerance("back (A)", "flatness", flat),
        GeometricalTolerance(seats, "angularity", flat, ("A", "B")),
        GeometricalTolerance(seats, "profile", round(2.0 * built.offset_mm, 2), ("A", "B")),
    )


def _area_mm2(loop: FloatArray) -> float:
    """Area of a flat loop (n, 3)."""
    return float(np.linalg.norm(np.cross(loop, np.roll(loop, -1, axis=0)).sum(axis=0)) / 2.0)


def tolerance_notes(built: Tolerances) -> tuple[str, ...]:
    """What the datums are, and what the zones keep."""
    return (
        "values of the table of seats are theoretically exact (ISO 1101);",
        "datum A: the flat back, B: the holes of the mount's screws in it;",
        f"the zones keep a mirror's tilt to {built.tilt_deg:g}° and its shift along",
        f"the normal to {built.offset_mm:g} mm, as its layout's figures as built take",
    )


def draw_frames(
    sheet: DrawingSheet, left: float, top: float, tolerances: Sequence[GeometricalTolerance], notes: Sequence[str]
) -> float:
    """Draw tolerance frames below each other, from a corner downwards, and notes; returns where they end."""
    sheet.text((left, top - 5.0), "Geometrical tolerances (ISO 1101)", TEXT_MM, bold=True)
    start = left + max(text_width_mm(each.of, TEXT_MM) for each in tolerances) + 3.0
    y = top - 7.0
    for each in tolerances:
        y -= ROW_MM
        sheet.text((left, y + 1.3), each.of, TEXT_MM)
        x = start
        _symbol(sheet, np.array([x + FRAME_MM / 2.0, y + FRAME_MM / 2.0]), each.characteristic)
        sheet.rectangle((x, y), (x + FRAME_MM, y + FRAME_MM), FRAME_LINE_MM)
        x += FRAME_MM
        for words in (f"{each.zone_mm:g}", *each.datums):
            width = max(FRAME_MM, text_width_mm(words, TEXT_MM) + 2.0)
            sheet.rectangle((x, y), (x + width, y + FRAME_MM), FRAME_LINE_MM)
            sheet.text((x + width / 2.0, y + 1.3), words, TEXT_MM, align="center")
            x += width
    for note in notes:
        y -= 4.0
        sheet.text((left, y), note, 2.0)
    return y - 4.0


def _symbol(sheet: DrawingSheet, middle: FloatArray, characteristic: Characteristic) -> None:
    if characteristic == "flatness":
        line = np.array([(-1.8, -0.9), (0.8, -0.9), (1.8, 0.9), (-0.8, 0.9), (-1.8, -0.9)])
    elif characteristic == "angularity":
        line = np.array([(1.7, 1.2), (-1.7, -1.0), (1.7, -1.0)])
    else:
        turn = np.linspace(0.0, np.pi, 25)
        line = np.vstack([1.7 * np.column_stack([np.cos(turn), np.sin(turn)]), [(1.7, 0.0)]]) - np.array([0.0, 0.8])
    sheet.lines([middle + line], SYMBOL_MM)


def draw_datum(sheet: DrawingSheet, at: FloatArray, way: float, letter: str) -> None:
    """A datum triangle on a horizontal line at a point (2,), and its letter in a box, up (`way` 1) or down (-1)."""
    half, high = TRIANGLE_MM
    tip = at + np.array([0.0, way * high])
    box = tip[1] + way * STEM_MM
    base = np.array([half, 0.0])
    corners = np.array([at - base, at + base, tip, at - base])
    sheet.lines([corners, np.array([tip, (tip[0], box)])], FRAME_LINE_MM, INK)
    low = box if way > 0.0 else box - FRAME_MM
    sheet.rectangle((at[0] - FRAME_MM / 2.0, low), (at[0] + FRAME_MM / 2.0, low + FRAME_MM), FRAME_LINE_MM)
    sheet.text((float(at[0]), low + 1.3), letter, TEXT_MM, align="center")


def draw_holder_datums(sheet: DrawingSheet, front: PlacedView) -> None:
    """Mark a holder's datums: A on its flat back, the lower edge of the view, and B at the callout of its holes."""
    (_, low), (right, _) = front.box
    edge = np.array([(right + 1.0, low), (right + 9.0, low)])
    sheet.lines([edge], LINE_MM)
    draw_datum(sheet, edge.mean(axis=0), -1.0, "A")
    for words in [words for words in sheet.words if DEPTH in words.text]:
        end = np.array([words.corners[:, 0].max(), words.corners[:, 1].min()])
        shelf = np.array([end, end + np.array([8.0, 0.0])])
        sheet.lines([shelf], LINE_MM)
        draw_datum(sheet, shelf[1] - np.array([3.0, 0.0]), 1.0, "B")
