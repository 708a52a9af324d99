"""Line drawings of meshes: sharp edges and outlines, without what lies behind other surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import shapely
import trimesh
from numpy.typing import NDArray

from mirrorcam.cad.guide.shading import Shot
from mirrorcam.core.values import FloatArray

# Faces that meet at less than this many degrees are one curved surface.
SMOOTH_DEG = 25.0
# An edge is seen where no surface is nearer by more than this, as the surfaces that it bounds rise within a pixel.
BEHIND_MM = 0.6
# Shorter pieces of edges, px, are left out: where an edge is hidden, rounding lets through dots of it.
SHORTEST_PX = 2.5
NOTHING = -1e9
# Decimals of positions on a sheet, mm.
ROUNDED_TO = 2


def edges_of(mesh: trimesh.Trimesh, towards: FloatArray) -> FloatArray:
    """Sharp edges of a closed mesh, and its outline for a viewer in direction (3,): end points (n, 2, 3)."""
    sharp = mesh.face_adjacency_angles > np.deg2rad(SMOOTH_DEG)
    faces = mesh.face_normals @ towards > 0.0
    pairs = faces[mesh.face_adjacency]
    shown = (sharp & pairs.any(axis=1)) | (pairs[:, 0] != pairs[:, 1])
    return np.asarray(mesh.vertices[mesh.face_adjacency_edges[shown]], dtype=np.float64)


def visible_lines(edges: FloatArray, shot: Shot) -> list[FloatArray]:
    """The pieces (2, 2) in px of edges (n, 2, 3) in rig, mm, that no surface of a picture lies before."""
    ends = shot.screen.pixels(edges)
    spans = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(spans[:, :2], axis=1)
    steps = np.ceil(lengths).astype(int) + 1
    owner = np.repeat(np.arange(len(edges)), steps + 1)
    along = np.arange(len(owner)) - np.repeat(np.cumsum(steps + 1) - (steps + 1), steps + 1)
    points = ends[owner, 0] + (along / steps[owner])[:, None] * spans[owner]
    seen = _seen(points, shot)
    first, last = seen.copy(), seen.copy()
    first[1:] &= ~(seen[:-1] & (owner[1:] == owner[:-1]))
    last[:-1] &= ~(seen[1:] & (owner[1:] == owner[:-1]))
    pieces = np.stack([points[first, :2], points[last, :2]], axis=1)
    long = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1) >= np.minimum(SHORTEST_PX, 0.9 * lengths[owner[first]])
    return list(pieces[long])


def _seen(points: FloatArray, shot: Shot) -> NDArray[np.bool_]:
    """Whether points (n, 3), px and nearness, are nowhere behind all surfaces of the pixels around them."""
    farthest = cv2.erode(np.maximum(shot.nearness, NOTHING), np.ones((3, 3), dtype=np.uint8))
    height, width = farthest.shape
    columns, rows = np.floor(points[:, :2]).astype(int).T
    return np.asarray(
        points[:, 2] >= farthest[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)] - BEHIND_MM
    )


def joined(lines: Sequence[FloatArray]) -> list[FloatArray]:
    """Lines (n, 2) of a sheet, mm, rounded, those that meet end to end as one: a curve is then one line."""
    rounded = [np.round(line, ROUNDED_TO) for line in lines]
    merged = shapely.line_merge(shapely.MultiLineString([line for line in rounded if (line[0] != line[-1]).any()]))
    return [shapely.get_coordinates(line) for line in shapely.get_parts(merged)]
