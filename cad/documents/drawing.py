"""The drawing of a part: three views and an isometric on an A3 sheet, dimensions, tables and title block."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from build123d import Part

from mirrorcam.cad.documents.annotation import TIERS_MM, WORDS_MM, annotate
from mirrorcam.cad.documents.drawing_sheet import SOFT, DrawingSheet, fitted_text, text_width_mm
from mirrorcam.cad.documents.holder_drawing import seat_names, seat_table
from mirrorcam.cad.documents.part_views import FRONT, ISOMETRIC, RIGHT, TOP, PartView, PlacedView, on_paper, project
from mirrorcam.cad.documents.plan_dimensions import offered
from mirrorcam.cad.holder.holder_plan import HolderPlan
from mirrorcam.cad.plan.cuts import PiecePlan
from mirrorcam.cad.plan.dimension import DrawingTable, Hole, Length
from mirrorcam.cad.plan.hardware import Printer
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.optics.base.values import FloatArray

A3_MM = (420.0, 297.0)
BORDER_MM = 10.0
BLOCK_MM = 26.0
SCALES = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
VISIBLE_MM, SMALL_MM, HIDDEN_MM, FRAME_MM = 0.35, 0.25, 0.18, 0.5
HIDDEN_DASHES_MM = (1.6, 0.8)
HIDDEN_COLOUR = "#5d6778"
TEXT_MM, NOTE_MM, VALUE_MM = 2.5, 2.0, 2.8
MATERIAL_MM = 56.0
"""Width of the field of the material."""
ROW_MM = 4.4


def write_drawing(folder: Path, solid: Part, part: PartPlan, printer: Printer) -> tuple[Path, Path]:
    """Write NAME.svg and NAME.pdf into `folder`: the part as it lies on the printer's bed, third-angle projection."""
    return draw(solid, part, printer).write(folder / part.name, f"{part.number} {part.title}")


def draw(solid: Part, part: PartPlan, printer: Printer) -> DrawingSheet:
    """Draw a part on a drawing sheet."""
    bed_from_rig = part.print_from_rig[:3, :3]
    top, front, right = (project(solid, axes @ bed_from_rig) for axes in (TOP, FRONT, RIGHT))
    isometric = project(solid, ISOMETRIC @ bed_from_rig, hidden_too=False)
    whole = part.plan.whole if isinstance(part.plan, PiecePlan) else part.plan
    tables = (seat_table(whole),) if isinstance(whole, HolderPlan) else ()
    sheet = DrawingSheet(*A3_MM)
    table_left = _draw_tables(sheet, tables)
    placed, scale = _arrange(top, front, right, table_left)
    corner = _isometric(isometric, placed, table_left)
    for view in (*placed, corner):
        visible, hidden = on_paper(view.view, view.scale)
        if hidden:
            sheet.lines([line + view.shift for line in hidden], HIDDEN_MM, HIDDEN_COLOUR, HIDDEN_DASHES_MM)
        # Small views have their edges close together.
        width = VISIBLE_MM if view is not corner and view.scale >= 1.0 else SMALL_MM
        sheet.lines([line + view.shift for line in visible], width)
    annotate(sheet, placed, dimensions_of(part, solid))
    if isinstance(whole, HolderPlan):
        low, high = placed[0].box
        for name, middle in seat_names(whole):
            at = placed[0].paper(middle)
            # Not those on another piece of a holder that is split.
            if (at > low).all() and (at < high).all():
                base = at - (0.0, TEXT_MM / 2.0)
                sheet.text(base, name, TEXT_MM, align="center", colour=SOFT, over_lines=True)
    _title_block(sheet, part, printer, scale)
    return sheet


def dimensions_of(part: PartPlan, solid: Part) -> tuple[Length | Hole, ...]:
    """The dimensions of a part's plan, without those on other pieces of a part that is split."""
    dimensions = offered(part.plan)
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
) -> tuple[tuple[PlacedView, PlacedView, PlacedView], float]:
    """Place the views at the largest scale of the standard that leaves space for their dimensions."""
    bottom = BORDER_MM + BLOCK_MM
    free = np.array([right_end - BORDER_MM, A3_MM[1] - BORDER_MM - bottom])
    wide, deep = np.ptp(top.box, axis=0)
    high = float(np.ptp(front.box, axis=0)[1])
    spare = free - (2 * TIERS_MM + 12.0, 2 * TIERS_MM + 2 * WORDS_MM)
    scale = next((s for s in SCALES if s * (wide + deep) <= spare[0] and s * (deep + high) <= spare[1]), SCALES[-1])
    # What is left over goes around the views in equal shares.
    loose = np.maximum(spare - scale * np.array([wide + deep, deep + high]), 0.0) / 3.0
    left = BORDER_MM + TIERS_MM + min(loose[0], 30.0)
    low = bottom + TIERS_MM + min(loose[1], 20.0)
    upper = low + scale * high + WORDS_MM + TIERS_MM + min(loose[1], 20.0)
    beside = left + scale * wide + TIERS_MM + 4.0 + min(loose[0], 30.0)

    def at(view: PartView, x: float, y: float) -> PlacedView:
        return PlacedView(view, scale, np.array([x, y]) - view.box[0] * scale)

    return (at(top, left, upper), at(front, left, low), at(right, beside, low)), scale


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


def _title_block(sheet: DrawingSheet, part: PartPlan, printer: Printer, scale: float) -> None:
    """Draw the border and the title block."""
    right, top = A3_MM[0] - BORDER_MM, A3_MM[1] - BORDER_MM
    sheet.rectangle((BORDER_MM, BORDER_MM), (right, top), FRAME_MM)
    head = BORDER_MM + BLOCK_MM
    sheet.lines([np.array([(BORDER_MM, head), (right, head)])], FRAME_MM)
    ratio = f"{scale:g} : 1" if scale >= 1.0 else f"1 : {1.0 / scale:g}"
    printed = ", printed"
    free = MATERIAL_MM - 4.0 - text_width_mm(printed, VALUE_MM)
    material = fitted_text(printer.plastic, free, VALUE_MM) + printed
    columns: tuple[tuple[float, tuple[tuple[str, str, bool], ...]], ...] = (
        (96.0, (("Title", part.title, True), ("Project", "MirrorCam", False))),
        (46.0, (("Drawing number", part.number, True), ("Sheet", "1 / 1, A3", False))),
        (MATERIAL_MM, (("Material", material, False), ("Licence", "Apache-2.0", False))),
        (52.0, (("Scale (views)", ratio, True), ("Units", "mm", False))),
        (92.0, (("Tolerances", "ISO 2768-m; printed ± 0.2", False), ("Numbers of the plan", part.identity, False))),
    )
    x = BORDER_MM
    for width, fields in columns:
        for row, (label, value, bold) in enumerate(fields):
            y = head - 13.0 * row
            sheet.text((x + 2.0, y - 4.0), label, 1.8, colour=SOFT)
            sheet.text((x + 2.0, y - 10.0), value, 3.5 if bold else VALUE_MM, bold=bold)
        x += width
        sheet.lines([np.array([(x, BORDER_MM), (x, head)])], 0.25)
    sheet.lines([np.array([(BORDER_MM, head - 13.0), (x, head - 13.0)])], 0.25)
    sheet.text((x + 2.0, head - 4.0), "Projection: third angle", 1.8, colour=SOFT)
    _third_angle(sheet, np.array([(x + right) / 2.0, BORDER_MM + 10.0]))


def _third_angle(sheet: DrawingSheet, middle: FloatArray) -> None:
    """The symbol of third-angle projection: the circles of a cone on the left, its side on the right."""
    turn = np.linspace(0.0, 2.0 * np.pi, 65)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    left, side = middle + np.array([[-11.0, 0.0], [9.0, 0.0]])
    cone = np.array([(-6.0, 2.2), (6.0, 4.4), (6.0, -4.4), (-6.0, -2.2), (-6.0, 2.2)])
    sheet.lines([left + 4.4 * circle, left + 2.2 * circle, side + cone], VISIBLE_MM)
    axis = np.array([(-18.0, 0.0), (18.0, 0.0)])
    sheet.lines([middle + axis, left + np.array([(0.0, -5.8), (0.0, 5.8)])], 0.13, HIDDEN_COLOUR, (2.4, 0.5, 0.5, 0.5))
