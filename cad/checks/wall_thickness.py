"""The thinnest wall and the thinnest floor of a mesh, by rays from its surface straight into the material."""

from __future__ import annotations

import manifold3d
import numpy as np
import trimesh
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray

# Two faces make a wall where they are parallel to 15 deg; the edge of a wedge is not a wall.
WALL_COSINE = np.cos(np.radians(15.0))
WALL_SAMPLE_MM2 = 1.0
WALL_DOT_MM2 = 0.5
# Walls thicker than this are not distinguished.
THICK_MM = 12.0
# Rays start this far inside: the rounding of the STL's 32-bit numbers is 1e-5 mm.
SURFACE_MM = 1e-3


def thinnest_wall_mm(mesh: trimesh.Trimesh, body: manifold3d.Manifold, up: FloatArray | None = None) -> float:
    """Smallest distance, straight into the material, between two faces that are parallel to 15 deg; `THICK_MM` at most.

    Dots that together cover less than `WALL_DOT_MM2` are no wall: no nozzle prints them, and nothing depends on them.
    With `up` (3,), a unit vector, faces that are level to 15 deg are left to `thinnest_floor_mm`.
    """
    return _thinnest_mm(mesh, body, np.full(len(mesh.faces), True) if up is None else ~_level(mesh, up))


def thinnest_floor_mm(mesh: trimesh.Trimesh, body: manifold3d.Manifold, up: FloatArray) -> float:
    """The same between two faces that are level when printed: floors are made of layers, walls of lines."""
    return _thinnest_mm(mesh, body, _level(mesh, up))


def _level(mesh: trimesh.Trimesh, up: FloatArray) -> NDArray[np.bool_]:
    return np.abs(np.array(mesh.face_normals) @ up) >= WALL_COSINE


def _thinnest_mm(mesh: trimesh.Trimesh, body: manifold3d.Manifold, faces: NDArray[np.bool_]) -> float:
    points, normals, areas = _samples(np.array(mesh.triangles)[faces], np.array(mesh.face_normals)[faces])
    walls = np.full(len(points), THICK_MM)
    for index, (point, normal) in enumerate(zip(points, normals, strict=True)):
        hits = body.ray_cast(point - SURFACE_MM * normal, point - THICK_MM * normal)
        if hits and -np.dot(hits[0].normal, normal) >= WALL_COSINE:
            walls[index] = SURFACE_MM + hits[0].distance * (THICK_MM - SURFACE_MM)
    thinnest_first = np.argsort(walls, kind="stable")
    counted = np.cumsum(areas[thinnest_first]) > WALL_DOT_MM2
    return float(walls[thinnest_first][np.argmax(counted)]) if counted.any() else THICK_MM


def _samples(triangles: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (m, 3) spread over triangles (n, 3, 3), their normals (m, 3), and the area (m,) that each stands for."""
    sizes = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    if not (sizes > 0.0).any():
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    points, owners, areas = [], [], []
    for index in np.flatnonzero(sizes > 0.0):
        n = int(np.ceil(np.sqrt(sizes[index] / WALL_SAMPLE_MM2)))
        i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        upright = np.stack([i, j], axis=-1)[i + j < n] + 1.0 / 3.0
        inverted = np.stack([i, j], axis=-1)[i + j < n - 1] + 2.0 / 3.0
        share = np.concatenate([upright, inverted]) / n
        a, b, c = triangles[index]
        points.append(a + share[:, :1] * (b - a) + share[:, 1:] * (c - a))
        owners.append(np.full(len(share), index))
        areas.append(np.full(len(share), sizes[index] / len(share)))
    return np.concatenate(points), normals[np.concatenate(owners)], np.concatenate(areas)
