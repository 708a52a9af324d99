"""The mark of a printed part: number, revision and date, engraved into a free outer face."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import manifold3d
import numpy as np
import shapely
import trimesh
from build123d import Face, GeomType, Part, Polyline, Shape, Shell, Solid, Wire
from shapely import Polygon
from shapely.geometry.polygon import orient

from mirrorcam.cad.plan.part_plan import NamedFace
from mirrorcam.cad.plan.stroke_font import STROKES
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import transform

DEPTH_MM, STROKE_MM, SIDE_DEG = 0.4, 1.0, 48.0
"""Grooves two layers deep, two lines wide at the face, with sides inclined enough to print without support."""

UNIT_MM = 2.0
"""Half the height of a glyph: ridges between strokes are then two lines wide."""

GAP, LINE = 0.95, 3.2
"""Spacing of glyphs and of lines, in units of half a glyph's height."""

# Distance of the mark from the edges of its face, and thickness of the material behind it.
EDGE_MM, BACKING_MM = 1.5, 1.19
# Free distance in front of a mark, for it to be readable; both are checked from this distance to the face on.
CLEAR_VIEW_MM, SURFACE_MM = 25.0, 1e-3
# Spacing of the candidate positions, and the maximum number that are checked on a face.
SEARCH_STEP_MM, MAX_POSITIONS = 1.0, 8
# Tolerances: the part's extent in front of an outer face, and 1 - cosine of the angle to a named plane.
OUTER_MM, PARALLEL = 1e-3, 1e-4
# Minimum z of a face's normal on the bed: the first layers squeeze faces on the bed, and overhangs need support.
MIN_NORMAL_Z = -0.2


@dataclass(frozen=True)
class Mark:
    """Outlines of glyphs (with holes) in the plane of a frame (4, 4) in the rig frame, mm, with z out of the part."""

    outlines: tuple[Polygon, ...]
    rig_from_face: FloatArray


def plan_mark(
    solid: Shape[Any], lines: Sequence[str], up: FloatArray, unmarked: Sequence[NamedFace] = ()
) -> Mark | None:
    """Find a position on a part for as many lines of a mark as fit; None if none fits, or the mesh is invalid.

    Parameters
    ----------
    solid : Shape
        The part, in the rig frame, mm.
    lines : sequence of str
        Digits, letters a to f, M, C and "-".
    up : (3,)
        Upward direction in the print orientation, in the rig frame.
    unmarked : sequence of NamedFace
        Faces that must not be marked.
    """
    points, triangles = solid.tessellate(0.05, 0.35)
    mesh = trimesh.Trimesh(np.array([tuple(point) for point in points]), np.array(triangles))
    corners = np.asarray(mesh.vertices)
    body = manifold3d.Manifold(manifold3d.Mesh64(corners, np.array(mesh.faces, dtype=np.uint64)))
    if body.is_empty():
        return None
    faces = [face for face in solid.faces() if face.geom_type == GeomType.PLANE and _is_free(face, up, unmarked)]
    # Outer faces first, then the largest.
    faces.sort(key=lambda face: (_extent_in_front_mm(face, corners) > OUTER_MM, -round(face.area, 3)))
    loops_of = cache(lambda number: _loops(faces[number]))
    for count in range(len(lines), 0, -1):
        outlines = glyph_outlines(lines[:count])
        left, low, right, high = shapely.union_all(list(outlines)).bounds
        half = np.array([right - left, high - low]) / 2.0 + EDGE_MM
        for number, face in enumerate(faces):
            if face.area < 4.0 * half.prod():
                continue
            frame = _frame(face, up)
            for oriented in (frame, _quarter_turned(frame)):
                if (shift := _position(loops_of(number), oriented, half, body)) is not None:
                    shifted = tuple(shapely.affinity.translate(outline, *shift) for outline in outlines)
                    return Mark(shifted, oriented)
    return None


def engraved(solid: Part, mark: Mark) -> Part:
    """The part with a mark cut into it."""
    cut = solid - [_groove(outline, mark.rig_from_face) for outline in mark.outlines]
    cut.label = solid.label
    return cut


def _groove(outline: Polygon, rig_from_face: FloatArray) -> Solid:
    """The solid of a glyph's groove: its outline in the face, narrower at the bottom; all faces are flat."""
    inset = DEPTH_MM * np.tan(np.deg2rad(SIDE_DEG))
    rings = [np.array(ring.coords[:-1]) for ring in (orient(outline).exterior, *orient(outline).interiors)]
    tops = [transform(rig_from_face, np.insert(ring, 2, 0.0, axis=1)) for ring in rings]
    bottoms = [transform(rig_from_face, np.insert(_offset(ring, inset), 2, -DEPTH_MM, axis=1)) for ring in rings]
    sides = [
        _face([np.array([top[i - 1], top[i], bottom[i], bottom[i - 1]])])
        for top, bottom in zip(tops, bottoms, strict=True)
        for i in range(len(top))
    ]
    return Solid(Shell([_face(tops), _face(bottoms), *sides]))


def _offset(ring: FloatArray, distance_mm: float) -> FloatArray:
    """A ring (n, 2) with its inside to the left, offset to the left with mitred corners."""
    edges = np.roll(ring, -1, axis=0) - ring
    left = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    previous = np.roll(left, 1, axis=0)
    return np.asarray(ring + distance_mm * (left + previous) / (1.0 + (left * previous).sum(axis=1))[:, None])


def _face(rings: Sequence[FloatArray]) -> Face:
    """A flat face from its outer ring (n, 3) and its holes."""
    outer, *holes = (Wire(Polyline(*(tuple(point) for point in ring), close=True).edges()) for ring in rings)
    return Face(outer, holes)


def glyph_outlines(lines: Sequence[str]) -> tuple[Polygon, ...]:
    """The outlines of the glyphs of lines of text, mm, centred on the origin."""
    strokes: list[FloatArray] = []
    for row, line in enumerate(lines):
        x = 0.0
        for letter in line:
            glyph = [np.array(stroke, dtype=np.float64) for stroke in STROKES[letter.replace("C", "c")]]
            low = min(stroke[:, 0].min() for stroke in glyph)
            strokes += [stroke + np.array([x - low, -row * LINE]) for stroke in glyph]
            x += max(stroke[:, 0].max() for stroke in glyph) - low + GAP
    corners = np.vstack(strokes)
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    outlines = [
        shapely.LineString(UNIT_MM * (stroke - centre)).buffer(STROKE_MM / 2.0, cap_style="square", join_style="mitre")
        for stroke in strokes
    ]
    return tuple(shapely.get_parts(shapely.union_all(outlines)))


def _extent_in_front_mm(face: Face, corners: FloatArray) -> float:
    """Extent of a part, given by its corners (n, 3), in front of the plane of a face, mm."""
    return float(((corners - np.array(tuple(face.center()))) @ np.array(tuple(face.normal_at()))).max())


def _is_free(face: Face, up: FloatArray, unmarked: Sequence[NamedFace]) -> bool:
    """Return whether a face may be marked: it neither faces the bed nor lies in the plane of an unmarked face."""
    normal, point = np.array(tuple(face.normal_at())), np.array(tuple(face.center()))
    if normal @ up < MIN_NORMAL_Z:
        return False
    return not any(
        abs(plane.normal @ normal) > 1.0 - PARALLEL and abs((plane.point - point) @ normal) < OUTER_MM + 0.05
        for plane in unmarked
    )


def _frame(face: Face, up: FloatArray) -> FloatArray:
    """A frame (4, 4) of a face, z out of it; y is as upright on the bed as possible, unless the face is level."""
    normal = np.array(tuple(face.normal_at()))
    upright = up if abs(up @ normal) < 0.9 else np.eye(3)[int(np.argmin(np.abs(normal)))]
    y = upright - (upright @ normal) * normal
    y /= np.linalg.norm(y)
    frame = np.eye(4)
    frame[:3] = np.column_stack([np.cross(y, normal), y, normal, np.array(tuple(face.center()))])
    return frame


def _quarter_turned(frame: FloatArray) -> FloatArray:
    rotated = frame.copy()
    rotated[:3, 0], rotated[:3, 1] = frame[:3, 1], -frame[:3, 0]
    return rotated


def _position(
    loops: Sequence[FloatArray], frame: FloatArray, half: FloatArray, body: manifold3d.Manifold
) -> tuple[float, float] | None:
    """The centre of a box of half sides (2,), mm, backed by material, as far from a face's edge as possible."""
    outer, *holes = ((loop - frame[:3, 3]) @ frame[:3, :2] for loop in loops)
    area = Polygon(outer, holes).buffer(0.0)
    x0, y0, x1, y1 = area.bounds
    if x1 - x0 < 2.0 * half[0] or y1 - y0 < 2.0 * half[1]:
        return None
    grid_axes = (np.arange(a + h, b - h + 1e-9, SEARCH_STEP_MM) for a, b, h in ((x0, x1, half[0]), (y0, y1, half[1])))
    centres = np.stack(np.meshgrid(*grid_axes), axis=-1).reshape(-1, 2)
    boxes = shapely.box(*(centres - half).T, *(centres + half).T)
    shapely.prepare(area)
    centres = centres[shapely.covers(area, boxes)]
    if len(centres) == 0:
        return None
    distances = shapely.distance(shapely.points(centres), area.exterior)
    for centre in centres[np.argsort(-np.round(distances, 3), kind="stable")][:MAX_POSITIONS]:
        if _is_backed(frame, centre, half, body):
            return float(centre[0]), float(centre[1])
    return None


def _is_backed(frame: FloatArray, centre: FloatArray, half: FloatArray, body: manifold3d.Manifold) -> bool:
    """Return whether there is material everywhere behind a mark, without a slot, and none in front of it."""

    def box(low_mm: float, high_mm: float) -> manifold3d.Manifold:
        sides = *(2.0 * half), high_mm - low_mm
        return manifold3d.Manifold.cube(sides).translate((*(centre - half), low_mm)).transform(frame[:3])

    hollow = box(-DEPTH_MM - BACKING_MM, -SURFACE_MM) - body
    return hollow.is_empty() and (box(SURFACE_MM, CLEAR_VIEW_MM) ^ body).is_empty()


def _loops(face: Face) -> list[FloatArray]:
    """The outer wire and the inner wires of a face as loops (n, 3), with curved edges as chords."""
    loops = []
    for wire in (face.outer_wire(), *face.inner_wires()):
        points: list[tuple[float, ...]] = []
        for edge in wire.order_edges():
            count = 1 if edge.geom_type == GeomType.LINE else 16
            points += [tuple(edge.position_at(step / count)) for step in range(count)]
        loops.append(np.array(points))
    return loops
