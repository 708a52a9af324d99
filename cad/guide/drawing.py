"""The drawing of a part: three views and an isometric on an A3 sheet, dimensions, tables and title block.

The functional dimensions come from the part's plan; the mirror holder and carriers have a table of their seats.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from build123d import Part

from mirrorcam.cad.guide.annotation import (
    RESERVED_MM,
    annotate,
    draw_frames,
    draw_holder_datums,
    holder_tolerances,
    pad_zone_mm,
    tolerance_notes,
)
from mirrorcam.cad.guide.drawing_sheet import (
    A3_MM,
    FIELD_MM,
    GAUGE_TOLERANCE,
    GENERAL_TOLERANCE,
    SOFT,
    DrawingSheet,
    Title,
    draw_title_block,
    printed_material,
    ratio,
    text_width_mm,
)
from mirrorcam.cad.guide.hole_callouts import (
    DEPTH,
    PRESS_TOLERANCE,
    hole_groups,
    hole_tables,
    insert_text,
    nut_text,
    with_callouts,
)
from mirrorcam.cad.guide.part_views import FRONT, ISOMETRIC, RIGHT, TOP, PartView, PlacedView, on_paper, project
from mirrorcam.cad.guide.seat_detail import draw_detail, place_detail, seat_detail
from mirrorcam.cad.guide.sections import (
    LETTER_MM,
    CuttingPlaneLine,
    Section,
    cut,
    cutting_plane_line,
    draw_cutting_plane_line,
    hatch,
    section_plane,
)
from mirrorcam.cad.holder.carriers import CarrierPlan
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.parts.coupon import CouponPlan
from mirrorcam.cad.plan.cuts import PiecePlan
from mirrorcam.cad.plan.dimension import Dimensioned, DrawingTable, Hole, Length, length
from mirrorcam.cad.plan.hardware import HARDWARE, Fastening, Printer
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.plan.seats import newell_normal
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.tolerances import Tolerances


def holder_holes(plan: HolderPlan) -> tuple[Hole, ...]:
    """The holes for the mount's screws in the flat back."""
    rotation, origin = plan.rig_from_mount[:3, :3], plan.rig_from_mount[:3, 3]
    screw, depth = plan.screw, f"{DEPTH}{plan.hole_depth_mm:.4g}"
    if screw.kind == "insert":
        diameter, text = screw.insert_hole_mm, f"{PRESS_TOLERANCE} {depth} {insert_text(screw)} (far side)"
    else:
        diameter, text = screw.clearance_hole_mm, f"{depth} for {screw.thread}, slot {nut_text(screw)} (far side)"
    return tuple(
        Hole(origin + rotation[:, :2] @ hole, rotation[:, 2], diameter, text) for hole in plan.holes_in_mount_mm
    )


def baffle_lengths(plan: HolderPlan) -> tuple[Length, ...]:
    """The thickness of the baffle, if any, at its highest piece on the right, where no tiers are, that is oblique."""
    foot, inner, crest = plan.walls.outer_foot, plan.walls.inner_foot, plan.walls.outer_crest
    x_axis, _, back = plan.rig_from_mount[:3, :3].T
    along = np.roll(foot, -1, axis=0) - foot
    along /= np.linalg.norm(along, axis=1)[:, None]
    inward = np.cross(back, along)
    inward *= np.sign(((inner - foot) * inward).sum(axis=1))[:, None]
    is_preferred = (np.abs(along @ x_axis) > MIN_OBLIQUE) & (inward @ x_axis < -MIN_OBLIQUE)
    heights = (foot - crest) @ back
    heights = np.minimum(heights, np.roll(heights, -1))
    piece = int(np.argmax(np.where(is_preferred, heights, heights - np.ptp(heights) - 1.0)))
    if (plan.flange.top[0] - crest[piece]) @ back <= 0.0:
        return ()
    start = (foot[piece] + foot[(piece + 1) % len(foot)]) / 2.0
    return (length(start, start + inward[piece] * ((inner[piece] - foot[piece]) @ inward[piece]), "wall"),)


def seat_names(plan: HolderPlan) -> list[tuple[str, FloatArray]]:
    """The mirror's name, and the mean (3,) of the corners in the rig frame, for every seat."""
    return [(name, core.top.mean(axis=0)) for name, core in zip(plan.mirror_names, plan.cores, strict=True)]


def seat_table(plan: HolderPlan | CarrierPlan, bed_from_rig: FloatArray) -> DrawingTable:
    """Table of seat planes relative to the flat back: the seat's centre, and the tilt and azimuth of its normal.

    `bed_from_rig` is a rotation (3, 3).
    """
    if isinstance(plan, CarrierPlan):
        seats = [(plan.name.rpartition("_")[2], plan.body.top, plan.pads[0].top)]
        back, origin = plan.rig_from_back, "its screws"
    else:
        names = (name for name, _ in seat_names(plan))
        seats = [
            (name, core.top, pads[0].top)
            for name, core, pads in zip(names, plan.cores, plan.pads_of_mirrors, strict=True)
        ]
        back, origin = plan.rig_from_mount, "the mount holes"
    rows = []
    for name, top, pad in seats:
        normal = newell_normal(top)
        on_pads = top + ((pad[0] - top[0]) @ normal) * normal
        corners = (on_pads - back[:3, 3]) @ bed_from_rig.T
        x, y, z = corners.mean(axis=0)
        normal = newell_normal(corners)
        normal = normal * np.sign(normal[2])
        tilt = np.degrees(np.arccos(min(float(normal[2]), 1.0)))
        azimuth = np.degrees(np.arctan2(normal[1], normal[0])) % 360.0
        rows.append((name, f"{x:.2f}", f"{y:.2f}", f"{z:.2f}", f"{tilt:.3f}", f"{azimuth:.2f}"))
    return DrawingTable(
        title="Seats (the planes of the pads that carry the mirrors)" if len(rows) > 1 else "Seat (plane of the pads)",
        header=("id", "x", "y", "z", "tilt °", "azimuth °"),
        rows=tuple(rows),
        notes=(
            f"x, y from the centre of {origin}, z from the flat back, mm,",
            "as in the view from above; tilt of the seat's normal from vertical,",
            "azimuth of the normal counter-clockwise from x",
        ),
    )


def dimensions_in_plan(plan: Any) -> tuple[Length | Hole, ...]:
    """The dimensions of a part's plan in the rig frame; a piece of a split part has those of the complete part."""
    if isinstance(plan, PiecePlan):
        return dimensions_in_plan(plan.whole)
    if isinstance(plan, HolderPlan):
        screw_holes = plan.screw_holes if isinstance(plan, ScrewedHolderPlan) else ()
        return (*holder_holes(plan), *screw_holes, *baffle_lengths(plan))
    return plan.dimensions if isinstance(plan, Dimensioned) else ()


SCALES = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
VISIBLE_MM, SMALL_MM, HIDDEN_MM = 0.35, 0.25, 0.18
HIDDEN_DASHES_MM = (1.6, 0.8)
HIDDEN_COLOUR = "#5d6778"
TEXT_MM, NOTE_MM = 2.5, 2.0
ROW_MM = 4.4
CLEAR_MM = 4.0
LABEL_MM = 8.0
"""Space for a section's label above it."""

MIN_OBLIQUE = 0.1
"""Sine of the angle from which a wall is oblique to the sheet, so that its thickness is dimensioned where it is."""

MARK_MM = 16.0
"""Space for the end of a cutting-plane line beside a view."""


def write_drawing(
    folder: Path, solid: Part, part: PartPlan, printer: Printer, screw: Fastening = HARDWARE.screw
) -> tuple[Path, Path]:
    """Write NAME.svg and NAME.pdf into `folder`: the part in print orientation, in third-angle projection."""
    return draw(solid, part, printer, screw).write(folder / part.name, f"{part.number} {part.title}")


def draw(solid: Part, part: PartPlan, printer: Printer, screw: Fastening = HARDWARE.screw) -> DrawingSheet:
    """Draw a part on a drawing sheet; `screw` identifies the holes for inserts and nuts."""
    bed_from_rig = part.print_from_rig[:3, :3]
    top, front, right = (project(solid, axes @ bed_from_rig) for axes in (TOP, FRONT, RIGHT))
    isometric = project(solid, ISOMETRIC @ bed_from_rig, with_hidden=False)
    plan = part.plan.whole if isinstance(part.plan, PiecePlan) else part.plan
    # A holder for carriers has no seats.
    seats = isinstance(plan, HolderPlan) and bool(plan.cores)
    dimensions = dimensions_of(part, solid, screw)
    views = (top, front, right)
    seat_tables = (seat_table(plan, bed_from_rig),) if seats or isinstance(plan, CarrierPlan) else ()
    tables = (*seat_tables, *hole_tables(hole_groups(views, dimensions), views))
    sheet = DrawingSheet(*A3_MM)
    table_left, table_low = draw_tables(sheet, tables, RESERVED_MM if seats else 0.0)
    if seats:
        as_built = Tolerances()
        table_low = draw_frames(
            sheet, table_left + 7.5, table_low, holder_tolerances(plan, as_built), tolerance_notes(as_built)
        )
    placed, scale, free_mm = _arrange(views, dimensions, table_left)
    section = _section_of(part, solid, dimensions)
    for view in placed:
        _draw_view(sheet, view, VISIBLE_MM if view.scale >= 1.0 else SMALL_MM)
    cutting_lines = {
        index: line
        for index, view in enumerate(placed)
        if section and (line := cutting_plane_line(view, section, bed_from_rig))
    }
    line_positions = [
        (index, line.constant_axis, float(line.ends[0, line.constant_axis])) for index, line in cutting_lines.items()
    ]
    field_edges = [
        (index, axis, float(edge)) for index in range(len(placed)) for axis in (0, 1) for edge in FIELD_MM[:, axis]
    ]
    annotate(sheet, placed, dimensions, free_mm, [*line_positions, *field_edges])
    free = _free_rectangles(sheet, placed, free_mm[2], table_left, table_low)
    section_view, corner_low, corner_high = _place_section(section, free, scale)
    if seats:
        draw_holder_datums(sheet, placed[1])
        low, high = placed[0].box
        for name, centre in seat_names(plan):
            position = placed[0].paper(centre)
            # Skip seats on other pieces of a split holder.
            if (position > low).all() and (position < high).all():
                base = position - (0.0, TEXT_MM / 2.0)
                sheet.text(base, name, TEXT_MM, align="center", colour=SOFT, over_lines=True)
    detail = seat_detail(plan, solid, pad_zone_mm(plan, Tolerances()) / 2.0) if seat_tables else None
    if detail:
        detail_scale, detail_centre, corner_low, corner_high = place_detail(detail, corner_low, corner_high)
        draw_detail(sheet, detail, detail_scale, detail_centre, placed[0])
    _draw_view(sheet, _isometric(isometric, placed, corner_low, corner_high), SMALL_MM)
    if section and section_view:
        hatch(sheet, section.faces, section_view.scale, section_view.shift)
        _draw_view(sheet, section_view, VISIBLE_MM if section_view.scale >= 1.0 else SMALL_MM)
        _draw_section_marks(sheet, tuple(cutting_lines.values()), section_view, scale)
    material, model = printed_material(printer.plastic), f"parts/{part.name}.step"
    tolerance = GAUGE_TOLERANCE if isinstance(plan, CouponPlan) else GENERAL_TOLERANCE
    draw_title_block(sheet, Title(part.title, part.number, material, scale, part.identity, model, tolerance))
    return sheet


def _draw_view(sheet: DrawingSheet, placed: PlacedView, width_mm: float) -> None:
    """Draw a view's edges; small views need thin lines."""
    visible, hidden = on_paper(placed.view, placed.scale)
    if hidden:
        sheet.lines([line + placed.shift for line in hidden], HIDDEN_MM, HIDDEN_COLOUR, HIDDEN_DASHES_MM)
    sheet.lines([line + placed.shift for line in visible], width_mm)


def dimensions_of(part: PartPlan, solid: Part, screw: Fastening) -> tuple[Length | Hole, ...]:
    """The dimensions of a part's plan, without those on other pieces of a split part."""
    lengths = [dimension for dimension in dimensions_in_plan(part.plan) if isinstance(dimension, Length)]
    holes = (dimension for dimension in dimensions_in_plan(part.plan) if isinstance(dimension, Hole))
    tolerance = "" if isinstance(part.plan, CouponPlan) else PRESS_TOLERANCE
    dimensions: tuple[Length | Hole, ...] = (*with_callouts(holes, solid, screw, tolerance), *lengths)
    if not isinstance(part.plan, PiecePlan):
        return dimensions
    box = solid.bounding_box()
    low, high = np.array(tuple(box.min)) - 0.1, np.array(tuple(box.max)) + 0.1

    def inside(dimension: Length | Hole) -> bool:
        points = dimension.points_in_rig if isinstance(dimension, Length) else dimension.centre_in_rig[None]
        return bool(((points >= low) & (points <= high)).all())

    return tuple(dimension for dimension in dimensions if inside(dimension))


def _arrange(
    views: Sequence[PartView], dimensions: Sequence[Length | Hole], right_end: float
) -> tuple[tuple[PlacedView, ...], float, tuple[float, float, float]]:
    """Place the views at the largest standard scale that leaves space for their dimensions.

    Returns the views, the scale, and the free space left of, below and above each view, mm.
    """
    top, front, _ = views
    free = np.array([right_end, FIELD_MM[1, 1]]) - FIELD_MM[0]
    width, depth = np.ptp(top.box, axis=0)
    size = np.array([width + depth, depth + np.ptp(front.box, axis=0)[1]])
    for scale in SCALES:
        at_origin = [PlacedView(view, scale, np.zeros(2)) for view in views]
        if (scale * size > free).any() and scale > SCALES[-1]:
            continue
        needed = np.maximum(annotate(DrawingSheet(*A3_MM), at_origin, dimensions).max(axis=0), MARK_MM)
        left, below, above = needed
        surplus = free - scale * size - 2.0 * np.array([left + 6.0, below + above])
        if (surplus >= 0.0).all():
            break
    # Distribute the remaining space equally around the views.
    left, below, above = needed + np.clip(surplus / 3.0, 0.0, (30.0, 20.0))[[0, 1, 1]] * (1.0, 0.5, 0.5)
    left_x, bottom_y = FIELD_MM[0] + (left, below)
    top_y = bottom_y + scale * float(np.ptp(front.box, axis=0)[1]) + above + below
    right_x = left_x + scale * width + left + 4.0
    corners = np.array([(left_x, top_y), (left_x, bottom_y), (right_x, bottom_y)])
    placed = tuple(
        PlacedView(view, scale, corner - view.box[0] * scale) for view, corner in zip(views, corners, strict=True)
    )
    return placed, scale, (float(left), float(below), float(above))


def _isometric(view: PartView, placed: Sequence[PlacedView], low: FloatArray, high: FloatArray) -> PlacedView:
    """The isometric view, scaled to a free rectangle."""
    scale = min(float(((high - low) / np.ptp(view.box, axis=0)).min()), 1.3 * placed[0].scale)
    return PlacedView(view, scale, (low + high) / 2.0 - view.box.mean(axis=0) * scale)


def _section_of(part: PartPlan, solid: Part, dimensions: Sequence[Length | Hole]) -> Section | None:
    """The section that shows the cavities of a part."""
    bed_from_rig = part.print_from_rig[:3, :3]
    plan = part.plan.whole if isinstance(part.plan, PiecePlan) else part.plan
    plane = section_plane(plan, [dimension for dimension in dimensions if isinstance(dimension, Hole)], bed_from_rig)
    return cut(solid, *plane, bed_from_rig) if plane else None


def _free_rectangles(
    sheet: DrawingSheet, placed: Sequence[PlacedView], free_above: float, right_end: float, table_low: float
) -> tuple[FloatArray, ...]:
    """Free rectangles (2, 2): above the view from the right, right of it, and below the tables, clear of text."""
    top, _, right = placed
    high_y = FIELD_MM[1, 1]
    area_above = np.array([(top.box[1, 0] + 12.0, right.box[1, 1] + free_above + 4.0), (right_end - 6.0, high_y)])
    low_y = FIELD_MM[0, 1] + 4.0
    area_right = np.array([(right.box[1, 0] + 12.0, low_y), (right_end - 6.0, right.box[1, 1] + free_above - 8.0)])
    area_below = np.array([(right_end + 4.0, low_y), (FIELD_MM[1, 0], table_low - 4.0)])
    return _clear_of_text(sheet, area_above), _clear_of_text(sheet, area_right), area_below


def _clear_of_text(sheet: DrawingSheet, rectangle: FloatArray) -> FloatArray:
    """The larger part of a rectangle (2, 2) right of or below the text that extends into it from the left."""
    boxes = np.array([(box.corners.min(axis=0), box.corners.max(axis=0)) for box in sheet.text_boxes])
    inside = ((boxes[:, 1] > rectangle[0]) & (boxes[:, 0] < rectangle[1])).all(axis=1)
    if not inside.any():
        return rectangle
    right_part, lower_part = rectangle.copy(), rectangle.copy()
    right_part[0, 0] = boxes[inside, 1, 0].max() + CLEAR_MM
    lower_part[1, 1] = boxes[inside, 0, 1].min() - CLEAR_MM
    return max(right_part, lower_part, key=lambda part: float(np.prod(np.maximum(part[1] - part[0], 0.0))))


def _place_section(
    section: Section | None, free: Sequence[FloatArray], scale: float
) -> tuple[PlacedView | None, FloatArray, FloatArray]:
    """Place a section, at most at the views' scale; returns it and the rectangle that remains for the isometric."""
    above, right, below = free
    if section is None:
        return None, above[0], above[1]
    for section_scale in (standard for standard in SCALES if standard <= scale):
        size = np.ptp(section.view.box, axis=0) * section_scale + (0.0, LABEL_MM)
        for rectangle in (below, right):
            if (size <= rectangle[1] - rectangle[0]).all():
                return _in_rectangle(section.view, section_scale, rectangle), above[0], above[1]
        size_above = above[1] - above[0]
        for axis, fraction in ((0, 0.55), (1, 0.6)):
            if size[axis] <= fraction * size_above[axis] and size[1 - axis] <= size_above[1 - axis]:
                # Left of the isometric, or below it.
                end = above[1].copy()
                end[axis] = above[0, axis] + size[axis]
                low = above[0].copy()
                low[axis] = end[axis] + 8.0
                return _in_rectangle(section.view, section_scale, np.array([above[0], end])), low, above[1]
    return None, above[0], above[1]


def _in_rectangle(view: PartView, scale: float, rectangle: FloatArray) -> PlacedView:
    """A view centred in a rectangle (2, 2) with space for its label above it."""
    centre = rectangle.mean(axis=0) - (0.0, LABEL_MM / 2.0)
    return PlacedView(view, scale, centre - view.box.mean(axis=0) * scale)


def _draw_section_marks(
    sheet: DrawingSheet, cutting_lines: Sequence[CuttingPlaneLine], section_view: PlacedView, scale: float
) -> None:
    """Draw a section's label, with its scale if it differs from the views', and one of its cutting-plane lines."""
    name = "A-A" if section_view.scale == scale else f"A-A ({ratio(section_view.scale)})"
    box = section_view.box
    sheet.text((float(box[:, 0].mean()), float(box[1, 1]) + 3.0), name, LETTER_MM, align="center", bold=True)
    draw_cutting_plane_line(sheet, cutting_lines, "A")


def draw_tables(sheet: DrawingSheet, tables: Sequence[DrawingTable], reserved_mm: float) -> tuple[float, float]:
    """Draw tables in the upper right corner, one below the other; returns their left and lower limits."""
    right, top = FIELD_MM[1]
    left = right
    for table in tables:
        cells = [table.header, *table.rows]
        pitch = min(ROW_MM, (top - FIELD_MM[0, 1] - 12.0 - reserved_mm) / (len(cells) + 1))
        height = min(TEXT_MM, 0.6 * pitch)
        widths = [max(text_width_mm(row[i], height) for row in cells) + 4.0 for i in range(len(table.header))]
        lines = [
            text_width_mm(table.title, TEXT_MM, bold=True),
            *(text_width_mm(line, NOTE_MM) for line in table.notes),
        ]
        start = right - max(sum(widths), max(lines) + 4.0)
        sheet.text((start + 1.5, top - 5.0), table.title, TEXT_MM, bold=True)
        y = top - 7.0
        ends = right - sum(widths) + np.cumsum(widths)
        for number, row in enumerate(cells):
            for column, (end, cell) in enumerate(zip(ends, row, strict=True)):
                left_aligned = column in table.left_aligned
                start_point = (end - widths[column] + 2.5 if left_aligned else end - 1.5, y - 0.72 * pitch)
                sheet.text(start_point, cell, height, align="left" if left_aligned else "right", bold=number == 0)
            y -= pitch
            sheet.lines([np.array([(start, y), (right, y)])], 0.35 if number == 0 else 0.1)
        for line in table.notes:
            sheet.text((start + 1.5, y - 4.0), line, NOTE_MM)
            y -= 3.6
        left, top = min(left, start), y - 6.0
    if tables:
        left -= 6.0
        sheet.lines([np.array([(left, FIELD_MM[0, 1]), (left, FIELD_MM[1, 1])])], 0.1, SOFT)
    return left, top
