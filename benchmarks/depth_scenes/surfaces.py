"""Surfaces as triangle meshes with texture coordinates, in the frame of the scene: x right, y away, z up, mm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirrorcam.core.values import FloatArray


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles: points (n, 3), vertex indices (m, 3), texture coordinates (n, 2), mm, and normals (n, 3) if curved."""

    points: FloatArray
    faces: NDArray[np.int64]
    texture_mm: FloatArray
    normals: FloatArray | None = None

    def moved(self, offset: ArrayLike, yaw_deg: float = 0.0) -> Surface:
        """Return the surface rotated about z, anticlockwise from above, and then shifted."""
        yaw = np.radians(yaw_deg)
        rotation = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        return self.placed(rotation, offset)

    def placed(self, rotation: FloatArray, offset: ArrayLike) -> Surface:
        """Return the surface after a rotation (3, 3) and then a shift."""
        normals = None if self.normals is None else self.normals @ rotation.T
        return Surface(self.points @ rotation.T + np.asarray(offset, float), self.faces, self.texture_mm, normals)


def joined(parts: Sequence[Surface]) -> Surface:
    """Join several surfaces, all curved or all of flat triangles."""
    starts = np.cumsum([0, *(len(surface.points) for surface in parts[:-1])])
    curved = [surface.normals for surface in parts if surface.normals is not None]
    return Surface(
        np.concatenate([surface.points for surface in parts]),
        np.concatenate([surface.faces + start for surface, start in zip(parts, starts, strict=True)]),
        np.concatenate([surface.texture_mm for surface in parts]),
        np.concatenate(curved) if curved else None,
    )


def _grid(points: FloatArray, texture_mm: FloatArray, *, is_curved: bool) -> Surface:
    """Return the triangles of a grid of points (rows, columns, 3)."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3)
    normals = None
    if is_curved:
        along, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
        if np.allclose(points[:, 0], points[:, -1]):  # a closed ring has no first column
            across[:, [0, -1]] = (points[:, [1]] - points[:, [-2]]) / 2.0
        cross = np.cross(along, across)
        length = np.linalg.norm(cross, axis=-1, keepdims=True)
        normals = (cross / np.where(length > 0.0, length, 1.0)).reshape(-1, 3)
    return Surface(points.reshape(-1, 3), faces, texture_mm.reshape(-1, 2), normals)


def sheet(corner: ArrayLike, along: ArrayLike, across: ArrayLike) -> Surface:
    """Return a parallelogram with a corner and two edges."""
    start, one, two = (np.asarray(vector, dtype=np.float64) for vector in (corner, along, across))
    lengths = np.linalg.norm(one), np.linalg.norm(two)
    points = np.array([[start, start + one], [start + two, start + one + two]])
    texture = np.array([[[0.0, 0.0], [lengths[0], 0.0]], [[0.0, lengths[1]], [lengths[0], lengths[1]]]])
    return _grid(points, texture, is_curved=False)


def block(size: ArrayLike, at: ArrayLike = (0.0, 0.0, 0.0), yaw_deg: float = 0.0) -> Surface:
    """Return a box with the centre of its base at a point; every side shows a different part of the texture."""
    x, y, z = (float(length) for length in np.asarray(size, dtype=np.float64))
    top, base = np.array([-x / 2.0, -y / 2.0, z]), np.array([x / 2.0, y / 2.0, 0.0])
    sides = [
        *((top, (x, 0, 0), (0, 0, -z)), (top, (0, y, 0), (0, 0, -z)), (top, (x, 0, 0), (0, y, 0))),
        *((base, (-x, 0, 0), (0, 0, z)), (base, (0, -y, 0), (0, 0, z)), (base, (-x, 0, 0), (0, -y, 0))),
    ]
    parts = []
    for number, side in enumerate(sides):
        flat = sheet(*side)
        parts.append(Surface(flat.points, flat.faces, flat.texture_mm + 0.37 * number * max(x, y, z)))
    return joined(parts).moved(at, yaw_deg)


def revolved(profile: Sequence[tuple[float, float]], at: ArrayLike = (0.0, 0.0, 0.0), count: int = 96) -> Surface:
    """Return a solid of revolution about a vertical axis: radii and heights, smoothed by a cubic spline."""
    from scipy.interpolate import PchipInterpolator

    radii, heights = np.array(profile, dtype=np.float64).T
    path_points = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(radii), np.diff(heights)))])
    fine = np.linspace(0.0, path_points[-1], 12 * len(profile))
    radius, height = PchipInterpolator(path_points, radii)(fine), PchipInterpolator(path_points, heights)(fine)
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = np.concatenate(
        [radius[:, None, None] * ring, np.broadcast_to(height[:, None, None], (len(fine), count + 1, 1))], axis=-1
    )
    texture = np.stack(np.broadcast_arrays(angle * radii.max(), -fine[:, None]), axis=-1)
    return _grid(points, texture, is_curved=True).moved(at)


def ball(radius: float, at: ArrayLike, count: int = 96) -> Surface:
    """Return a sphere about a point."""
    lat, lon = np.meshgrid(np.linspace(-0.5, 0.5, count // 2 + 1) * np.pi, np.linspace(0, 2, count + 1) * np.pi)
    unit = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    flat = _grid(radius * unit, radius * np.stack([lon, lat], axis=-1), is_curved=False)
    return Surface(flat.points + np.asarray(at, float), flat.faces, flat.texture_mm, unit.reshape(-1, 3))


def tube(path: ArrayLike, radius: float, sides: int = 8) -> Surface:
    """Return a wire or twig along a path (k, 3)."""
    path_points = np.asarray(path, dtype=np.float64)
    along = np.gradient(path_points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # Any direction that is nowhere near the path's own.
    helper = np.eye(3)[np.abs(along).max(axis=0).argmin()]
    one = np.cross(along, helper)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    two = np.cross(along, one)
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)[None, :, None]
    points = path_points[:, None] + radius * (np.cos(angle) * one[:, None] + np.sin(angle) * two[:, None])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path_points, axis=0), axis=1))])
    texture = np.stack(np.broadcast_arrays(length[:, None], radius * angle[..., 0]), axis=-1)
    return _grid(points, texture, is_curved=True)


def leaf(
    start: ArrayLike, axes: FloatArray, length: float, width: float, bend: float, texture_mm: ArrayLike
) -> Surface:
    """Return a leaf from a point along its first axis (3, 3), bent about the second by a fraction of its length."""
    along = np.linspace(0.0, 1.0, 9)[:, None]
    across = np.array([-1.0, 0.0, 1.0])[None, :]
    half = 0.5 * width * np.sin(np.pi * np.clip(along, 0.02, 1.0) ** 0.7)
    local = np.stack(
        np.broadcast_arrays(length * along, across * half, 0.3 * np.abs(across) * half - bend * length * along**2),
        axis=-1,
    )
    texture = np.stack(np.broadcast_arrays(length * along, across * half), axis=-1) + np.asarray(texture_mm, float)
    flat = _grid(local, texture, is_curved=False)
    return Surface(flat.points @ axes + np.asarray(start, dtype=np.float64), flat.faces, flat.texture_mm)
