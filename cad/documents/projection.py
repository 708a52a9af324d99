"""Views of a part: the edges that one sees and those that are hidden, as polylines to scale."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from build123d import Edge, GeomType, Part
from shapely import LineString, MultiLineString

from optics.values import FloatArray

CURVE_STEPS = 32
# On paper, in mm: a hidden line that runs along a visible one says nothing, and one shorter than two dashes (the step
# of a fit behind a rim) reads as dirt.
ALONG_VISIBLE_MM = 0.12
SHORTEST_HIDDEN_MM = 1.6

# Rows right, up and towards the viewer, in the axes of the part as printed. Third angle: the view from above lies
# above the front view, the one from the right to its right.
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
class View:
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
class Placed:
    """A view on the sheet: paper = scale * view + shift."""

    view: View
    scale: float
    shift: FloatArray

    @property
    def box(self) -> FloatArray:
        """Lowest and highest corner (2, 2) on paper."""
        return self.view.box * self.scale + self.shift

    def paper(self, points_in_rig: FloatArray) -> FloatArray:
        """Where points (..., 3) are on paper (..., 2)."""
        return points_in_rig @ self.view.axes_in_rig[:2].T * self.scale + self.shift


def project(solid: Part, axes_in_rig: FloatArray) -> View:
    """See a solid from far away, from the third row of `axes_in_rig`, by the kernel's hidden-line algorithm."""
    _, up, towards = axes_in_rig
    visible, hidden = solid.project_to_viewport(tuple(1e4 * towards), tuple(up), (0.0, 0.0, 0.0))
    return View(axes_in_rig, tuple(_polylines(visible)), tuple(_polylines(hidden)))


def _polylines(edges: Iterable[Edge]) -> list[FloatArray]:
    lines = []
    for edge in edges:
        steps = np.linspace(0.0, 1.0, 2 if edge.geom_type == GeomType.LINE else CURVE_STEPS + 1)
        lines.append(np.array([tuple(edge @ step)[:2] for step in steps]))
    return lines


def on_paper(view: View, scale: float) -> tuple[list[FloatArray], list[FloatArray]]:
    """Visible and hidden polylines (n, 2) in mm of paper, each drawn once, without what is too small to be read."""
    visible = _joined(view.visible, scale)
    hidden = _joined(view.hidden, scale).difference(visible.buffer(ALONG_VISIBLE_MM, quad_segs=2))
    lines = [line for line in _lines(shapely.line_merge(hidden)) if line.length >= SHORTEST_HIDDEN_MM]
    return [np.array(line.coords) for line in _lines(visible)], [np.array(line.coords) for line in lines]


def _joined(lines: Sequence[FloatArray], scale: float) -> MultiLineString:
    strings = [LineString(line * scale) for line in lines if np.ptp(line, axis=0).max() * scale > 1e-4]
    merged = shapely.line_merge(shapely.unary_union(strings, grid_size=1e-4))
    return MultiLineString(_lines(merged))


def _lines(geometry: shapely.Geometry) -> list[LineString]:
    parts = shapely.get_parts(geometry)
    return [part for part in parts if isinstance(part, LineString) and not part.is_empty]
