"""Annotations on the views of a drawing: dimensions, notes of holes, geometrical tolerances and datums.

A dimension is drawn in the view that shows it best, and notes of holes above the views. Tolerance frames follow
ISO 1101, datums ISO 5459.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from shapely import LineString, MultiLineString, MultiPoint, Polygon

from mirrorcam.cad.guide.dimension_lines import (
    FIRST_TIER_MM,
    GAP_MM,
    LINE_MM,
    TEXT_MM,
    TIERS_MM,
    LinearDimension,
    draw_tiers,
    number,
    text_fits,
)
from mirrorcam.cad.guide.drawing_sheet import INK, DrawingSheet, text_width_mm
from mirrorcam.cad.guide.hole_callouts import (
    AXIS_MM,
    CENTRE_DASHES_MM,
    DEPTH,
    MOST_COORDINATES,
    PARALLEL,
    draw_numbers,
    draw_oblique,
    hole_groups,
    in_table,
    oblique_holes,
    oblique_lengths,
)
from mirrorcam.cad.guide.part_views import PlacedView
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.tolerances import Tolerances

FIRST_NOTE_MM, NOTE_PITCH_MM, NOTES_MM = 5.0, 5.0, 26.0
# Slope of leaders, so that they differ from edges of the part.
LEAN = 0.27
# Share of its area by which a symmetric outline may differ from its mirror image.
ASYMMETRY = 0.01
# Shortest straight edge from which dimensions are measured.
STRAIGHT_MM = 1.0
# Tried positions of an aligned dimension's text along it, the middle first.
ALONG = (0.5, 0.47, 0.53, 0.44, 0.56, 0.41, 0.59, 0.35, 0.65, 0.2, 0.8)


@dataclass(frozen=True)
class Note:
    """A note with a leader that ends `radius` from a point (2,) on paper."""

    point: FloatArray
    radius: float
    text: str


@dataclass(frozen=True)
class AlignedDimension:
    """An aligned dimension, parallel to the measured distance: both ends (2, 2) on paper, and its text."""

    ends: FloatArray
    text: str


@dataclass
class Annotations:
    """All annotations of one view: dimensions below, left and aligned, and notes."""

    below: list[LinearDimension]
    left: list[LinearDimension]
    aligned: list[AlignedDimension]
    notes: list[Note]


def annotate(
    sheet: DrawingSheet,
    placed: Sequence[PlacedView],
    dimensions: Iterable[Length | Hole],
    free_mm: tuple[float, float] = (TIERS_MM, TIERS_MM),
    traces: Sequence[tuple[int, int, float]] = (),
) -> None:
    """Draw the overall dimensions and those of the plan, each in the view that shows it best.

    `free_mm` is the free space left of and below the views. `traces` are possible traces of a section: the index of the
    view, the coordinate, x (0) or y (1), that is constant along the trace, and its value on paper.
    """
    per_view = [Annotations([], [], [], []) for _ in placed]
    _overall(placed, per_view)
    offered = tuple(dimensions)
    lengths = [each for each in offered if isinstance(each, Length)]
    for dimension in lengths:
        _length(placed, per_view, dimension)
    views = [view.view for view in placed]
    groups = hole_groups(views, offered)
    for (index, text), group in groups.items():
        _holes(sheet, placed[index], per_view[index], text, group)
    for index, hole in oblique_holes(groups, views, lengths):
        for tier, linear in zip(
            (per_view[index].below, per_view[index].left), oblique_lengths(placed[index], hole), strict=True
        ):
            _add(tier, linear)
        draw_oblique(sheet, placed[index], hole)
    for index, (view, job) in enumerate(zip(placed, per_view, strict=True)):
        upright_at, level_at = ([at for where, across, at in traces if (where, across) == (index, k)] for k in (0, 1))
        draw_tiers(sheet, view.box, job.below, free_mm[1], upright=False, traces=upright_at)
        draw_tiers(sheet, view.box, job.left, free_mm[0], upright=True, traces=level_at)
        for aligned in job.aligned:
            _draw_aligned(sheet, view, aligned)
        _draw_notes(sheet, view.box, job.notes)


def _overall(placed: Sequence[PlacedView], per_view: Sequence[Annotations]) -> None:
    _, front, right = placed
    for index, view, coordinate in ((1, front, 0), (1, front, 1), (2, right, 0)):
        box = view.box
        text = number(float(np.ptp(view.view.box[:, coordinate])))
        across = np.full(2, box[0, 1 - coordinate])
        (per_view[index].below, per_view[index].left)[coordinate].append(
            LinearDimension(box[:, coordinate], across, text)
        )


def _length(placed: Sequence[PlacedView], per_view: Sequence[Annotations], dimension: Length) -> None:
    """Place a length in the first view that shows its true length, as an aligned dimension if it is oblique there."""
    span = dimension.span_in_rig
    true_length = float(np.linalg.norm(span))
    text = f"{dimension.before}{number(true_length)} {dimension.text}".strip()
    depths = [abs(float(view.view.axes_in_rig[2] @ span)) for view in placed]
    index = int(np.argmin(np.round(depths, 3)))
    view, job = placed[index], per_view[index]
    points = view.paper(dimension.points_in_rig)
    across = np.abs(view.view.axes_in_rig[:2] @ span)
    if across[1] <= PARALLEL * true_length:
        _add(job.below, LinearDimension(points[:, 0], points[:, 1], text))
    elif across[0] <= PARALLEL * true_length:
        _add(job.left, LinearDimension(points[:, 1], points[:, 0], text))
    else:
        start = dimension.points_in_rig[0]
        job.aligned.append(AlignedDimension(view.paper(np.array([start, start + span])), text))


def _add(tier: list[LinearDimension], new: LinearDimension) -> None:
    """Add a dimension to a tier; of two equal ones, the one with the longer text stays."""
    for index, present in enumerate(tier):
        if np.abs(np.sort(present.along) - np.sort(new.along)).max() < 1e-3:
            tier[index] = max(present, new, key=lambda linear: len(linear.text))
            return
    tier.append(new)


def _holes(sheet: DrawingSheet, placed: PlacedView, job: Annotations, text: str, group: Sequence[Hole]) -> None:
    """Draw centre marks, one note for all equal holes, and dimensions from the part's edge and between holes."""
    centres = placed.paper(np.array([hole.centre_in_rig for hole in group]))
    radius = group[0].diameter_mm / 2.0 * placed.scale
    arms = np.array([(-1.0, 0.0), (1.0, 0.0)]) * (radius + 1.8)
    marks = [centre + arm for centre in centres for arm in (arms, arms[:, ::-1])]
    sheet.lines(marks, AXIS_MM, INK, CENTRE_DASHES_MM)
    count = f"{len(group)}x " if len(group) > 1 else ""
    # The note points to the hole with the shortest leader.
    job.notes.append(Note(centres[np.lexsort((centres[:, 0], -centres[:, 1]))[0]], radius, count + text))
    axis = group[0].axis_in_rig / np.linalg.norm(group[0].axis_in_rig)
    corner, origin = placed.box[0], placed.box[0]
    if group[0].datum is not None:
        origin = placed.paper(group[0].datum.at_in_rig)
    if in_table(group, placed.view):
        draw_numbers(sheet, placed, group)
        return
    for coordinate, tier in ((0, job.below), (1, job.left)):
        if abs(float(placed.view.axes_in_rig[coordinate] @ axis)) > PARALLEL:
            # Distances are foreshortened in an oblique view.
            continue
        coordinates = np.unique(np.round(centres[:, coordinate], 3))
        if len(coordinates) > MOST_COORDINATES:
            continue
        middle = float(placed.box[:, coordinate].mean())
        edge = float(coordinates[0] - origin[coordinate])
        if (
            abs(coordinates.mean() - middle) < 1e-2
            and _symmetric(placed, coordinate)
            and not (text_fits(edge, number(edge / placed.scale)) and _ends_straight(placed, coordinate))
        ):
            # The axis shows the symmetry: dimension only the distances between the holes.
            _axis(sheet, placed.box, coordinate, middle)
            starts = []
        else:
            starts = [(float(origin[coordinate]), float(corner[1 - coordinate]))]
        nearest = [centres[np.abs(centres[:, coordinate] - at) < 1e-2, 1 - coordinate].min() for at in coordinates]
        starts += [(float(at), float(start)) for at, start in zip(coordinates, nearest, strict=True)]
        for (here, from_here), (there, from_there) in pairwise(sorted(starts)):
            if there - here < 1e-3:
                continue
            ends = np.array([here, there])
            _add(tier, LinearDimension(ends, np.array([from_here, from_there]), number((there - here) / placed.scale)))


def _symmetric(placed: PlacedView, coordinate: int) -> bool:
    """Return whether the convex hull of a view is symmetric about its middle along x or y."""
    points = np.concatenate(placed.view.visible)
    mirrored = points.copy()
    mirrored[:, coordinate] = placed.view.box[:, coordinate].sum() - points[:, coordinate]
    hull, other = (MultiPoint(each).convex_hull for each in (points, mirrored))
    return bool(hull.symmetric_difference(other).area < ASYMMETRY * hull.area)


def _ends_straight(placed: PlacedView, coordinate: int) -> bool:
    """Return whether a view's outline starts with a straight edge along x or y, from which dimensions are measured."""
    hull = MultiPoint(np.concatenate(placed.view.visible)).convex_hull
    ends = np.array(hull.exterior.coords)
    return bool(np.ptp(ends[ends[:, coordinate] < ends[:, coordinate].min() + 1e-3, 1 - coordinate]) > STRAIGHT_MM)


def _axis(sheet: DrawingSheet, box: FloatArray, coordinate: int, at: float) -> None:
    """Draw the axis of symmetry of a view across x or y, at that coordinate."""
    ends = np.array([[at, box[0, 1] - 3.0], [at, box[1, 1] + 3.0]])
    if coordinate:
        ends = np.array([[box[0, 0] - 3.0, at], [box[1, 0] + 3.0, at]])
    sheet.lines([ends], AXIS_MM, INK, CENTRE_DASHES_MM)


def _draw_aligned(sheet: DrawingSheet, placed: PlacedView, aligned: AlignedDimension) -> None:
    """Draw an aligned dimension on the side where it crosses fewer edges."""
    start, end = aligned.ends if aligned.ends[1, 0] >= aligned.ends[0, 0] else aligned.ends[::-1]
    along = (end - start) / np.linalg.norm(end - start)
    normal = np.array([-along[1], along[0]])
    edges = MultiLineString([line * placed.scale + placed.shift for line in placed.view.visible])

    def crossed_mm(side: float) -> float:
        band = [side * (FIRST_TIER_MM + 2.0 * TEXT_MM) * normal, side * GAP_MM * normal]
        return float(
            Polygon([start + band[0], end + band[0], end + band[1], start + band[1]]).intersection(edges).length
        )

    side = min((1.0, -1.0), key=crossed_mm)
    offset, gap = side * FIRST_TIER_MM * normal, side * GAP_MM * normal
    ends = np.array([start + offset, end + offset])
    overshoot = side * 1.5 * normal
    sheet.lines([ends, *(np.array([at + gap, at + offset + overshoot]) for at in (start, end))], LINE_MM)
    sheet.arrow_head(ends[0], -along)
    sheet.arrow_head(ends[1], along)
    angle = float(np.degrees(np.arctan2(along[1], along[0])))
    half = text_width_mm(aligned.text, TEXT_MM) / 2.0 * along
    lines = [line for line, _ in sheet.drawn]

    def crossings(middle: FloatArray) -> int:
        box = Polygon(
            [middle - half, middle + half, middle + half + TEXT_MM * normal, middle - half + TEXT_MM * normal]
        )
        return sum(box.intersects(LineString(line)) for line in lines)

    candidates = [start + offset + share * (end - start) + 0.9 * normal for share in ALONG]
    sheet.text(min(candidates, key=crossings), aligned.text, TEXT_MM, align="center", turn_deg=angle)


def _draw_notes(sheet: DrawingSheet, box: FloatArray, notes: Sequence[Note]) -> None:
    """Draw notes above the view, the rightmost lowest, so that no leader crosses text or another leader."""
    pitch = min(NOTE_PITCH_MM, (NOTES_MM - FIRST_NOTE_MM - TEXT_MM - 1.5) / max(len(notes) - 1, 1))
    ordered = sorted(notes, key=lambda note: (-(note.point[0] - LEAN * note.point[1]), note.text))
    leader_direction = np.array([LEAN, 1.0]) / np.hypot(LEAN, 1.0)
    for row, note in enumerate(ordered):
        height = float(box[1, 1]) + FIRST_NOTE_MM + row * pitch
        tip = note.point + note.radius * leader_direction
        knee = np.array([tip[0] + LEAN * (height - tip[1]), height])
        width = text_width_mm(note.text, TEXT_MM)
        sheet.lines([np.array([tip, knee, knee + np.array([width + 1.5, 0.0])])], LINE_MM)
        sheet.arrow_head(tip, -leader_direction)
        sheet.text(knee + np.array([1.0, 0.8]), note.text, TEXT_MM)


Characteristic = Literal["flatness", "angularity", "profile"]
FRAME_MM, FRAME_LINE_MM, SYMBOL_MM = 5.0, 0.2, 0.25
ROW_MM = 6.5
TRIANGLE_MM = (1.6, 2.0)
"""Half of the base and height of a datum triangle."""

STEM_MM = 2.0
RESERVED_MM = 50.0
"""Space for the tolerances of a holder below its table."""


@dataclass(frozen=True)
class GeometricalTolerance:
    """A tolerance zone `zone_mm` wide for the features described in `of`, with respect to datums."""

    of: str
    characteristic: Characteristic
    zone_mm: float
    datums: tuple[str, ...] = ()


def holder_tolerances(plan: HolderPlan, built: Tolerances) -> tuple[GeometricalTolerance, ...]:
    """The tolerances of a holder's seats that correspond to the tolerances of a layout as built (`built`).

    Datum A is the flat back, B the holes of the mount's screws in it. The profile zone of a seat is the mirror's
    tolerance along its normal, plus or minus. The zone of angularity, which includes flatness, is the step that tilts
    the smallest mirror by its tolerance of tilt. The back is as flat as the seats.
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
    """Notes on the datums and the tolerance zones."""
    return (
        "values of the table of seats are theoretically exact (ISO 1101);",
        "datum A: the flat back, B: the holes of the mount's screws in it;",
        f"the zones keep a mirror's tilt to {built.tilt_deg:g}° and its shift along",
        f"the normal to {built.offset_mm:g} mm, as its layout's figures as built take",
    )


def draw_frames(
    sheet: DrawingSheet, left: float, top: float, tolerances: Sequence[GeometricalTolerance], notes: Sequence[str]
) -> float:
    """Draw tolerance frames from a corner downwards, and notes; returns the y of their lower end."""
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
        for text in (f"{each.zone_mm:g}", *each.datums):
            width = max(FRAME_MM, text_width_mm(text, TEXT_MM) + 2.0)
            sheet.rectangle((x, y), (x + width, y + FRAME_MM), FRAME_LINE_MM)
            sheet.text((x + width / 2.0, y + 1.3), text, TEXT_MM, align="center")
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
        angles = np.linspace(0.0, np.pi, 25)
        line = np.vstack([1.7 * np.column_stack([np.cos(angles), np.sin(angles)]), [(1.7, 0.0)]]) - np.array([0.0, 0.8])
    sheet.lines([middle + line], SYMBOL_MM)


def draw_datum(sheet: DrawingSheet, at: FloatArray, side: float, letter: str) -> None:
    """Draw a datum triangle on a horizontal line at a point (2,), with its letter above (`side` 1) or below (-1)."""
    half_width, height = TRIANGLE_MM
    tip = at + np.array([0.0, side * height])
    stem_end = tip[1] + side * STEM_MM
    base = np.array([half_width, 0.0])
    corners = np.array([at - base, at + base, tip, at - base])
    sheet.lines([corners, np.array([tip, (tip[0], stem_end)])], FRAME_LINE_MM, INK)
    low = stem_end if side > 0.0 else stem_end - FRAME_MM
    sheet.rectangle((at[0] - FRAME_MM / 2.0, low), (at[0] + FRAME_MM / 2.0, low + FRAME_MM), FRAME_LINE_MM)
    sheet.text((float(at[0]), low + 1.3), letter, TEXT_MM, align="center")


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
