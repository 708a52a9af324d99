"""The mark of a printed part: number, revision and date, engraved into an outer face that carries nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
"""Grooves two layers deep, as wide at the face as two lines; their sides lean so far that ceilings need no support."""

UNIT_MM = 2.0
"""Half the height of a sign: ridges between strokes are then as wide as two lines."""

GAP, LINE = 0.95, 3.2
"""Between signs and from line to line, in halves of their height."""

# The mark keeps this far from edges of its face, and leaves this much behind it.
EDGE_MM, BEHIND_MM = 1.5, 1.19
# Nothing stands before a mark as near as this.
SEEN_MM = 25.0
# Places that are tried are so far apart, and of a face there are so many of them.
STEP_MM, PLACES = 1.0, 8
# A face is outer where the part reaches no further before it, and of a named plane where that is as near.
OUTER_MM, PARALLEL = 1e-3, 1e-4
# Faces towards the bed are pressed flat by the first layers; those overhead would need support.
LEAST_UP = -0.2


@dataclass(frozen=True)
class Mark:
    """Outlines of signs (with holes) in the plane of a frame (4, 4) in rig, mm: z points out of the part."""

    outlines: tuple[Polygon, ...]
    rig_from_face: FloatArray


def plan_mark(solid: Shape[Any], lines: Sequence[str], up: FloatArray, named: Sequence[NamedFace] = ()) -> Mark | None:
    """Find the place of a mark on a part, or of its first lines; None where there is none, or the part is not sound.

    Parameters
    ----------
    solid : Shape
        The part, in rig, mm.
    lines : sequence of str
        Digits, letters a to f, M, C and "-".
    up : (3,)
        Which way the part prints, in rig.
    named : sequence of NamedFace
        Faces that are kept as they are.
    """
    points, triangles = solid.tessellate(0.05, 0.35)
    mesh = trimesh.Trimesh(np.array([tuple(point) for point in points]), np.array(triangles))
    corners = np.asarray(mesh.vertices)
    body = manifold3d.Manifold(manifold3d.Mesh64(corners, np.array(mesh.faces, dtype=np.uint64)))
    if body.is_empty():
        return None
    faces = [face for face in solid.faces() if face.geom_type == GeomType.PLANE and _is_free(face, up, named)]
    # Outer faces first, then the largest.
    faces.sort(key=lambda face: (_before(face, corners) > OUTER_MM, -round(face.area, 3)))
    for count in range(len(lines), 0, -1):
        outlines = set_out(lines[:count])
        left, low, right, high = shapely.union_all(list(outlines)).bounds
        half = np.array([right - left, high - low]) / 2.0 + EDGE_MM
        for face in faces:
            if face.area < 4.0 * half.prod():
                continue
            frame = _frame(face, up)
            for turned in (frame, _quarter(frame)):
                if (shift := _place(face, turned, half, body)) is not None:
                    moved = tuple(shapely.affinity.translate(each, *shift) for each in outlines)
                    return Mark(moved, turned)
    return None


def engraved(solid: Part, mark: Mark) -> Part:
    """The part with a mark cut into it."""
    cut = solid - [_groove(outline, mark.rig_from_face) for outline in mark.outlines]
    cut.label = solid.label
    return cut


def _groove(outline: Polygon, rig_from_face: FloatArray) -> Solid:
    """The solid of a sign's cut: its outline in the face, narrower below as its sides lean; all faces are flat."""
    narrower = DEPTH_MM * np.tan(np.deg2rad(SIDE_DEG))
    rings = [np.array(ring.coords[:-1]) for ring in (orient(outline).exterior, *orient(outline).interiors)]
    upper = [transform(rig_from_face, np.insert(ring, 2, 0.0, axis=1)) for ring in rings]
    lower = [transform(rig_from_face, np.insert(_offset(ring, narrower), 2, -DEPTH_MM, axis=1)) for ring in rings]
    sides = [
        _face([np.array([high[i - 1], high[i], low[i], low[i - 1]])])
        for high, low in zip(upper, lower, strict=True)
        for i in range(len(high))
    ]
    return Solid(Shell([_face(upper), _face(lower), *sides]))


def _offset(ring: FloatArray, by_mm: float) -> FloatArray:
    """A ring (n, 2), its inside to the left, moved to the left with its corners mitred."""
    along = np.roll(ring, -1, axis=0) - ring
    left = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    before = np.roll(left, 1, axis=0)
    return np.asarray(ring + by_mm * (left + before) / (1.0 + (left * before).sum(axis=1))[:, None])


def _face(rings: Sequence[FloatArray]) -> Face:
    """A flat face from its outer ring (n, 3) and its holes."""
    outer, *holes = (Wire(Polyline(*(tuple(point) for point in ring), close=True).edges()) for ring in rings)
    return Face(outer, holes)


def set_out(lines: Sequence[str]) -> tuple[Polygon, ...]:
    """The outlines of the signs of some lines, mm, their middle in the origin."""
    strokes: list[FloatArray] = []
    for row, line in enumerate(lines):
        reached = 0.0
        for letter in line:
            sign = [np.array(stroke, dtype=np.float64) for stroke in STROKES[letter.replace("C", "c")]]
            low = min(stroke[:, 0].min() for stroke in sign)
            strokes += [stroke + np.array([reached - low, -row * LINE]) for stroke in sign]
            reached += max(stroke[:, 0].max() for stroke in sign) - low + GAP
    corners = np.vstack(strokes)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    wide = [
        shapely.LineString(UNIT_MM * (stroke - middle)).buffer(STROKE_MM / 2.0, cap_style="square", join_style="mitre")
        for stroke in strokes
    ]
    return tuple(shapely.get_parts(shapely.union_all(wide)))


def _before(face: Face, corners: FloatArray) -> float:
    """How far a part, by points (n, 3) of it, reaches before the plane of a face, mm."""
    return float(((corners - np.array(tuple(face.center()))) @ np.array(tuple(face.normal_at()))).max())


def _is_free(face: Face, up: FloatArray, named: Sequence[NamedFace]) -> bool:
    """Whether a face does not lie down on the bed, and is of no named plane."""
    normal, point = np.array(tuple(face.normal_at())), np.array(tuple(face.center()))
    if normal @ up < LEAST_UP:
        return False
    return not any(
        abs(each.normal @ normal) > 1.0 - PARALLEL and abs((each.point - point) @ normal) < OUTER_MM + 0.05
        for each in named
    )


def _frame(face: Face, up: FloatArray) -> FloatArray:
    """A frame (4, 4) of a face, z out of it; y is up as printed, where the face is not level."""
    normal = np.array(tuple(face.normal_at()))
    upright = up if abs(up @ normal) < 0.9 else np.eye(3)[int(np.argmin(np.abs(normal)))]
    y = upright - (upright @ normal) * normal
    y /= np.linalg.norm(y)
    frame = np.eye(4)
    frame[:3] = np.column_stack([np.cross(y, normal), y, normal, np.array(tuple(face.center()))])
    return frame


def _quarter(frame: FloatArray) -> FloatArray:
    turned = frame.copy()
    turned[:3, 0], turned[:3, 1] = frame[:3, 1], -frame[:3, 0]
    return turned


def _place(face: Face, frame: FloatArray, half: FloatArray, body: manifold3d.Manifold) -> tuple[float, float] | None:
    """Where on a face a box of half its sides (2,), mm, lies within it with material behind: the deepest inside."""
    outer, *holes = (_flat(wire, frame) for wire in (face.outer_wire(), *face.inner_wires()))
    area = Polygon(outer, holes).buffer(0.0)
    x0, y0, x1, y1 = area.bounds
    if x1 - x0 < 2.0 * half[0] or y1 - y0 < 2.0 * half[1]:
        return None
    steps = (np.arange(a + h, b - h + 1e-9, STEP_MM) for a, b, h in ((x0, x1, half[0]), (y0, y1, half[1])))
    places = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    boxes = shapely.box(*(places - half).T, *(places + half).T)
    shapely.prepare(area)
    places = places[shapely.covers(area, boxes)]
    if len(places) == 0:
        return None
    depth = shapely.distance(shapely.points(places), area.exterior)
    for place in places[np.argsort(-np.round(depth, 3), kind="stable")][:PLACES]:
        if _is_backed(frame, place, half, body):
            return float(place[0]), float(place[1])
    return None


def _is_backed(frame: FloatArray, place: FloatArray, half: FloatArray, body: manifold3d.Manifold) -> bool:
    """Whether there is material behind a mark and none before it: rays at a grid of points."""
    steps = np.linspace(-1.0, 1.0, 5)
    for x, y in np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * half + place:
        point = frame[:3, 3] + x * frame[:3, 0] + y * frame[:3, 1]
        if body.ray_cast(point - 1e-3 * frame[:3, 2], point - (DEPTH_MM + BEHIND_MM) * frame[:3, 2]):
            return False
        if body.ray_cast(point + 1e-3 * frame[:3, 2], point + SEEN_MM * frame[:3, 2]):
            return False
    return True


def _flat(wire: Wire, frame: FloatArray) -> FloatArray:
    """A wire as a loop (n, 2) in the plane of a frame; curved edges by chords."""
    points = []
    for edge in wire.order_edges():
        count = 1 if edge.geom_type == GeomType.LINE else 16
        points += [np.array(tuple(edge.position_at(step / count))) for step in range(count)]
    return (np.array(points) - frame[:3, 3]) @ frame[:3, :2]
