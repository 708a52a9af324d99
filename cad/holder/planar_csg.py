"""Planar CSG: solids with flat faces, joined and cut as meshes that are manifold by construction.

A holder is some hundred convex solids, many with faces in one plane. Booleans of B-reps take minutes and lose faces
there; manifold3d is exact about topology, and every triangle says from which face of which solid it comes.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Protocol

import numpy as np
from manifold3d import Error, Manifold, Mesh64, OpType
from numpy.typing import NDArray

from mirrorcam.cad.plan.seats import planes_of
from mirrorcam.core.values import FloatArray

# Faces whose planes agree so well lie in one plane.
SAME_PLANE_MM = 1e-7
SAME_NORMAL = 1e-9
# Normals are kept on one side of a plane that no face of a part is at right angles to but by chance.
SIDE = np.array([0.48123, 0.23817, 0.84363])


class Flat(Protocol):
    """A solid with flat convex faces, each a loop of corners (n, 3), counter-clockwise from outside."""

    @property
    def faces(self) -> list[FloatArray]: ...


class PlanarCsg:
    """Boolean unions and differences of solids with flat faces, which keep track of the planes of all faces.

    A face id of a result is the index of its plane in `normals` (unit, (3,)) and `offsets`: normal @ x = offset.
    """

    def __init__(self) -> None:
        self._index: dict[tuple[int, ...], list[int]] = {}
        self.normals: list[FloatArray] = []
        self.offsets: list[float] = []

    def solid(self, volume: Flat) -> Manifold:
        """The mesh of a solid, its faces named by their planes."""
        loops = volume.faces
        corners: dict[tuple[float, ...], int] = {}
        triangles, planes = [], []
        for loop, normal, offset in zip(loops, *planes_of(loops), strict=True):
            plane = self._plane(normal, float(offset))
            around = [corners.setdefault(tuple(corner), len(corners)) for corner in loop.tolist()]
            for second, third in pairwise(around[1:]):
                triangles.append((around[0], second, third))
                planes.append(plane)
        mesh = Manifold(_mesh(np.array(list(corners)), np.array(triangles), np.array(planes)))
        if mesh.status() != Error.NoError or mesh.volume() <= 0.0:
            raise ValueError(f"{len(corners)} corners make no solid: {mesh.status()}, {mesh.volume():g} mm³")
        return mesh

    def joined(self, volumes: Iterable[Flat]) -> Manifold:
        """The union of solids."""
        return Manifold.batch_boolean([self.solid(volume) for volume in volumes], OpType.Add)

    def cut(self, body: Manifold, volumes: Iterable[Flat]) -> Manifold:
        """The difference of a body and the union of solids."""
        return Manifold.batch_boolean([body, *(self.solid(volume) for volume in volumes)], OpType.Subtract)

    def _plane(self, normal: FloatArray, offset: float) -> int:
        """Number of a plane among those met so far, whichever side of it is outside."""
        if normal @ SIDE < 0.0:
            normal, offset = -normal, -offset
        key = tuple(np.round(normal * 1e3).astype(int).tolist())
        neighbours = [(key[0] + i, key[1] + j, key[2] + k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]
        for near in neighbours:
            for plane in self._index.get(near, []):
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
