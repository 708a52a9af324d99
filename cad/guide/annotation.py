"""Annotations on the views of a drawing: dimensions, hole callouts, geometrical tolerances and datums.

A dimension is drawn in the view that shows it best, and hole callouts above the views. Tolerance frames follow
ISO 1101, datums ISO 5459.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import shapely
from shapely import LineString, MultiPoint, Polygon

from mirrorcam.cad.guide.dimension_lines import (
    FIRST_TIER_MM,
    GAP_MM,
    LINE_MM,
    TEXT_MM,
    LinearDimension,
    draw_tiers,
    number,
    text_fits,
)
from mirrorcam.cad.guide.drawing_sheet import ARROW_MM, FIELD_MM, INK, DrawingSheet, overlaps, text_width_mm
from mirrorcam.cad.guide.hole_callouts import (
    AXIS_MM,
    CENTRE_DASHES_MM,
    DEPTH,
    MAX_COORDINATES,
    PARALLEL,
    draw_numbers,
    draw_oblique,
    hole_groups,
    in_table,
    oblique_holes,
    oblique_lengths,
)
from mirrorcam.cad.guide.part_views import PlacedView
from mirrorcam.cad.holder.carriers import CarrierPlan
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.tolerances import Tolerances

FIRST_NOTE_MM, NOTE_PITCH_MM, MIN_NOTE_PITCH_MM = 5.0, 5.0, 4.3
# Slope of leaders (x / y), so that they differ from edges of the part.
LEADER_SLOPE = 0.27
# Fraction of its area by which a symmetric outline may differ from its mirror image.
MAX_ASYMMETRY = 0.01
# Minimum length of a straight edge from which dimensions are measured.
MIN_EDGE_MM = 1.0
# Candidate positions of an aligned dimension's text, as fractions of its length, the centre first.
TEXT_POSITIONS = (0.5, 0.47, 0.53, 0.44, 0.56, 0.41, 0.59, 0.35, 0.65, 0.2, 0.8)
# Candidate distances of the shelf with the text of a narrow dimension.
SHELVES_MM = tuple(range(6, 70, 2))
# Candidate angles by which its leader turns off the dimension, the straight one first, and the sine of the smallest
# angle from its shelf at which it does.
TURNS_DEG, MIN_RISE = (0.0, -30.0, 30.0, -60.0, 60.0), 0.25


@dataclass(frozen=True)
class Note:
    """A note with a leader that ends `radius` from a point (2,) on paper."""

    point: FloatArray
    radius: float
    text: str


@dataclass
class Annotations:
    """All annotations of one view: dimensions below, left and aligned, and notes."""

    below: list[LinearDimension]
    left: list[LinearDimension]
    aligned: list[Length]
    notes: list[Note]


def annotate(
    sheet: DrawingSheet,
    placed: Sequence[PlacedView],
    dimensions: Iterable[Length | Hole],
    free_mm: tuple[float, float, float] = (np.inf, np.inf, np.inf),
    cutting_lines: Sequence[tuple[int, int, float]] = (),
) -> FloatArray:
    """Draw the overall dimensions and those of the plan, each in the view that shows it best.

    `free_mm` is the free space left of, below and above the views. `cutting_lines` are lines that no text of a
    dimension may cross, possible cutting-plane lines of a section and the edges of the field: the index of the view,
    the coordinate, x (0) or y (1), that is constant along the line, and its value on paper. Returns the space (n, 3)
    that the annotations need left of, below and above each view.
    """
    per_view = [Annotations([], [], [], []) for _ in placed]
    _add_overall(placed, per_view)
    dimensions = tuple(dimensions)
    lengths = [dimension for dimension in dimensions if isinstance(dimension, Length)]
    for dimension in lengths:
        _place_length(placed, per_view, dimension)
    views = [view.view for view in placed]
    groups = hole_groups(views, dimensions)
    for (index, text), group in groups.items():
        _draw_holes(sheet, placed[index], per_view[index], text, group)
    oblique = oblique_holes(groups, views, lengths)
    for index, hole in oblique:
        for tier, linear in zip(
            (per_view[index].below, per_view[index].left), oblique_lengths(placed[index], hole), strict=True
        ):
            _add(tier, linear)
    needed = np.zeros((len(placed), 3))
    for index, (view, view_annotations) in enumerate(zip(placed, per_view, strict=True)):
        lines_x, lines_y = (
            [value for view_index, axis, value in cutting_lines if (view_index, axis) == (index, k)] for k in (0, 1)
        )
        left = draw_tiers(sheet, view.box, view_annotations.left, free_mm[0], vertical=True, cutting_lines=lines_y)
        low_x, low_y = view.box[0] - FIRST_TIER_MM / 2.0
        if any((box.corners < (low_x, low_y)).all(axis=1).any() for box in sheet.text_boxes):
            # Texts of the vertical dimensions are in the corner left of and below the view.
            lines_x.append(float(low_x))
        below = draw_tiers(sheet, view.box, view_annotations.below, free_mm[1], vertical=False, cutting_lines=lines_x)
        needed[index] = left, below, _draw_notes(sheet, view.box, view_annotations.notes, free_mm[2])
    # These avoid what is there.
    for index, (view, view_annotations) in enumerate(zip(placed, per_view, strict=True)):
        draw_oblique(sheet, view, [hole for of_view, hole in oblique if of_view == index])
        draw_aligned(sheet, view, view_annotations.aligned)
    return needed


def _add_overall(placed: Sequence[PlacedView], per_view: Sequence[Annotations]) -> None:
    _, front, right = placed
    for index, view, coordinate in ((1, front, 0), (1, front, 1), (2, right, 0)):
        box = view.box
        text = number(float(np.ptp(view.view.box[:, coordinate])))
        starts = np.full(2, box[0, 1 - coordinate])
        (per_view[index].below, per_view[index].left)[coordinate].append(
            LinearDimension(box[:, coordinate], starts, text)
        )


def _place_length(placed: Sequence[PlacedView], per_view: Sequence[Annotations], dimension: Length) -> None:
    """Place a length in the first view that shows its true length, as an aligned dimension if it is oblique there."""
    span, text = dimension.span_in_rig, text_of(dimension)
    true_length = float(np.linalg.norm(span))
    depths = [abs(float(view.view.axes_in_rig[2] @ span)) for view in placed]
    index = int(np.argmin(np.round(depths, 3)))
    view, annotations = placed[index], per_view[index]
    points = view.paper(dimension.points_in_rig)
    extents = np.abs(view.view.axes_in_rig[:2] @ span)
    if extents[1] <= PARALLEL * true_length:
        _add(annotations.below, LinearDimension(points[:, 0], points[:, 1], text))
    elif extents[0] <= PARALLEL * true_length:
        _add(annotations.left, LinearDimension(points[:, 1], points[:, 0], text))
    else:
        annotations.aligned.append(dimension)


def text_of(dimension: Length) -> str:
    """The text of a length with its tolerance."""
    value = number(float(np.linalg.norm(dimension.span_in_rig)))
    return f"{dimension.before}{value}{dimension.tolerance} {dimension.text}".strip()


def _add(tier: list[LinearDimension], new: LinearDimension) -> None:
    """Add a dimension to a tier; of two identical ones, the one with the longer text is kept."""
    for index, existing in enumerate(tier):
        if np.abs(np.sort(existing.ends) - np.sort(new.ends)).max() < 1e-3:
            tier[index] = max(existing, new, key=lambda linear: len(linear.text))
            return
    tier.append(new)


def _draw_holes(
    sheet: DrawingSheet, placed: PlacedView, annotations: Annotations, text: str, group: Sequence[Hole]
) -> None:
    """Draw centre marks, one callout for all identical holes, and dimensions from the part's edge and between holes."""
    centres = placed.paper(np.array([hole.centre_in_rig for hole in group]))
    radius = group[0].diameter_mm / 2.0 * placed.scale
    arms = np.array([(-1.0, 0.0), (1.0, 0.0)]) * (radius + 1.8)
    marks = [centre + arm for centre in centres for arm in (arms, arms[:, ::-1])]
    sheet.lines(marks, AXIS_MM, INK, CENTRE_DASHES_MM)
    count = f"{len(group)}x " if len(group) > 1 else ""
    # The callout points to the hole with the shortest leader.
    annotations.notes.append(Note(centres[np.lexsort((centres[:, 0], -centres[:, 1]))[0]], radius, count + text))
    axis = group[0].axis_in_rig / np.linalg.norm(group[0].axis_in_rig)
    corner, origin = placed.box[0], placed.box[0]
    if group[0].datum is not None:
        origin = placed.paper(group[0].datum.point_in_rig)
    if in_table(group, placed.view):
        draw_numbers(sheet, placed, group)
        return
    for coordinate, tier in ((0, annotations.below), (1, annotations.left)):
        if abs(float(placed.view.axes_in_rig[coordinate] @ axis)) > PARALLEL:
            # Distances are foreshortened in an oblique view.
            continue
        coordinates = np.unique(np.round(centres[:, coordinate], 3))
        if len(coordinates) > MAX_COORDINATES:
            continue
        centre = float(placed.box[:, coordinate].mean())
        edge = float(coordinates[0] - origin[coordinate])
        if (
            abs(coordinates.mean() - centre) < 1e-2
            and _symmetric(placed, coordinate)
            and not (text_fits(edge, number(edge / placed.scale)) and _has_straight_start(placed, coordinate))
        ):
            # The axis shows the symmetry: dimension only the distances between the holes.
            _draw_axis(sheet, placed.box, coordinate, centre)
            points = []
        else:
            points = [(float(origin[coordinate]), float(corner[1 - coordinate]))]
        starts = [centres[np.abs(centres[:, coordinate] - x) < 1e-2, 1 - coordinate].min() for x in coordinates]
        points += [(float(x), float(start)) for x, start in zip(coordinates, starts, strict=True)]
        for (first, first_start), (second, second_start) in pairwise(sorted(points)):
            if second - first < 1e-3:
                continue
            text = number((second - first) / placed.scale)
            _add(tier, LinearDimension(np.array([first, second]), np.array([first_start, second_start]), text))


def _symmetric(placed: PlacedView, coordinate: int) -> bool:
    """Return whether the convex hull of a view is symmetric about its centre along x or y."""
    points = np.concatenate(placed.view.visible)
    mirrored = points.copy()
    mirrored[:, coordinate] = placed.view.box[:, coordinate].sum() - points[:, coordinate]
    hull, other = (MultiPoint(corners).convex_hull for corners in (points, mirrored))
    return bool(hull.symmetric_difference(other).area < MAX_ASYMMETRY * hull.area)


def _has_straight_start(placed: PlacedView, coordinate: int) -> bool:
    """Return whether a view's outline starts with a straight edge along x or y, from which dimensions are measured."""
    hull = MultiPoint(np.concatenate(placed.view.visible)).convex_hull
    ends = np.array(hull.exterior.coords)
    return bool(np.ptp(ends[ends[:, coordinate] < ends[:, coordinate].min() + 1e-3, 1 - coordinate]) > MIN_EDGE_MM)


def _draw_axis(sheet: DrawingSheet, box: FloatArray, coordinate: int, value: float) -> None:
    """Draw the axis of symmetry of a view on which x or y has a value."""
    ends = np.array([[value, box[0, 1] - 3.0], [value, box[1, 1] + 3.0]])
    if coordinate:
        ends = np.array([[box[0, 0] - 3.0, value], [box[1, 0] + 3.0, value]])
    sheet.lines([ends], AXIS_MM, INK, CENTRE_DASHES_MM)


def draw_aligned(sheet: DrawingSheet, placed: PlacedView, dimensions: Iterable[Length]) -> None:
    """Draw lengths parallel to themselves, then narrow ones, which have more places, across the feature."""
    narrow = []
    for dimension in dimensions:
        text, (start, _) = text_of(dimension), dimension.points_in_rig
        start, end = placed.paper(np.array([start, start + dimension.span_in_rig]))
        if text_fits(float(np.linalg.norm(end - start)), text):
            _draw_parallel(sheet, start, end, text)
        else:
            narrow.append((start, end, text))
    for start, end, text in narrow:
        _draw_narrow(sheet, start, end, text)


def _draw_parallel(sheet: DrawingSheet, start: FloatArray, end: FloatArray, text: str) -> None:
    """Draw an aligned dimension between two points (2,), on the side where fewer lines are."""
    # Its text reads from below or, if it is vertical, from the right.
    if (round(float(end[0] - start[0]), 3), end[1]) < (0.0, start[1]):
        start, end = end, start
    direction = (end - start) / np.linalg.norm(end - start)
    normal = np.array([-direction[1], direction[0]])
    _, lines = sheet.occupied()

    def crossed_mm(side: float) -> float:
        band = [side * (FIRST_TIER_MM + 2.0 * TEXT_MM) * normal, side * GAP_MM * normal]
        area = Polygon([start + band[0], end + band[0], end + band[1], start + band[1]])
        return float(shapely.length(shapely.intersection(lines.geometries[lines.query(area)], area)).sum())

    side = min((1.0, -1.0), key=crossed_mm)
    offset, gap = side * FIRST_TIER_MM * normal, side * GAP_MM * normal
    ends = np.array([start + offset, end + offset])
    overshoot = side * 1.5 * normal
    sheet.lines([ends, *(np.array([point + gap, point + offset + overshoot]) for point in (start, end))], LINE_MM)
    sheet.arrow_head(ends[0], -direction)
    sheet.arrow_head(ends[1], direction)
    bases = [ends[0] + fraction * (end - start) + 0.9 * normal for fraction in TEXT_POSITIONS]
    _draw_along(sheet, bases, direction, text)


def _draw_narrow(sheet: DrawingSheet, first: FloatArray, second: FloatArray, label: str) -> None:
    """Draw an aligned dimension with its arrows outside, or one arrow for a radius, and its text on a shelf."""
    is_radius = "R" in label
    inward = (second - first) / np.linalg.norm(second - first)
    width = text_width_mm(label, TEXT_MM) + 2.0
    boxes, lines = sheet.occupied()
    field = shapely.box(*FIELD_MM.ravel())
    # A radius has its text on the side of its centre, a wall on either side.
    sides = [(first, second, -inward)] if is_radius else [(first, second, -inward), (second, first, inward)]
    stub = ARROW_MM[0] + 1.5
    places = [
        (*side, distance, turn)
        for turn in ((0.0,) if is_radius else TURNS_DEG)
        for distance in SHELVES_MM
        for side in sides
    ]

    def leader_of(start: FloatArray, direction: FloatArray, distance: float, turn_deg: float) -> FloatArray:
        cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        turned = np.array([[cosine, -sine], [sine, cosine]]) @ direction
        bend = start + stub * direction
        knee = bend + (distance - stub) * turned
        return np.array([start, bend, knee, knee + np.array([width if turned[0] >= -PARALLEL else -width, 0.0])])

    def cost(place: tuple[FloatArray, FloatArray, FloatArray, float, float]) -> tuple[int, ...]:
        start, _, direction, distance, turn_deg = place
        leader = leader_of(start, direction, distance, turn_deg)
        shelf = leader[2:]
        flat = turn_deg != 0.0 and abs(leader[2, 1] - leader[1, 1]) < MIN_RISE * (distance - stub)
        area = shapely.box(*shelf.min(axis=0), *(shelf.max(axis=0) + np.array([0.0, 1.4 * TEXT_MM]))).buffer(1.0)
        covered = shapely.union(area, LineString(leader[:3]))
        return not field.contains(area), *overlaps(covered, boxes), *overlaps(area, lines), flat

    start, end, direction, distance, turn_deg = min(places, key=cost)
    leader = leader_of(start, direction, distance, turn_deg)
    sheet.lines([np.array([end, *leader[1:]]) if is_radius else leader], LINE_MM)
    if is_radius:
        sheet.arrow_head(end, -direction)
    else:
        sheet.lines([np.array([end, end - stub * direction])], LINE_MM)
        sheet.arrow_head(start, -direction)
        sheet.arrow_head(end, direction)
    shelf = leader[2:]
    sheet.text(shelf.mean(axis=0) + np.array([0.0, 0.8]), label, TEXT_MM, align="center")


def _draw_along(sheet: DrawingSheet, bases: Sequence[FloatArray], direction: FloatArray, text: str) -> None:
    """Draw a text along a direction (2,), its base centred at the candidate (2,) that crosses the fewest lines."""
    half, normal = text_width_mm(text, TEXT_MM) / 2.0 * direction, np.array([-direction[1], direction[0]])
    _, lines = sheet.occupied()

    def crossings(centre: FloatArray) -> tuple[int, ...]:
        box = Polygon(
            [centre - half, centre + half, centre + half + TEXT_MM * normal, centre - half + TEXT_MM * normal]
        )
        return overlaps(box, lines)

    angle = float(np.degrees(np.arctan2(direction[1], direction[0])))
    sheet.text(min(bases, key=crossings), text, TEXT_MM, align="center", rotation_deg=angle)


def _draw_notes(sheet: DrawingSheet, box: FloatArray, notes: Sequence[Note], free_mm: float) -> float:
    """Draw notes above the view, the rightmost lowest, so that no leader crosses text or another leader.

    They point to the left instead, the leftmost lowest, if one would leave the sheet's field at the right. Returns the
    space that they need, mm, of which `free_mm` is there.
    """
    outside, gaps = FIRST_NOTE_MM + TEXT_MM + 1.5, max(len(notes) - 1, 0)
    pitch = min(NOTE_PITCH_MM, (free_mm - outside) / max(gaps, 1))
    placed = _leaders(box, notes, pitch, 1.0)
    if any(line[:, 0].max() > FIELD_MM[1, 0] for _, line in placed):
        placed = _leaders(box, notes, pitch, -1.0)
    for note, line in placed:
        tip, knee, end = line
        sheet.lines([line], LINE_MM)
        sheet.arrow_head(tip, (tip - knee) / np.linalg.norm(tip - knee))
        sheet.text(np.array([min(knee[0] + 1.0, end[0] + 0.5), knee[1] + 0.8]), note.text, TEXT_MM)
    return outside + gaps * MIN_NOTE_PITCH_MM if notes else 0.0


def _leaders(box: FloatArray, notes: Sequence[Note], pitch_mm: float, side: float) -> list[tuple[Note, FloatArray]]:
    """Notes with their lines (3, 2) from tip to knee and along the text, to the right (1.0) or the left (-1.0)."""
    ordered = sorted(notes, key=lambda note: (-(side * note.point[0] - LEADER_SLOPE * note.point[1]), note.text))
    leader_direction = np.array([side * LEADER_SLOPE, 1.0]) / np.hypot(LEADER_SLOPE, 1.0)
    placed = []
    for row, note in enumerate(ordered):
        height = float(box[1, 1]) + FIRST_NOTE_MM + row * pitch_mm
        tip = note.point + note.radius * leader_direction
        knee = np.array([tip[0] + side * LEADER_SLOPE * (height - tip[1]), height])
        end = knee + np.array([side * (text_width_mm(note.text, TEXT_MM) + 1.5), 0.0])
        placed.append((note, np.array([tip, knee, end])))
    return placed


Characteristic = Literal["flatness", "angularity", "profile"]
FRAME_MM, FRAME_LINE_MM, SYMBOL_MM = 5.0, 0.2, 0.25
ROW_MM = 6.5
TRIANGLE_MM = (1.6, 2.0)
"""Half the base, and the height, of a datum triangle."""

STEM_MM = 2.0
RESERVED_MM = 50.0
"""Space below a holder's table for its tolerances."""


@dataclass(frozen=True)
class GeometricalTolerance:
    """A tolerance zone `zone_mm` wide for the described features, with respect to datums."""

    features: str
    characteristic: Characteristic
    zone_mm: float
    datums: tuple[str, ...] = ()


def holder_tolerances(plan: HolderPlan, built: Tolerances) -> tuple[GeometricalTolerance, ...]:
    """The tolerances of a holder's seats that correspond to the tolerances `built` of an as-built layout.

    Datum A is the flat back, B the holes in it for the mount's screws. The profile zone of a seat is the mirror's
    tolerance along its normal, plus or minus. The back is as flat as the seats.
    """
    flat = pad_zone_mm(plan, built)
    seats = f"{len(plan.cores)}x seat"
    return (
        GeometricalTolerance("back (A)", "flatness", flat),
        GeometricalTolerance(seats, "angularity", flat, ("A", "B")),
        GeometricalTolerance(seats, "profile", round(2.0 * built.offset_mm, 2), ("A", "B")),
    )


def pad_zone_mm(plan: HolderPlan | CarrierPlan, built: Tolerances) -> float:
    """The zone of the pads' tops that tilts no mirror by more than its tolerance, an even number of hundredths.

    Half the zone is the tolerance of a pad's height. The tilt is at most the zone over the smallest altitude of the
    triangle of a mirror's pads.
    """
    pads = np.array([pad.top.mean(axis=0) for pad in plan.pads]).reshape(-1, 3, 3)
    sides = np.linalg.norm(pads - np.roll(pads, 1, axis=1), axis=2)
    doubled_area = np.linalg.norm(np.cross(pads[:, 1] - pads[:, 0], pads[:, 2] - pads[:, 0]), axis=1)
    altitude = float((doubled_area / sides.max(axis=1)).min())
    return float(np.floor(50.0 * altitude * np.tan(np.deg2rad(built.tilt_deg))) / 50.0)


def tolerance_notes(built: Tolerances) -> tuple[str, ...]:
    """Notes on the datums and the tolerance zones."""
    return (
        "values in the table of seats are theoretically exact (ISO 1101);",
        "datum A: the flat back; B: the holes in it for the mount's screws;",
        f"the zones limit a mirror's tilt to {built.tilt_deg:g}° and its normal shift",
        f"to {built.offset_mm:g} mm, as assumed for the layout's as-built figures",
    )


def draw_frames(
    sheet: DrawingSheet, left: float, top: float, tolerances: Sequence[GeometricalTolerance], notes: Sequence[str]
) -> float:
    """Draw tolerance frames from a corner downwards, and notes; returns the y of their lower end."""
    sheet.text((left, top - 5.0), "Geometrical tolerances (ISO 1101)", TEXT_MM, bold=True)
    start = left + max(text_width_mm(tolerance.features, TEXT_MM) for tolerance in tolerances) + 3.0
    y = top - 7.0
    for tolerance in tolerances:
        y -= ROW_MM
        sheet.text((left, y + 1.3), tolerance.features, TEXT_MM)
        x = start
        _draw_symbol(sheet, np.array([x + FRAME_MM / 2.0, y + FRAME_MM / 2.0]), tolerance.characteristic)
        sheet.rectangle((x, y), (x + FRAME_MM, y + FRAME_MM), FRAME_LINE_MM)
        x += FRAME_MM
        for text in (f"{tolerance.zone_mm:g}", *tolerance.datums):
            width = max(FRAME_MM, text_width_mm(text, TEXT_MM) + 2.0)
            sheet.rectangle((x, y), (x + width, y + FRAME_MM), FRAME_LINE_MM)
            sheet.text((x + width / 2.0, y + 1.3), text, TEXT_MM, align="center")
            x += width
    for note in notes:
        y -= 4.0
        sheet.text((left, y), note, 2.0)
    return y - 4.0


def _draw_symbol(sheet: DrawingSheet, centre: FloatArray, characteristic: Characteristic) -> None:
    if characteristic == "flatness":
        line = np.array([(-1.8, -0.9), (0.8, -0.9), (1.8, 0.9), (-0.8, 0.9), (-1.8, -0.9)])
    elif characteristic == "angularity":
        line = np.array([(1.7, 1.2), (-1.7, -1.0), (1.7, -1.0)])
    else:
        angles = np.linspace(0.0, np.pi, 25)
        line = np.vstack([1.7 * np.column_stack([np.cos(angles), np.sin(angles)]), [(1.7, 0.0)]]) - np.array([0.0, 0.8])
    sheet.lines([centre + line], SYMBOL_MM)


def draw_datum(sheet: DrawingSheet, point: FloatArray, side: float, letter: str) -> None:
    """Draw a datum triangle on a horizontal line at a point (2,), with its letter above (`side` 1) or below (-1)."""
    half_width, height = TRIANGLE_MM
    tip = point + np.array([0.0, side * height])
    stem_end = tip[1] + side * STEM_MM
    base = np.array([half_width, 0.0])
    corners = np.array([point - base, point + base, tip, point - base])
    sheet.lines([corners, np.array([tip, (tip[0], stem_end)])], FRAME_LINE_MM, INK)
    low = stem_end if side > 0.0 else stem_end - FRAME_MM
    sheet.rectangle((point[0] - FRAME_MM / 2.0, low), (point[0] + FRAME_MM / 2.0, low + FRAME_MM), FRAME_LINE_MM)
    sheet.text((float(point[0]), low + 1.3), letter, TEXT_MM, align="center")


def draw_holder_datums(sheet: DrawingSheet, front: PlacedView) -> None:
    """Mark a holder's datums: A on its flat back (the lower edge of the view), and B at the callout of its holes."""
    (_, low), (right, _) = front.box
    edge = np.array([(right + 1.0, low), (right + 9.0, low)])
    sheet.lines([edge], LINE_MM)
    draw_datum(sheet, edge.mean(axis=0), -1.0, "A")
    for box in [box for box in sheet.text_boxes if DEPTH in box.text]:
        end = np.array([box.corners[:, 0].max(), box.corners[:, 1].min()])
        shelf = np.array([end, end + np.array([8.0, 0.0])])
        sheet.lines([shelf], LINE_MM)
        draw_datum(sheet, shelf[1] - np.array([3.0, 0.0]), 1.0, "B")
