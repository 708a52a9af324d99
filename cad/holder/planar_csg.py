"""Planar CSG: join and cut solids with flat faces as meshes that are manifold by construction, and make one B-rep.

A holder consists of about a hundred convex solids, many with coplanar faces. Booleans of B-reps take minutes on these
and lose faces; manifold3d is exact about topology, and every triangle keeps the index of its face's plane. The faces of
the B-rep lie in the given planes, not in planes fitted to the mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain, pairwise
from typing import Protocol

import numpy as np
from build123d import Solid
from manifold3d import Error, Manifold, Mesh64, OpType
from numpy.typing import NDArray
from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
from OCP.Geom import Geom_Plane
from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt
from OCP.TopAbs import TopAbs_REVERSED
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shell, TopoDS_Solid, TopoDS_Vertex, TopoDS_Wire

from mirrorcam.cad.plan.seats import planes_of
from mirrorcam.core.values import FloatArray

# Tolerances within which two planes are the same.
SAME_PLANE_MM = 1e-7
SAME_NORMAL = 1e-9
# Normals are oriented to the positive side of this direction, to which no face is parallel except by chance.
POSITIVE_SIDE = np.array([0.48123, 0.23817, 0.84363])


class Flat(Protocol):
    """A solid with flat convex faces, each a loop of corners (n, 3), counter-clockwise seen from outside."""

    @property
    def faces(self) -> list[FloatArray]: ...


class PlanarCsg:
    """Boolean unions and differences of solids with flat faces, with the planes of all faces.

    The face id of a result's triangle is the index of its plane in `normals`, unit vectors (3,), and `offsets`:
    normal @ x = offset.
    """

    def __init__(self) -> None:
        self._index: dict[tuple[int, ...], list[int]] = {}
        self.normals: list[FloatArray] = []
        self.offsets: list[float] = []

    def solid(self, volume: Flat) -> Manifold:
        """The mesh of a solid, with the planes as face ids."""
        loops = volume.faces
        corners: dict[tuple[float, ...], int] = {}
        triangles, planes = [], []
        for loop, normal, offset in zip(loops, *planes_of(loops), strict=True):
            plane = self._plane(normal, float(offset))
            indices = [corners.setdefault(tuple(corner), len(corners)) for corner in loop.tolist()]
            for second, third in pairwise(indices[1:]):
                triangles.append((indices[0], second, third))
                planes.append(plane)
        mesh = Manifold(_mesh(np.array(list(corners)), np.array(triangles), np.array(planes)))
        if mesh.status() != Error.NoError or mesh.volume() <= 0.0:
            raise ValueError(f"{len(corners)} corners do not form a solid: {mesh.status()}, {mesh.volume():g} mm³")
        return mesh

    def joined(self, volumes: Iterable[Flat]) -> Manifold:
        """The union of solids."""
        return Manifold.batch_boolean([self.solid(volume) for volume in volumes], OpType.Add)

    def cut(self, body: Manifold, volumes: Iterable[Flat]) -> Manifold:
        """The difference of a body and the union of solids."""
        return Manifold.batch_boolean([body, *(self.solid(volume) for volume in volumes)], OpType.Subtract)

    def _plane(self, normal: FloatArray, offset: float) -> int:
        """Index of a plane, whichever side is outside; a new plane is added."""
        if normal @ POSITIVE_SIDE < 0.0:
            normal, offset = -normal, -offset
        key = tuple(np.round(normal * 1e3).astype(int).tolist())
        neighbours = [(key[0] + i, key[1] + j, key[2] + k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]
        for neighbour in neighbours:
            for plane in self._index.get(neighbour, []):
                same = np.abs(self.normals[plane] - normal).max() < SAME_NORMAL
                if same and abs(self.offsets[plane] - offset) < SAME_PLANE_MM:
                    return plane
        self._index.setdefault(key, []).append(len(self.normals))
        self.normals.append(normal)
        self.offsets.append(offset)
        return len(self.normals) - 1


def _mesh(corners: FloatArray, triangles: NDArray[np.int64], planes: NDArray[np.int64]) -> Mesh64:
    return Mesh64(
        np.array(corners, dtype=np.float64),
        np.array(triangles, dtype=np.uint64),
        face_id=np.array(planes, dtype=np.uint64),
    )


# Corners nearer to each other than this are merged: about the rounding of an STL file at 200 mm from its origin.
CORNER_MM = 1e-4

Loop = list[int]
Face = tuple[int, list[Loop]]


def brep(csg: PlanarCsg, body: Manifold) -> Solid:
    """One B-rep solid with a face for the connected triangles of each plane; raises ValueError if it is invalid."""
    mesh = body.to_mesh64()
    corners = np.array(mesh.vert_properties)
    triangles, planes = _welded(
        corners, np.asarray(mesh.tri_verts, dtype=np.int64), np.asarray(mesh.face_id, dtype=np.int64)
    )
    faces = _faces(triangles, _planes_without_needles(corners, triangles, planes))
    faces = _without_redundant_corners(_without_spikes(corners, faces))
    corners = _moved_onto_planes(csg, corners, faces)
    solid = _solid(corners, [(_outward(corners, csg.normals[plane], loops), loops) for plane, loops in faces])
    if not solid.is_valid:
        raise ValueError(f"{len(faces)} flat faces do not form a valid solid")
    return solid


def _moved_onto_planes(csg: PlanarCsg, corners: FloatArray, faces: Sequence[Face]) -> FloatArray:
    """Corners (n, 3) moved onto the planes of the faces that meet there, unless they are too far away."""
    planes_at: dict[int, set[int]] = {}
    for plane, loops in faces:
        for loop in loops:
            for corner in loop:
                planes_at.setdefault(corner, set()).add(plane)
    for corner, planes in planes_at.items():
        indices = sorted(planes)
        normals = np.array([csg.normals[plane] for plane in indices])
        residuals = np.array([csg.offsets[plane] for plane in indices]) - normals @ corners[corner]
        step = np.linalg.lstsq(normals, residuals, rcond=1e-6)[0]
        if np.linalg.norm(step) < 10.0 * CORNER_MM:
            corners[corner] += step
    return corners


def _welded(
    corners: FloatArray, triangles: NDArray[np.int64], planes: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles (n, 3) and their planes (n,) with edges shorter than `CORNER_MM` collapsed.

    Short edges arise where the same plane was computed twice with different rounding. Corners that coincide need not
    share an edge: between them may lie pairs of degenerate triangles with a common longest edge, which are flipped.
    """
    while True:
        triangles, planes = _without_short_edges(corners, triangles, planes)
        if not _flip_needles(corners, triangles):
            return triangles, planes


def _without_short_edges(
    corners: FloatArray, triangles: NDArray[np.int64], planes: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles and their planes after one pass over the edges shorter than `CORNER_MM`, which collapse."""
    representative = np.arange(len(corners))
    for i in range(3):
        start, end = triangles[:, i], triangles[:, (i + 1) % 3]
        for a, b in zip(*_short_edges(corners, start, end), strict=True):
            low, high = sorted((representative[a], representative[b]))
            representative[representative == high] = low
    welded = representative[triangles]
    keep = (welded != np.roll(welded, 1, axis=1)).all(axis=1)
    # Two triangles with the same corners cancel: they enclose no volume.
    faces: dict[tuple[int, ...], np.int64] = {}
    for index in np.flatnonzero(keep):
        key = tuple(sorted(welded[index].tolist()))
        if key in faces:
            keep[[index, faces.pop(key)]] = False
        else:
            faces[key] = index
    return welded[keep], planes[keep]


def _flip_needles(corners: FloatArray, triangles: NDArray[np.int64]) -> bool:
    """Flip, in place, the longest edges that two degenerate triangles share; return whether there are any."""
    beyond = _beyond_longest_edge(corners, triangles)
    edges = set(_owners(triangles))
    flipped = False
    for needle, other in beyond.items():
        if needle > other or beyond.get(other) != needle:
            continue
        shared = set(triangles[needle].tolist()) & set(triangles[other].tolist())
        first, second = (next(i for i in range(3) if t[i] not in shared) for t in triangles[[needle, other]])
        apex, start, end = np.roll(triangles[needle], -first).tolist()
        opposite = int(triangles[other][second])
        if (apex, opposite) in edges or (opposite, apex) in edges:
            continue
        triangles[needle], triangles[other] = (apex, start, opposite), (apex, opposite, end)
        edges |= {(apex, opposite), (opposite, apex)}
        flipped = True
    return flipped


def _owners(triangles: NDArray[np.int64]) -> dict[tuple[int, int], int]:
    """The triangle to the left of each directed edge."""
    return {(int(t[i]), int(t[(i + 1) % 3])): index for index, t in enumerate(triangles) for i in range(3)}


def _beyond_longest_edge(corners: FloatArray, triangles: NDArray[np.int64]) -> dict[int, int]:
    """The triangle beyond the longest edge of each degenerate triangle."""
    ends = corners[triangles]
    sides = np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2)
    doubled_areas = np.linalg.norm(np.cross(ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0]), axis=1)
    owner, beyond = _owners(triangles), dict[int, int]()
    for needle in np.flatnonzero(doubled_areas < CORNER_MM * sides.max(axis=1)).tolist():
        edge = int(sides[needle].argmax())
        beyond[needle] = owner[(int(triangles[needle][(edge + 1) % 3]), int(triangles[needle][edge]))]
    return beyond


def _short_edges(
    corners: FloatArray, starts: NDArray[np.int64], ends: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    short = np.linalg.norm(corners[starts] - corners[ends], axis=1) < CORNER_MM
    return starts[short], ends[short]


def _planes_without_needles(
    corners: FloatArray, triangles: NDArray[np.int64], planes: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Planes (n,) of triangles (n, 3), with degenerate triangles assigned to the face beyond their longest edge.

    In any other face, a degenerate triangle would connect areas that only touch.
    """
    adjacent = _beyond_longest_edge(corners, triangles)
    planes = planes.copy()
    while True:
        # In a row of needles, each takes the plane of the next.
        reassigned = [needle for needle in adjacent if planes[adjacent[needle]] != planes[needle]]
        if not reassigned:
            return planes
        for needle in reassigned:
            planes[needle] = planes[adjacent.pop(needle)]


def _faces(triangles: NDArray[np.int64], planes: NDArray[np.int64]) -> list[Face]:
    """Plane and boundary loops of every connected face, without corners at which only two faces meet."""
    owner = _owners(triangles)
    face = np.full(len(triangles), -1)
    count = 0
    for start in range(len(triangles)):
        if face[start] >= 0:
            continue
        face[start], stack = count, [start]
        while stack:
            t = stack.pop()
            a, b, c = (int(corner) for corner in triangles[t])
            for edge in ((b, a), (c, b), (a, c)):
                other = owner[edge]
                if face[other] < 0 and planes[other] == planes[t]:
                    face[other] = count
                    stack.append(other)
        count += 1
    next_edge = {
        (int(corners[i]), int(corners[(i + 1) % 3])): (int(corners[(i + 1) % 3]), int(corners[(i + 2) % 3]))
        for corners in triangles
        for i in range(3)
    }
    loops: list[list[Loop]] = [[] for _ in range(count)]
    plane_of = [0] * count
    visited: set[tuple[int, int]] = set()
    for edge, t in owner.items():
        if edge in visited or face[owner[edge[::-1]]] == face[t]:
            continue
        plane_of[face[t]] = int(planes[t])
        loop: Loop = []
        while edge not in visited:
            visited.add(edge)
            loop.append(edge[0])
            # Rotate about the edge's end, inside the face, to the next edge of its boundary.
            edge = next_edge[edge]
            while face[owner[edge[::-1]]] == face[t]:
                edge = next_edge[edge[::-1]]
        loops[face[t]] += _simple_loops(loop)
    return _without_redundant_corners(list(zip(plane_of, loops, strict=True)))


def _without_spikes(corners: FloatArray, faces: list[Face]) -> list[Face]:
    """Faces without spikes, where a loop doubles back along an edge: the thin area joins the adjacent face."""
    loops = [loop for _, group in faces for loop in group]
    changed = True
    while changed:
        changed = False
        for loop in loops:
            for i in range(len(loop)):
                a, b, c = loop[i - 2], loop[i - 1], loop[i]
                first, second = corners[a] - corners[b], corners[c] - corners[b]
                if first @ second <= 0.0 or len(loop) < 4:
                    continue
                apex, inner, start, end = (a, c, b, a) if first @ first > second @ second else (c, a, c, b)
                side = corners[apex] - corners[b]
                if np.linalg.norm(np.cross(side, corners[inner] - corners[b])) > CORNER_MM * np.linalg.norm(side):
                    continue
                other = next(o for o in loops if any(o[k - 1] == start and o[k] == end for k in range(len(o))))
                index = next(k for k in range(len(other)) if other[k - 1] == start and other[k] == end)
                other.insert(index if index > 0 else len(other), inner)
                loop.remove(b)
                changed = True
                break
            if changed:
                break
    return faces


def _simple_loops(loop: Loop) -> list[Loop]:
    """A loop split into loops that visit each corner once."""
    for end, corner in enumerate(loop):
        start = loop.index(corner)
        if start < end:
            return _simple_loops(loop[start:end]) + _simple_loops(loop[:start] + loop[end:])
    return [loop]


def _without_redundant_corners(faces: list[Face]) -> list[Face]:
    """Faces without corners at which only two faces meet, and without slivers that have only two other corners."""
    while True:
        faces_at: dict[int, set[int]] = {}
        for index, (_, loops) in enumerate(faces):
            for corner in chain.from_iterable(loops):
                faces_at.setdefault(corner, set()).add(index)
        reduced = [
            (plane, [[corner for corner in loop if len(faces_at[corner]) > 2] for loop in loops])
            for plane, loops in faces
        ]
        reduced = [(plane, [loop for loop in loops if len(loop) > 2]) for plane, loops in reduced]
        reduced = [(plane, loops) for plane, loops in reduced if loops]
        if reduced == faces:
            return faces
        faces = reduced


def _outward(corners: FloatArray, normal: FloatArray, loops: list[Loop]) -> FloatArray:
    """The outward normal of a face: that of its plane, or its opposite for faces of subtracted solids."""
    areas = [np.cross(corners[loop], np.roll(corners[loop], -1, axis=0)).sum(axis=0) @ normal for loop in loops]
    return normal if sum(areas) > 0.0 else -normal


def _solid(corners: FloatArray, faces: Sequence[tuple[FloatArray, list[Loop]]]) -> Solid:
    """A B-rep of flat faces (outward unit normal, loops of corners) that share their edges."""
    builder = BRep_Builder()
    vertices: dict[int, TopoDS_Vertex] = {}
    edges: dict[tuple[int, int], TopoDS_Edge] = {}

    def vertex(corner: int) -> TopoDS_Vertex:
        if corner not in vertices:
            vertices[corner] = TopoDS_Vertex()
            builder.MakeVertex(vertices[corner], gp_Pnt(*corners[corner].tolist()), tolerance[corner])
        return vertices[corner]

    def edge(start: int, end: int) -> TopoDS_Edge:
        if (end, start) in edges:
            return edges[(end, start)].Oriented(TopAbs_REVERSED)
        edges[(start, end)] = BRepBuilderAPI_MakeEdge(vertex(start), vertex(end)).Edge()
        builder.UpdateEdge(edges[(start, end)], max(tolerance[start], tolerance[end]))
        return edges[(start, end)]

    # A corner of more than three faces may be off their planes by up to the welding distance.
    tolerance = np.full(len(corners), 1e-7)
    for normal, loops in faces:
        for loop in loops:
            distance = np.abs((corners[loop] - corners[loops[0][0]]) @ normal)
            tolerance[loop] = np.maximum(tolerance[loop], 1.1 * distance)
    shell = TopoDS_Shell()
    builder.MakeShell(shell)
    for normal, loops in faces:
        face = TopoDS_Face()
        plane = Geom_Plane(gp_Ax3(gp_Pnt(*corners[loops[0][0]].tolist()), gp_Dir(*normal.tolist())))
        builder.MakeFace(face, plane, 1e-7)
        for loop in loops:
            wire = TopoDS_Wire()
            builder.MakeWire(wire)
            for start, end in zip(loop, loop[1:] + loop[:1], strict=True):
                builder.Add(wire, edge(start, end))
            wire.Closed(True)
            builder.Add(face, wire)
        builder.Add(shell, face)
    shell.Closed(True)
    solid = TopoDS_Solid()
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    return Solid(solid)
