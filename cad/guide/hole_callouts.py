"""Holes in a drawing: their callouts and positions.

A callout has a hole's size, its depth in the material or "through", and its purpose. Holes with the same callout are
dimensioned in their view or, if they are many, numbered and listed in a table. Oblique holes have an angle dimension.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from build123d import Part
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector
from OCP.TopAbs import TopAbs_State

from mirrorcam.cad.guide.dimension_lines import LINE_MM, TEXT_MM, LinearDimension, number
from mirrorcam.cad.guide.drawing_sheet import ARROW_MM, INK, DrawingSheet, overlaps, text_width_mm
from mirrorcam.cad.guide.part_views import PartView, PlacedView
from mirrorcam.cad.plan.dimension import DrawingTable, Hole, Length
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM
from mirrorcam.cad.plan.hardware import Fastening
from mirrorcam.core.values import FloatArray

THROUGH = "through"
DEPTH = "↧"
"""Depth symbol (ISO 129-1)."""

PRESS_TOLERANCE = "±0.1"
"""Tolerance of a hole for an insert or a nut: the step between the gauges of the fit coupon, only one of which fits."""

# Distance outside a hole at which its wall is probed, and fraction of its radius and depth at which its floor is
# probed. A conical end is deeper, by up to `CONE_FRACTION` of the radius.
WALL_PROBE_MM = 0.05
FLOOR_FRACTION = 0.9
FLOOR_PROBE_MM = 0.03
CONE_FRACTION = 0.15
# Sizes that differ by less are equal; shorter intervals of material are ignored.
SAME_MM = 1e-3


class Material:
    """Point and line queries for the material of a solid in the rig frame, mm."""

    def __init__(self, solid: Part) -> None:
        shape = solid.wrapped
        self._inside = BRepClass3d_SolidClassifier(shape)
        self._crossings = IntCurvesFace_ShapeIntersector()
        self._crossings.Load(shape, 1e-6)

    def contains(self, point: FloatArray) -> bool:
        """Return whether a point (3,) lies inside the material."""
        self._inside.Perform(gp_Pnt(*point.tolist()), 1e-6)
        return bool(self._inside.State() == TopAbs_State.TopAbs_IN)

    def intervals(self, start: FloatArray, direction: FloatArray, length_mm: float) -> list[tuple[float, float]]:
        """The intervals (from, to) inside the material of a line from a point (3,) along a unit vector (3,)."""
        self._crossings.Perform(gp_Lin(gp_Pnt(*start.tolist()), gp_Dir(*direction.tolist())), 0.0, length_mm)
        crossings = [self._crossings.WParameter(i + 1) for i in range(self._crossings.NbPnt())]
        ends = np.unique(np.round([0.0, *crossings, length_mm], 6))
        return [
            (float(low), float(high))
            for low, high in pairwise(ends)
            if high - low > SAME_MM and self.contains(start + (low + high) / 2.0 * direction)
        ]


def with_callouts(
    holes: Iterable[Hole], solid: Part, screw: Fastening, tolerance: str = PRESS_TOLERANCE
) -> tuple[Hole, ...]:
    """The holes with complete callouts; the axis of a blind hole runs from its open end into the material.

    Parameters
    ----------
    holes : iterable of Hole
        Holes; those without `cut_mm` are returned unchanged.
    solid : Part
        The part, in the rig frame.
    screw : Fastening
        Dimensions that identify holes for inserts, nuts and screws.
    tolerance : str
        Tolerance of holes for inserts and nuts; "" for gauges, whose steps are that tolerance.
    """
    material = Material(solid)
    return tuple(hole if hole.cut_mm is None else _with_callout(hole, material, screw, tolerance) for hole in holes)


def _with_callout(hole: Hole, material: Material, screw: Fastening, tolerance: str) -> Hole:
    axis = hole.axis_in_rig / np.linalg.norm(hole.axis_in_rig)
    assert hole.cut_mm is not None
    if hole.form == "countersink":
        # Its axis already runs from its mouth into the material.
        return hole
    start, end = hole.centre_in_rig, hole.centre_in_rig + hole.cut_mm * axis
    directions = _perpendicular_directions(axis)
    radius = hole.diameter_mm / 2.0

    def floor(end: FloatArray, out: FloatArray) -> bool:
        """Return whether material closes the end of the tool in half of the directions (cuts may be adjacent)."""
        return any(
            sum(material.contains(end + depth * out + FLOOR_FRACTION * radius * side) for side in directions)
            >= len(directions) / 2
            for depth in (FLOOR_PROBE_MM, CONE_FRACTION * radius)
        )

    closed_start = floor(start - OUTSIDE_MM * axis, -axis)
    closed_end = floor(end, axis)
    if closed_start == closed_end:
        return replace(hole, text=_joined(hole.text, THROUGH, _purpose(hole, screw, through=True)))
    # The depth is measured from the closed end along the longest wall.
    origin, outward = (end, -axis) if closed_end else (start - OUTSIDE_MM * axis, axis)
    # One of eight directions is within 22.5 deg of the normal of a slot's side walls.
    probe_radius = (radius + WALL_PROBE_MM) / (np.cos(np.pi / 8.0) if hole.travel_mm else 1.0)
    ends = [
        high
        for side in directions
        for _, high in material.intervals(origin + probe_radius * side, outward, hole.cut_mm)[-1:]
    ]
    deepest = max(ends, default=hole.cut_mm)
    depth_text = f"{DEPTH}{deepest:.2f}".rstrip("0").rstrip(".")
    purpose = _purpose(hole, screw, through=False)
    text = _joined(
        hole.text, tolerance if purpose in (insert_text(screw), nut_text(screw)) else "", depth_text, purpose
    )
    return replace(hole, text=text, centre_in_rig=origin + deepest * outward, axis_in_rig=-outward)


def insert_text(screw: Fastening) -> str:
    """The purpose of a hole for an insert: "for M3 insert"."""
    return f"for {screw.thread} insert"


def nut_text(screw: Fastening) -> str:
    """The purpose of a pocket for a nut: "for M3 nut"."""
    return f"for {screw.thread} nut"


def _perpendicular_directions(axis: FloatArray) -> list[FloatArray]:
    """Eight directions (3,) perpendicular to an axis (3,)."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    angles = np.deg2rad(22.5 + 45.0 * np.arange(8))
    return [np.cos(angle) * first + np.sin(angle) * second for angle in angles]


def _purpose(hole: Hole, screw: Fastening, *, through: bool) -> str:
    def same(size_mm: float) -> bool:
        return abs(hole.diameter_mm - size_mm) < SAME_MM

    if hole.form == "hexagon":
        return nut_text(screw) if same(screw.nut_flats_mm + NUT_FIT_MM) else ""
    if screw.kind == "insert" and not through and same(screw.insert_hole_mm):
        return insert_text(screw)
    return f"for {screw.thread}" if through and same(screw.clearance_hole_mm) else ""


def _joined(*texts: str) -> str:
    return " ".join(text for text in texts if text)


MAX_COORDINATES = 4
"""Largest number of x or y coordinates that are dimensioned; holes with more are listed in a table."""

PARALLEL = 1e-4
AXIS_MM = 0.13
CENTRE_DASHES_MM = (2.0, 0.6, 0.5, 0.6)
VIEWS = ("view from above", "front view", "view from the right")
NUMBER_MM = 2.0
AXIS_END_MM = 3.0
"""Length of the axis of an oblique hole outside the part."""

ARCS_MM = (9.0, 11.0, 13.0, 15.0, 18.0, 21.0, 24.0)
"""Candidate radii of the arc of an angle dimension, in the order of preference."""

Groups = dict[tuple[int, str], list[Hole]]


def hole_groups(views: Sequence[PartView], dimensions: Iterable[Length | Hole]) -> Groups:
    """The holes, grouped by the view that is most parallel to their axes, and by their callout in it."""
    groups: Groups = defaultdict(list)
    for hole in dimensions:
        if isinstance(hole, Hole):
            axis = _unit(hole.axis_in_rig)
            alignments = [abs(float(view.axes_in_rig[2] @ axis)) for view in views]
            index = int(np.argmax(np.round(alignments, 6)))
            groups[index, callout(hole, float(axis @ views[index].axes_in_rig[2]))].append(hole)
    return groups


def callout(hole: Hole, cosine: float) -> str:
    """The text of a hole's callout; `cosine` is the cosine between its axis and the direction to the viewer."""
    size = f"Ø{number(hole.diameter_mm)}"
    if hole.travel_mm:
        size = f"slot {number(hole.diameter_mm)} x {number(hole.diameter_mm + hole.travel_mm)}"
    text = {"hexagon": f"hex {size[1:]} A/F", "countersink": f"countersink {size}"}.get(hole.form, size)
    text = f"{text} {hole.text}"
    blind = hole.cut_mm is not None and (DEPTH in hole.text or hole.form == "countersink")
    return f"{text.strip()} (far side)" if blind and cosine > 0.5 else text.strip()


def in_table(holes: Sequence[Hole], view: PartView) -> bool:
    """Return whether holes with one callout have too many coordinates for dimensions, in a view along their axis."""
    if abs(float(view.axes_in_rig[2] @ _unit(holes[0].axis_in_rig))) < 1.0 - PARALLEL:
        return False
    points = np.array([hole.centre_in_rig for hole in holes]) @ view.axes_in_rig[:2].T
    return any(len(np.unique(np.round(points[:, axis], 3))) > MAX_COORDINATES for axis in (0, 1))


def numbered(holes: Sequence[Hole], view: PartView) -> list[Hole]:
    """Holes in the order of their numbers from 1: from top to bottom in the view, and from left to right."""
    points = np.array([hole.centre_in_rig for hole in holes]) @ view.axes_in_rig[:2].T
    return [holes[index] for index in np.lexsort((np.round(points[:, 0], 3), -np.round(points[:, 1], 3)))]


def hole_tables(groups: Groups, views: Sequence[PartView]) -> tuple[DrawingTable, ...]:
    """A table of positions for every callout with too many coordinates for dimensions."""
    tables = []
    for (index, text), holes in groups.items():
        view = views[index]
        if not in_table(holes, view):
            continue
        origin, origin_name = view.box[0], "the lower left corner of that view"
        if (datum := holes[0].datum) is not None:
            origin, origin_name = view.axes_in_rig[:2] @ datum.point_in_rig, datum.name
        rows = []
        for row, hole in enumerate(numbered(holes, view), start=1):
            x, y = view.axes_in_rig[:2] @ hole.centre_in_rig - origin
            rows.append((str(row), f"{x:.2f}", f"{y:.2f}"))
        title = f"Holes {text.split()[0]}"
        tables.append(DrawingTable(title, ("no.", "x", "y"), tuple(rows), (f"{VIEWS[index]}, mm from", origin_name)))
    return tuple(tables)


def draw_numbers(sheet: DrawingSheet, placed: PlacedView, holes: Sequence[Hole]) -> None:
    """Draw the number of each hole of a table at its lower right, since leaders come from above."""
    for row, hole in enumerate(numbered(holes, placed.view), start=1):
        offset = hole.diameter_mm / 2.0 * placed.scale * 0.71 + 0.8
        corner = placed.paper(hole.centre_in_rig) + np.array([offset, -offset - NUMBER_MM])
        sheet.text((float(corner[0]), float(corner[1])), str(row), NUMBER_MM, over_lines=True)


def oblique_holes(groups: Groups, views: Sequence[PartView], lengths: Iterable[Length]) -> list[tuple[int, Hole]]:
    """Holes that are oblique to all views, with the index of the view parallel to their axes.

    Two lengths to points of an axis locate a hole. Of holes whose axes coincide in that view, a blind one is preferred.
    """
    ends = np.vstack([np.zeros((0, 3)), *(length.points_in_rig for length in lengths)])
    oblique: dict[tuple[float, ...], tuple[int, Hole]] = {}
    for hole in (hole for holes in groups.values() for hole in holes):
        axis = _unit(hole.axis_in_rig)
        alignments = np.abs([float(view.axes_in_rig[2] @ axis) for view in views])
        if alignments.max() > 1.0 - PARALLEL or alignments.min() > PARALLEL:
            continue
        index = int(alignments.argmin())
        axes = views[index].axes_in_rig[:2]
        normal = np.array([-(axes[1] @ axis), axes[0] @ axis])
        offset = float(normal @ axes @ hole.centre_in_rig)
        if (np.abs(ends @ axes.T @ normal - offset) < 1e-2).sum() > 1:
            continue
        key = (index, *np.round([*np.abs(normal), offset], 2).tolist())
        if key not in oblique or DEPTH in hole.text:
            oblique[key] = (index, hole)
    return list(oblique.values())


def oblique_lengths(placed: PlacedView, hole: Hole) -> tuple[LinearDimension, LinearDimension]:
    """Dimensions from the left and lower edges of a view to the centre of an oblique hole's mouth."""
    point, low = placed.paper(hole.centre_in_rig), placed.box[0]
    horizontal, vertical = (
        LinearDimension(
            np.array([low[k], point[k]]),
            np.array([low[1 - k], point[1 - k]]),
            number(float(point[k] - low[k]) / placed.scale),
        )
        for k in (0, 1)
    )
    return horizontal, vertical


@dataclass(frozen=True)
class _Angle:
    """The angle at a point (2,) of the sheet from an axis of the view to the axis of an oblique hole."""

    point: FloatArray
    reference_deg: float
    axis_deg: float

    @property
    def size_deg(self) -> float:
        return abs(self.axis_deg - self.reference_deg)

    def at(self, radius: float, fraction: float) -> FloatArray:
        """The point (2,) at a radius, from the reference (0) to the hole's axis (1)."""
        radians = np.radians(self.reference_deg + fraction * (self.axis_deg - self.reference_deg))
        return self.point + radius * np.array([np.cos(radians), np.sin(radians)])

    def text_centre(self, arc_mm: float, width: float) -> FloatArray:
        """The centre (2,) of a text outside the middle of an arc."""
        along = np.abs(self.at(1.0, 0.5) - self.point) @ np.array([width, TEXT_MM]) / 2.0
        return self.at(arc_mm + 1.8 + float(along), 0.5)


def _angle_of(placed: PlacedView, hole: Hole) -> _Angle:
    """The angle of an oblique hole to the nearer axis of a view, outside the part."""
    outward = -(placed.view.axes_in_rig[:2] @ _unit(hole.axis_in_rig))
    angle_deg = float(np.degrees(np.arctan2(outward[1], outward[0])))
    horizontal = float(np.copysign(180.0, angle_deg)) if outward[0] < 0.0 else 0.0
    reference = horizontal if abs(angle_deg - horizontal) < 45.0 + PARALLEL else float(np.copysign(90.0, angle_deg))
    return _Angle(placed.paper(hole.centre_in_rig), reference, angle_deg)


def draw_oblique(sheet: DrawingSheet, placed: PlacedView, holes: Iterable[Hole]) -> None:
    """Draw the axes of oblique holes in a view parallel to them, and their angles to the nearer axis of the view.

    Parallel holes share an angle dimension, at the hole and with the arc that keep its text and its arrows clear.
    """
    parallel: dict[float, list[_Angle]] = defaultdict(list)
    for hole in holes:
        angle = _angle_of(placed, hole)
        parallel[round(angle.axis_deg % 180.0, 2)].append(angle)
        ends = [angle.at(radius, 1.0) for radius in (-hole.diameter_mm * placed.scale, AXIS_END_MM)]
        sheet.lines([np.array(ends)], AXIS_MM, INK, CENTRE_DASHES_MM)
    for angles in parallel.values():
        count = f"{len(angles)}x " if len(angles) > 1 else ""
        _draw_angle(sheet, angles, f"{count}{number(angles[0].size_deg)}°")


def _draw_angle(sheet: DrawingSheet, angles: Sequence[_Angle], text: str) -> None:
    width = text_width_mm(text, TEXT_MM)
    texts, lines = sheet.occupied()

    def cost(place: tuple[_Angle, float]) -> tuple[int, ...]:
        angle, arc_mm = place
        centre, margin = angle.text_centre(arc_mm, width), np.array([width / 2.0 + 0.5, TEXT_MM])
        area = shapely.box(*(centre - margin), *(centre + margin))
        return *overlaps(area, texts, lines), arc_mm * np.radians(angle.size_deg) < 2.0 * ARROW_MM[0] + 1.0

    angle, arc_mm = min(((angle, arc_mm) for arc_mm in ARCS_MM for angle in angles), key=cost)
    sheet.lines([np.array([angle.at(AXIS_END_MM, 1.0), angle.at(arc_mm + 1.2, 1.0)])], AXIS_MM, INK, CENTRE_DASHES_MM)
    arc = np.array([angle.at(arc_mm, fraction) for fraction in np.linspace(0.0, 1.0, 25)])
    sheet.lines([np.array([angle.at(1.0, 0.0), angle.at(arc_mm + 1.2, 0.0)]), arc], LINE_MM)
    for tip, beside in ((arc[0], arc[1]), (arc[-1], arc[-2])):
        sheet.arrow_head(tip, tip - beside)
    sheet.text(angle.text_centre(arc_mm, width) - (0.0, TEXT_MM / 2.0), text, TEXT_MM, align="center")


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
