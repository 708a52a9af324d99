"""Sections: a part cut by a plane, the view behind the plane, and the hatched faces of the cut (ISO 128)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from build123d import Compound, Face, GeomType, Keep, Part, Plane
from shapely import LineString, MultiLineString, Polygon

from mirrorcam.cad.guide.drawing_sheet import FIELD_MM, INK, DrawingSheet, overlaps
from mirrorcam.cad.guide.hole_callouts import DEPTH
from mirrorcam.cad.guide.part_views import FRONT, RIGHT, TOP, PartView, PlacedView, polylines, project
from mirrorcam.cad.parts.dust_cover import CoverPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.dimension import Hole
from mirrorcam.core.values import FloatArray

HATCH_MM, HATCH_LINE_MM = 2.0, 0.12
CUTTING_LINE_MM, CUTTING_LINE_END_MM = 0.18, 0.5
CUTTING_LINE_DASHES_MM = (6.0, 0.8, 0.8, 0.8)
EXTENSIONS_MM = (4.0, 7.0, 10.0, 13.0, 16.0, 20.0, 24.0, 28.0)
"""Candidate extensions of a cutting-plane line beyond its view, in the order of preference."""

LETTER_MM = 3.5
ON_PLANE_MM = 1e-4
# Weight of blind holes in the choice of a plane, relative to through holes.
BLIND_WEIGHT = 10
# The view's axes, by the axis of the bed that is normal to the plane.
AXES = (RIGHT, FRONT, TOP)


@dataclass(frozen=True)
class Section:
    """A part cut normal to an `axis` of the bed at `position_mm`; the view, and the hatched faces in it, mm."""

    axis: int
    position_mm: float
    view: PartView
    faces: tuple[Polygon, ...]


def section_plane(plan: Any, holes: Sequence[Hole], bed_from_rig: FloatArray) -> tuple[int, float] | None:
    """The plane that shows the cavities of a part: its normal, as an axis of the bed, and its coordinate, mm.

    A mount and a cover are cut through their centre planes, other parts through the axes of as many holes as possible,
    with preference for blind ones. None for a part without holes. `bed_from_rig` is a rotation (3, 3).
    """
    if isinstance(plan, MountPlan):
        return 2, float(bed_from_rig[2] @ plan.slide)
    if isinstance(plan, CoverPlan):
        return 0, float(bed_from_rig[0] @ plan.rig_from_front[:3, 3])
    scores: Counter[tuple[int, float]] = Counter()
    for key, hole in {_axis_of(hole): hole for hole in holes}.items():
        axis = bed_from_rig @ hole.axis_in_rig
        for normal in range(3):
            if abs(axis[normal]) < 1e-6:
                position = round(float(bed_from_rig[normal] @ np.array(key[:3])), 3)
                scores[normal, position] += BLIND_WEIGHT if DEPTH in hole.text else 1
    return min(scores, key=lambda plane: (-scores[plane], plane)) if scores else None


def _axis_of(hole: Hole) -> tuple[float, ...]:
    """A hole's axis as its point nearest to the origin and its unsigned direction: equal for coaxial holes."""
    axis = hole.axis_in_rig / np.linalg.norm(hole.axis_in_rig)
    axis = axis * np.sign(axis[np.abs(axis).argmax()])
    foot = hole.centre_in_rig - axis * (hole.centre_in_rig @ axis)
    return tuple(np.round(np.concatenate([foot, axis]), 3).tolist())


def cut(solid: Part, axis: int, position_mm: float, bed_from_rig: FloatArray) -> Section | None:
    """Cut a solid and view the part behind the plane; None if the plane misses it."""
    axes = AXES[axis] @ bed_from_rig
    to_viewer = axes[2]
    normal_in_rig = bed_from_rig[axis]
    origin = position_mm * normal_in_rig
    rear = solid.split(Plane(origin=tuple(origin), z_dir=tuple(to_viewer)), keep=Keep.BOTTOM)
    pieces = rear if isinstance(rear, list) else [rear]
    solids = [body for piece in pieces if piece is not None for body in piece.solids()]
    offset_mm = float(origin @ to_viewer)
    faces = areas_of((face for body in solids for face in body.faces() if _lies_on(face, to_viewer, offset_mm)), axes)
    if not faces:
        return None
    view = project(Part(Compound(children=solids).wrapped), axes, with_hidden=False)
    return Section(axis, position_mm, view, faces)


def _lies_on(face: Face, normal: FloatArray, offset_mm: float) -> bool:
    if face.geom_type != GeomType.PLANE:
        return False
    return all(abs(np.array(tuple(corner)) @ normal - offset_mm) < ON_PLANE_MM for corner in face.vertices())


def areas_of(faces: Iterable[Face], axes: FloatArray) -> tuple[Polygon, ...]:
    """The areas of faces of the cut in the view, in the order of their corners: the kernel's varies between runs."""
    areas: list[Polygon] = []
    for face in faces:
        lines = [line @ axes[:2].T for line in polylines(face.edges())]
        # Merge coincident ends to 1e-4.
        strings = shapely.set_precision(MultiLineString([LineString(line) for line in lines]), 1e-4)
        area = shapely.normalize(shapely.build_area(shapely.unary_union(strings)))
        areas += [part for part in shapely.get_parts(area) if isinstance(part, Polygon)]
    return tuple(sorted(areas, key=lambda area: tuple(shapely.get_coordinates(area).ravel())))


def hatch(sheet: DrawingSheet, faces: Sequence[Polygon], scale: float, shift: FloatArray) -> None:
    """Hatch the faces of a cut at 45 deg, with all lines on one grid."""
    lines: list[FloatArray] = []
    for face in faces:
        area = shapely.transform(face, lambda corners: corners * scale + shift)
        low_x, low_y, high_x, high_y = area.bounds
        step = HATCH_MM * np.sqrt(2.0)
        for level in np.arange(np.ceil((low_y - high_x) / step), (high_y - low_x) / step) * step:
            line = LineString([(low_x, low_x + level), (high_x, high_x + level)])
            parts = shapely.get_parts(area.intersection(line))
            lines += [np.array(part.coords) for part in parts if isinstance(part, LineString) and part.length > 0.2]
    sheet.lines(lines, HATCH_LINE_MM, INK)


@dataclass(frozen=True)
class CuttingPlaneLine:
    """The cutting-plane line of a section in a view: ends (2, 2) on paper, and the viewing direction `arrow` (2,)."""

    ends: FloatArray
    arrow: FloatArray

    @property
    def constant_axis(self) -> int:
        """The coordinate, x (0) or y (1), that is constant along the line."""
        return int(np.argmin(np.abs(self.ends[1] - self.ends[0])))

    @property
    def arrow_starts(self) -> FloatArray:
        """The points (2, 2) where the arrows start."""
        inward = (self.ends[1] - self.ends[0]) / np.linalg.norm(self.ends[1] - self.ends[0])
        return self.ends + 1.2 * np.array([inward, -inward])

    @property
    def marks(self) -> tuple[Polygon, ...]:
        """The areas of the letters and arrows at both ends."""
        return tuple(
            LineString([start - (2.6 + LETTER_MM / 2.0) * self.arrow, start + 6.0 * self.arrow]).buffer(
                0.75 * LETTER_MM + 0.3
            )
            for start in self.arrow_starts
        )

    def extended(self, lengths_mm: tuple[float, float]) -> CuttingPlaneLine:
        """The line, extended by a length at each end."""
        direction = (self.ends[1] - self.ends[0]) / np.linalg.norm(self.ends[1] - self.ends[0])
        return replace(self, ends=self.ends + np.array([-direction, direction]) * np.array(lengths_mm)[:, None])


def cutting_plane_line(parent: PlacedView, section: Section, bed_from_rig: FloatArray) -> CuttingPlaneLine | None:
    """The cutting-plane line of a section in a view; None if the view does not show the plane edge-on."""
    axes, box = parent.view.axes_in_rig, parent.box
    normal = bed_from_rig[section.axis]
    in_view = axes[:2] @ normal
    if np.abs(in_view).max() < 0.5:
        return None
    constant_axis = int(np.argmax(np.abs(in_view)))
    arrow = np.zeros(2)
    arrow[constant_axis] = np.sign(axes[constant_axis] @ -(AXES[section.axis] @ bed_from_rig)[2])
    ends = np.empty((2, 2))
    ends[:, constant_axis] = section.position_mm * in_view[constant_axis] * parent.scale + parent.shift[constant_axis]
    ends[:, 1 - constant_axis] = box[:, 1 - constant_axis]
    return CuttingPlaneLine(ends, arrow)


def draw_cutting_plane_line(sheet: DrawingSheet, candidates: Sequence[CuttingPlaneLine], letter: str) -> None:
    """Draw the cutting-plane line that overlaps least with the sheet: line, thick ends, arrows and letters.

    Each end extends beyond the view until arrow and letter are clear.
    """
    boxes, drawn = sheet.occupied()

    def overlaps_of(line: CuttingPlaneLine, end: int) -> tuple[int, ...]:
        # The line itself may cross the view and its dimensions, but no text.
        mark = line.marks[end]
        covered = shapely.union_all([mark, LineString([line.ends.mean(axis=0), line.ends[end]])])
        return *overlaps(covered, boxes), *overlaps(mark, drawn)

    extended = []
    for line in candidates:
        costs = [
            min(
                (*overlaps_of(line.extended((extension, extension)), end), extension)
                for extension in EXTENSIONS_MM
                if _is_on_sheet(line, extension)
            )
            for end in (0, 1)
        ]
        extended.append((np.sum(costs, axis=0).tolist(), line.extended((costs[0][2], costs[1][2]))))
    _, line = min(extended, key=lambda candidate: candidate[0])
    sheet.lines([line.ends], CUTTING_LINE_MM, INK, CUTTING_LINE_DASHES_MM)
    for end, start in zip(line.ends, line.arrow_starts, strict=True):
        sheet.lines([np.array([end, end + 2.5 * (start - end)])], CUTTING_LINE_END_MM)
        tip = start + 6.0 * line.arrow
        sheet.lines([np.array([start, tip])], CUTTING_LINE_MM)
        sheet.arrow_head(tip, line.arrow)
        centre = start - 2.6 * line.arrow
        sheet.text((centre[0], centre[1] - LETTER_MM / 2.0), letter, LETTER_MM, align="center", bold=True)


def _is_on_sheet(line: CuttingPlaneLine, extension_mm: float) -> bool:
    """Return whether the marks of a line, extended beyond its view, are in the drawing field."""
    low, high = FIELD_MM
    bounds = np.array([mark.bounds for mark in line.extended((extension_mm, extension_mm)).marks])
    return extension_mm == EXTENSIONS_MM[0] or bool((bounds[:, :2] > low).all() and (bounds[:, 2:] < high).all())
