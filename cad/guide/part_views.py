"""Orthographic views of a part: visible and hidden edges as polylines, to scale."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from build123d import Edge, Part
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.GeomAbs import GeomAbs_CurveType
from shapely import LineString, MultiLineString, STRtree

from mirrorcam.core.values import FloatArray

CURVE_STEPS = 32
# On paper: hidden lines closer than this to visible ones, and those shorter than two dashes (the step of a fit behind a
# rim), are omitted.
OVERLAP_MM = 0.12
MIN_HIDDEN_MM = 1.6
# Largest ratio of the total lengths of hidden and visible lines in a view.
MAX_HIDDEN_RATIO = 2.5

# Rows right, up and towards the viewer, in the part's axes on the bed. Third angle: the view from above is above the
# front view, the view from the right is to its right.
TOP = np.eye(3)
FRONT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
RIGHT = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
ISOMETRIC = np.array(
    [
        [1.0 / np.sqrt(2.0), 1.0 / np.sqrt(2.0), 0.0],
        [-1.0 / np.sqrt(6.0), 1.0 / np.sqrt(6.0), 2.0 / np.sqrt(6.0)],
        [1.0 / np.sqrt(3.0), -1.0 / np.sqrt(3.0), 1.0 / np.sqrt(3.0)],
    ]
)


@dataclass(frozen=True)
class PartView:
    """Polylines (n, 2), mm, of a view: right and up along the first rows of `axes_in_rig` (3, 3)."""

    axes_in_rig: FloatArray
    visible: tuple[FloatArray, ...]
    hidden: tuple[FloatArray, ...]

    @property
    def box(self) -> FloatArray:
        """Lowest and highest corner (2, 2)."""
        corners = np.concatenate([*self.visible, *self.hidden])
        return np.array([corners.min(axis=0), corners.max(axis=0)])


@dataclass(frozen=True)
class PlacedView:
    """A view on the drawing sheet: paper = scale * view + shift."""

    view: PartView
    scale: float
    shift: FloatArray

    @property
    def box(self) -> FloatArray:
        """Lowest and highest corner (2, 2) on paper."""
        return self.view.box * self.scale + self.shift

    def paper(self, points_in_rig: FloatArray) -> FloatArray:
        """Positions (..., 2) on paper, mm, of points (..., 3)."""
        return points_in_rig @ self.view.axes_in_rig[:2].T * self.scale + self.shift


def project(solid: Part, axes_in_rig: FloatArray, *, with_hidden: bool = True) -> PartView:
    """Project a solid along the third row of `axes_in_rig` by the kernel's hidden-line algorithm."""
    _, up, towards = axes_in_rig
    visible, hidden = solid.project_to_viewport(tuple(1e4 * towards), tuple(up), (0.0, 0.0, 0.0))
    return PartView(axes_in_rig, tuple(_flat(visible)), tuple(_flat(hidden) if with_hidden else ()))


def _flat(edges: Iterable[Edge]) -> list[FloatArray]:
    return [line[:, :2] for line in polylines(edges)]


def polylines(edges: Iterable[Edge]) -> list[FloatArray]:
    """Edges as polylines (n, 3), mm."""
    lines = []
    for edge in edges:
        # build123d's method takes ten times as long, for thousands of edges.
        curve = BRepAdaptor_Curve(edge.wrapped)
        count = 2 if curve.GetType() == GeomAbs_CurveType.GeomAbs_Line else CURVE_STEPS + 1
        points = [curve.Value(step) for step in np.linspace(curve.FirstParameter(), curve.LastParameter(), count)]
        lines.append(np.array([(point.X(), point.Y(), point.Z()) for point in points]))
    return lines


def on_paper(view: PartView, scale: float) -> tuple[list[FloatArray], list[FloatArray]]:
    """Visible and hidden polylines (n, 2) on paper, mm, without duplicates and illegibly small details.

    All hidden lines are omitted if they are too many to be legible.
    """
    visible = _merged(view.visible, scale)
    hidden = _merged(view.hidden, scale)
    if hidden.length > MAX_HIDDEN_RATIO * visible.length:
        return [np.array(line.coords) for line in visible.geoms], []
    merged = shapely.line_merge(MultiLineString(_without_overlaps(visible, hidden)))
    lines = [line for line in _lines(merged) if line.length >= MIN_HIDDEN_MM]
    return [np.array(line.coords) for line in visible.geoms], [np.array(line.coords) for line in lines]


def _without_overlaps(visible: MultiLineString, hidden: MultiLineString) -> list[LineString]:
    """Hidden lines without the parts that coincide with visible ones."""
    zones = shapely.buffer(np.array(visible.geoms), OVERLAP_MM, quad_segs=2)
    tree = STRtree(zones)
    remaining = []
    for line in hidden.geoms:
        near = tree.query(line, predicate="intersects")
        remaining += _lines(line.difference(shapely.union_all(zones[np.sort(near)])) if len(near) else line)
    return remaining


def _merged(lines: Sequence[FloatArray], scale: float) -> MultiLineString:
    strings = [LineString(line * scale) for line in lines if np.ptp(line, axis=0).max() * scale > 1e-4]
    merged = shapely.line_merge(shapely.unary_union(strings, grid_size=1e-4))
    return MultiLineString(_lines(merged))


def _lines(geometry: shapely.Geometry) -> list[LineString]:
    parts = shapely.get_parts(geometry)
    return [part for part in parts if isinstance(part, LineString) and not part.is_empty]
