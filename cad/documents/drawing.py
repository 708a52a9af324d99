"""The drawing of a part: three views and an isometric on an A3 sheet, dimensions, tables and title block."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from build123d import Part

from mirrorcam.cad.documents.annotation import TIERS_MM, WORDS_MM, annotate
from mirrorcam.cad.documents.drawing_sheet import SOFT, DrawingSheet, text_width_mm
from mirrorcam.cad.documents.holder_drawing import seat_names, seat_table
from mirrorcam.cad.documents.hole_callouts import called_out
from mirrorcam.cad.documents.part_views import FRONT, ISOMETRIC, RIGHT, TOP, PartView, PlacedView, on_paper, project
from mirrorcam.cad.documents.plan_dimensions import offered
from mirrorcam.cad.documents.title_block import A3_MM, BLOCK_MM, BORDER_MM, Title, draw_title_block, printed_of
from mirrorcam.cad.holder.holder_plan import HolderPlan
from mirrorcam.cad.plan.cuts import PiecePlan
from mirrorcam.cad.plan.dimension import DrawingTable, Hole, Length
from mirrorcam.cad.plan.hardware import HARDWARE, Fastening, Printer
from mirrorcam.cad.plan.part_plan import PartPlan

SCALES = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
VISIBLE_MM, SMALL_MM, HIDDEN_MM = 0.35, 0.25, 0.18
HIDDEN_DASHES_MM = (1.6, 0.8)
HIDDEN_COLOUR = "#5d6778"
TEXT_MM, NOTE_MM = 2.5, 2.0
ROW_MM = 4.4


def write_drawing(
    folder: Path, solid: Part, part: PartPlan, printer: Printer, screw: Fastening = HARDWARE.screw
) -> tuple[Path, Path]:
    """Write NAME.svg and NAME.pdf into `folder`: the part as it lies on the printer's bed, third-angle projection."""
    return draw(solid, part, printer, screw).write(folder / part.name, f"{part.number} {part.title}")


def draw(solid: Part, part: PartPlan, printer: Printer, screw: Fastening = HARDWARE.screw) -> DrawingSheet:
    """Draw a part on a drawing sheet; `screw` says which of its holes are for inserts and nuts."""
    bed_from_rig = part.print_from_rig[:3, :3]
    top, front, right = (project(solid, axes @ bed_from_rig) for axes in (TOP, FRONT, RIGHT))
    isometric = project(solid, ISOMETRIC @ bed_from_rig, hidden_too=False)
    whole = part.plan.whole if isinstance(part.plan, PiecePlan) else part.plan
    tables = (seat_table(whole),) if isinstance(whole, HolderPlan) else ()
    sheet = DrawingSheet(*A3_MM)
    table_left = _draw_tables(sheet, tables)
    placed, scale, room_mm = _arrange(top, front, right, table_left)
    corner = _isometric(isometric, placed, table_left)
    for view in (*placed, corner):
        visible, hidden = on_paper(view.view, view.scale)
        if hidden:
            sheet.lines([line + view.shift for line in hidden], HIDDEN_MM, HIDDEN_COLOUR, HIDDEN_DASHES_MM)
        # Small views have their edges close together.
        width = VISIBLE_MM if view is not corner and view.scale >= 1.0 else SMALL_MM
        sheet.lines([line + view.shift for line in visible], width)
    annotate(sheet, placed, dimensions_of(part, solid, screw), room_mm)
    if isinstance(whole, HolderPlan):
        low, high = placed[0].box
        for name, middle in seat_names(whole):
            at = placed[0].paper(middle)
            # Not those on another piece of a holder that is split.
            if (at > low).all() and (at < high).all():
                base = at - (0.0, TEXT_MM / 2.0)
                sheet.text(base, name, TEXT_MM, align="center", colour=SOFT, over_lines=True)
    draw_title_block(sheet, Title(part.title, part.number, printed_of(printer.plastic), scale, part.identity))
    return sheet


def dimensions_of(part: PartPlan, solid: Part, screw: Fastening) -> tuple[Length | Hole, ...]:
    """The dimensions of a part's plan, without those on other pieces of a part that is split."""
    lengths = [each for each in offered(part.plan) if isinstance(each, Length)]
    holes = (each for each in offered(part.plan) if isinstance(each, Hole))
    dimensions = (*called_out(holes, solid, screw), *lengths)
    if not isinstance(part.plan, PiecePlan):
        return dimensions
    box = solid.bounding_box()
    low, high = np.array(tuple(box.min)) - 0.1, np.array(tuple(box.max)) + 0.1

    def inside(dimension: Length | Hole) -> bool:
        points = dimension.points_in_rig if isinstance(dimension, Length) else dimension.centre_in_rig[None]
        return bool(((points >= low) & (points <= high)).all())

    return tuple(dimension for dimension in dimensions if inside(dimension))


def _arrange(
    top: PartView, front: PartView, right: PartView, right_end: float
) -> tuple[tuple[PlacedView, PlacedView, PlacedView], float, tuple[float, float]]:
    """Place the views at the largest scale of the standard that leaves space for their dimensions.

    Returns them, the scale, and what is free left of and below each, mm.
    """
    bottom = BORDER_MM + BLOCK_MM
    free = np.array([right_end - BORDER_MM, A3_MM[1] - BORDER_MM - bottom])
    wide, deep = np.ptp(top.box, axis=0)
    high = float(np.ptp(front.box, axis=0)[1])
    spare = free - (2 * TIERS_MM + 12.0, 2 * TIERS_MM + 2 * WORDS_MM)
    scale = next((s for s in SCALES if s * (wide + deep) <= spare[0] and s * (deep + high) <= spare[1]), SCALES[-1])
    # What is left over goes around the views in equal shares.
    loose = np.maximum(spare - scale * np.array([wide + deep, deep + high]), 0.0) / 3.0
    room_mm = (TIERS_MM + min(float(loose[0]), 30.0), TIERS_MM + min(float(loose[1]), 20.0))
    left = BORDER_MM + room_mm[0]
    low = bottom + room_mm[1]
    upper = low + scale * high + WORDS_MM + room_mm[1]
    beside = left + scale * wide + room_mm[0] + 4.0

    def at(view: PartView, x: float, y: float) -> PlacedView:
        return PlacedView(view, scale, np.array([x, y]) - view.box[0] * scale)

    return (at(top, left, upper), at(front, left, low), at(right, beside, low)), scale, room_mm


def _isometric(view: PartView, placed: Sequence[PlacedView], right_end: float) -> PlacedView:
    """The isometric fills what is free above the view from the right."""
    top, _, right = placed
    low = np.array([top.box[1, 0] + 12.0, right.box[1, 1] + WORDS_MM + 4.0])
    high = np.array([right_end - 6.0, A3_MM[1] - BORDER_MM - 8.0])
    scale = min(float(((high - low) / np.ptp(view.box, axis=0)).min()), 1.3 * top.scale)
    return PlacedView(view, scale, (low + high) / 2.0 - view.box.mean(axis=0) * scale)


def _draw_tables(sheet: DrawingSheet, tables: Sequence[DrawingTable]) -> float:
    """Draw tables in the upper right corner, below each other; returns where the free area left of them ends."""
    right, top = A3_MM[0] - BORDER_MM, A3_MM[1] - BORDER_MM
    left = right
    for table in tables:
        cells = [table.head, *table.rows]
        pitch = min(ROW_MM, (top - BORDER_MM - BLOCK_MM - 16.0) / (len(cells) + 1))
        height = min(TEXT_MM, 0.6 * pitch)
        widths = [max(text_width_mm(row[i], height) for row in cells) + 4.0 for i in range(len(table.head))]
        lines = [
            text_width_mm(table.title, TEXT_MM, bold=True),
            *(text_width_mm(line, NOTE_MM) for line in table.notes),
        ]
        start = right - max(sum(widths), max(lines) + 4.0)
        sheet.text((start + 1.5, top - 5.0), table.title, TEXT_MM, bold=True)
        y = top - 7.0
        ends = right - sum(widths) + np.cumsum(widths)
        for number, row in enumerate(cells):
            for end, cell in zip(ends, row, strict=True):
                sheet.text((end - 1.5, y - 0.72 * pitch), cell, height, align="right", bold=number == 0)
            y -= pitch
            sheet.lines([np.array([(start, y), (right, y)])], 0.35 if number == 0 else 0.1)
        for line in table.notes:
            sheet.text((start + 1.5, y - 4.0), line, NOTE_MM)
            y -= 3.6
        left, top = min(left, start), y - 6.0
    if tables:
        left -= 6.0
        sheet.lines([np.array([(left, BORDER_MM + BLOCK_MM), (left, A3_MM[1] - BORDER_MM)])], 0.1, SOFT)
    return left
