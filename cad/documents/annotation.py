"""Dimensions on the views of a drawing: tiers of dimension lines below and left of a view, notes of holes above it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from shapely import MultiLineString, Polygon

from mirrorcam.cad.documents.drawing_sheet import ARROW_MM, INK, DrawingSheet, text_width_mm
from mirrorcam.cad.documents.part_views import PlacedView
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.optics.base.values import FloatArray

LINE_MM = 0.18
TEXT_MM = 2.5
FIRST_TIER_MM, TIER_PITCH_MM, TIERS_MM = 7.5, 6.5, 27.0
FIRST_WORDS_MM, WORDS_PITCH_MM, WORDS_MM = 5.0, 5.0, 22.0
# Leaders lean by this much per mm upwards, so that they differ from edges of the part.
LEAN = 0.27
BESIDE_MM = 1.0
PARALLEL = 1e-4
CENTRE_DASHES_MM = (2.0, 0.6, 0.5, 0.6)


@dataclass(frozen=True)
class LinearDimension:
    """A dimension along x or y: coordinates (2,) along and across it of both its ends, mm on paper, and its text."""

    along: FloatArray
    across: FloatArray
    words: str

    @property
    def span(self) -> float:
        return float(np.ptp(self.along))


@dataclass(frozen=True)
class Note:
    """A note with a leader that ends `radius` from a point (2,) on paper."""

    point: FloatArray
    radius: float
    words: str


@dataclass(frozen=True)
class AlignedDimension:
    """An aligned dimension, parallel to what it measures: both ends (2, 2) on paper, and its text."""

    ends: FloatArray
    words: str


@dataclass
class Annotations:
    """All annotations of one view."""

    below: list[LinearDimension]
    left: list[LinearDimension]
    askew: list[AlignedDimension]
    notes: list[Note]


def number(value_mm: float) -> str:
    """A length as a drawing writes it: at most two decimals, no trailing zeros."""
    return f"{value_mm:.2f}".rstrip("0").rstrip(".")


def annotate(sheet: DrawingSheet, placed: Sequence[PlacedView], dimensions: Iterable[Length | Hole]) -> None:
    """Draw overall dimensions and those of the plan, each in the view that shows it best."""
    jobs = [Annotations([], [], [], []) for _ in placed]
    _overall(placed, jobs)
    holes: dict[tuple[int, str], list[Hole]] = defaultdict(list)
    for dimension in dimensions:
        if isinstance(dimension, Length):
            _length(placed, jobs, dimension)
        else:
            axis = dimension.axis_in_rig / np.linalg.norm(dimension.axis_in_rig)
            facing = [abs(float(view.view.axes_in_rig[2] @ axis)) for view in placed]
            words = f"Ø{number(dimension.diameter_mm)} {dimension.text}".strip()
            holes[int(np.argmax(np.round(facing, 6))), words].append(dimension)
    for (index, words), group in holes.items():
        _holes(sheet, placed[index], jobs[index], words, group)
    for view, job in zip(placed, jobs, strict=True):
        _draw_tiers(sheet, view.box, job.below, upright=False)
        _draw_tiers(sheet, view.box, job.left, upright=True)
        for aligned in job.askew:
            _draw_aligned(sheet, view, aligned)
        _draw_notes(sheet, view.box, job.notes)


def _overall(placed: Sequence[PlacedView], jobs: Sequence[Annotations]) -> None:
    _, front, right = placed
    for index, view, coordinate in ((1, front, 0), (1, front, 1), (2, right, 0)):
        box = view.box
        words = number(float(np.ptp(view.view.box[:, coordinate])))
        across = np.full(2, box[0, 1 - coordinate])
        (jobs[index].below, jobs[index].left)[coordinate].append(LinearDimension(box[:, coordinate], across, words))


def _length(placed: Sequence[PlacedView], jobs: Sequence[Annotations], dimension: Length) -> None:
    """Place a length in the first view that shows it in full, as an aligned dimension where it is oblique there."""
    span = dimension.span_in_rig
    real = float(np.linalg.norm(span))
    words = f"{number(real)} {dimension.text}".strip()
    depths = [abs(float(view.view.axes_in_rig[2] @ span)) for view in placed]
    index = int(np.argmin(np.round(depths, 3)))
    view, job = placed[index], jobs[index]
    points = view.paper(dimension.points_in_rig)
    across = np.abs(view.view.axes_in_rig[:2] @ span)
    if across[1] <= PARALLEL * real:
        _add(job.below, LinearDimension(points[:, 0], points[:, 1], words))
    elif across[0] <= PARALLEL * real:
        _add(job.left, LinearDimension(points[:, 1], points[:, 0], words))
    else:
        start = dimension.points_in_rig[0]
        job.askew.append(AlignedDimension(view.paper(np.array([start, start + span])), words))


def _add(tier: list[LinearDimension], new: LinearDimension) -> None:
    """Add a dimension unless it is there already; of two equal ones the one with more text stays."""
    for place, old in enumerate(tier):
        if np.abs(np.sort(old.along) - np.sort(new.along)).max() < 1e-3:
            tier[place] = max(old, new, key=lambda linear: len(linear.words))
            return
    tier.append(new)


def _holes(sheet: DrawingSheet, placed: PlacedView, job: Annotations, words: str, group: Sequence[Hole]) -> None:
    """Draw centre marks; note all equal holes once, and dimension them from the part's edge and from each other."""
    centres = placed.paper(np.array([hole.centre_in_rig for hole in group]))
    radius = group[0].diameter_mm / 2.0 * placed.scale
    arms = np.array([(-1.0, 0.0), (1.0, 0.0)]) * (radius + 1.8)
    marks = [centre + turned for centre in centres for turned in (arms, arms[:, ::-1])]
    sheet.lines(marks, 0.13, INK, CENTRE_DASHES_MM)
    count = f"{len(group)}x " if len(group) > 1 else ""
    # The hole whose leader is shortest.
    job.notes.append(Note(centres[np.lexsort((centres[:, 0], -centres[:, 1]))[0]], radius, count + words))
    axis = group[0].axis_in_rig / np.linalg.norm(group[0].axis_in_rig)
    low = placed.box[0]
    for coordinate, tier in ((0, job.below), (1, job.left)):
        if abs(float(placed.view.axes_in_rig[coordinate] @ axis)) > PARALLEL:
            # Distances are foreshortened in an oblique view.
            continue
        places = np.unique(np.round(centres[:, coordinate], 3))
        if len(places) > 4:
            continue
        nearest = [centres[np.abs(centres[:, coordinate] - at) < 1e-2, 1 - coordinate].min() for at in places]
        stops = [(float(low[coordinate]), float(low[1 - coordinate]))]
        stops += [(float(at), float(start)) for at, start in zip(places, nearest, strict=True)]
        for (here, from_here), (there, from_there) in pairwise(stops):
            if there - here < 1e-3:
                continue
            ends = np.array([here, there])
            _add(tier, LinearDimension(ends, np.array([from_here, from_there]), number((there - here) / placed.scale)))


def _draw_tiers(sheet: DrawingSheet, box: FloatArray, linears: Sequence[LinearDimension], *, upright: bool) -> None:
    """Short dimensions next to the part, longer ones outside them: extension lines cross no dimension line."""
    tiers: list[list[tuple[float, float]]] = []
    chosen = []
    for linear in sorted(linears, key=lambda item: (item.span, item.along.min(), item.words)):
        width = text_width_mm(linear.words, TEXT_MM)
        low, high = _covers(linear, width)
        busy = [k for k, tier in enumerate(tiers) if any(low < b + 1.0 and high > a - 1.0 for a, b in tier)]
        level = max(busy) + 1 if busy else 0
        if level == len(tiers):
            tiers.append([])
        tiers[level].append((low, high))
        chosen.append((level, linear, width))
    pitch = min(TIER_PITCH_MM, (TIERS_MM - FIRST_TIER_MM - BESIDE_MM) / max(len(tiers) - 1, 1))
    edge = float(box[0, 0 if upright else 1])
    for level, linear, width in chosen:
        _draw_linear(sheet, linear, edge - FIRST_TIER_MM - level * pitch, width, upright=upright)


def _fits(linear: LinearDimension, width: float) -> bool:
    return linear.span >= width + 2.0 * ARROW_MM[0] + 1.0


def _covers(linear: LinearDimension, width: float) -> tuple[float, float]:
    """The stretch of a tier that a dimension line and its text take up."""
    low, high = float(linear.along.min()), float(linear.along.max())
    return (low, high) if _fits(linear, width) else (low - ARROW_MM[0] - 1.5, high + ARROW_MM[0] + width + 2.0)


def _draw_linear(sheet: DrawingSheet, linear: LinearDimension, tier: float, width: float, *, upright: bool) -> None:
    def on_sheet(points: Sequence[tuple[float, float]]) -> FloatArray:
        array = np.array(points)
        return array[:, ::-1] if upright else array

    order = np.argsort(linear.along)
    (low, high), starts = linear.along[order], linear.across[order]
    lines = [
        on_sheet([(at, start - BESIDE_MM), (at, tier - 1.5)]) for at, start in zip((low, high), starts, strict=True)
    ]
    inside = _fits(linear, width)
    reach = 0.0 if inside else ARROW_MM[0] + 1.5
    end = high + reach + (0.0 if inside else width)
    lines.append(on_sheet([(low - reach, tier), (end, tier)]))
    sheet.lines(lines, LINE_MM)
    sign = -1.0 if inside else 1.0
    for tip, direction in ((low, sign), (high, -sign)):
        sheet.arrow_head(on_sheet([(tip, tier)])[0], on_sheet([(direction, 0.0)])[0])
    middle = (low + high) / 2.0 if inside else high + reach + width / 2.0
    if upright:
        sheet.text((tier - 0.9, middle), linear.words, TEXT_MM, align="center", turn_deg=90.0)
    else:
        sheet.text((middle, tier + 0.9), linear.words, TEXT_MM, align="center")


def _draw_aligned(sheet: DrawingSheet, placed: PlacedView, aligned: AlignedDimension) -> None:
    """Draw an aligned dimension on the side where it crosses fewer edges."""
    start, end = aligned.ends if aligned.ends[1, 0] >= aligned.ends[0, 0] else aligned.ends[::-1]
    along = (end - start) / np.linalg.norm(end - start)
    normal = np.array([-along[1], along[0]])
    edges = MultiLineString([line * placed.scale + placed.shift for line in placed.view.visible])

    def in_the_way(side: float) -> float:
        band = [side * (FIRST_TIER_MM + 2.0 * TEXT_MM) * normal, side * BESIDE_MM * normal]
        return float(
            Polygon([start + band[0], end + band[0], end + band[1], start + band[1]]).intersection(edges).length
        )

    side = min((1.0, -1.0), key=in_the_way)
    out, beside = side * FIRST_TIER_MM * normal, side * BESIDE_MM * normal
    ends = np.array([start + out, end + out])
    over = side * 1.5 * normal
    sheet.lines([ends, *(np.array([at + beside, at + out + over]) for at in (start, end))], LINE_MM)
    sheet.arrow_head(ends[0], -along)
    sheet.arrow_head(ends[1], along)
    angle = float(np.degrees(np.arctan2(along[1], along[0])))
    sheet.text(ends.mean(axis=0) + 0.9 * normal, aligned.words, TEXT_MM, align="center", turn_deg=angle)


def _draw_notes(sheet: DrawingSheet, box: FloatArray, notes: Sequence[Note]) -> None:
    """Draw notes above the view, the rightmost lowest: then no leader crosses text or another leader."""
    pitch = min(WORDS_PITCH_MM, (WORDS_MM - FIRST_WORDS_MM) / max(len(notes) - 1, 1))
    ordered = sorted(notes, key=lambda note: (-(note.point[0] - LEAN * note.point[1]), note.words))
    steep = np.array([LEAN, 1.0]) / np.hypot(LEAN, 1.0)
    for row, note in enumerate(ordered):
        height = float(box[1, 1]) + FIRST_WORDS_MM + row * pitch
        tip = note.point + note.radius * steep
        knee = np.array([tip[0] + LEAN * (height - tip[1]), height])
        width = text_width_mm(note.words, TEXT_MM)
        sheet.lines([np.array([tip, knee, knee + np.array([width + 1.5, 0.0])])], LINE_MM)
        sheet.arrow_head(tip, -steep)
        sheet.text(knee + np.array([1.0, 0.8]), note.words, TEXT_MM)
