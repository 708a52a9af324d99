"""A tree of bounding boxes over the triangles of a mesh, and vector arithmetic, for compiled loops over rays.

Vectors are tuples of three floats, which compiled code does not allocate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mirrorcam.core.compiled import inlined
from mirrorcam.core.values import FloatArray
from mirrorcam.render_scenes.mesh_shapes import Triangles


@inlined
def dot(a: Any, b: Any) -> Any:
    """Return the scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def add_scaled(a: Any, factor: Any, b: Any) -> Any:
    """Return the vector a + factor * b."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


@inlined
def subtract(a: Any, b: Any) -> Any:
    """Return the difference a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inlined
def scale(a: Any, factor: Any) -> Any:
    """Return a vector times a number."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


@inlined
def load3(table: Any, row: Any, column: Any) -> Any:
    """Return three elements of a row of a table as a vector; a slice would cost reference counting."""
    return (table[row, column], table[row, column + 1], table[row, column + 2])


@inlined
def map_point(table: Any, row: Any, column: Any, point: Any) -> Any:
    """Map a point by an affine map (3, 4), stored row by row in a row of a table from a column on."""
    x, y, z = point
    return (
        table[row, column] * x + table[row, column + 1] * y + table[row, column + 2] * z + table[row, column + 3],
        table[row, column + 4] * x + table[row, column + 5] * y + table[row, column + 6] * z + table[row, column + 7],
        table[row, column + 8] * x + table[row, column + 9] * y + table[row, column + 10] * z + table[row, column + 11],
    )


@inlined
def map_vector(table: Any, row: Any, column: Any, vector: Any) -> Any:
    """Map a vector by the linear part (3, 3) of such a map."""
    x, y, z = vector
    return (
        table[row, column] * x + table[row, column + 1] * y + table[row, column + 2] * z,
        table[row, column + 4] * x + table[row, column + 5] * y + table[row, column + 6] * z,
        table[row, column + 8] * x + table[row, column + 9] * y + table[row, column + 10] * z,
    )


@inlined
def map_normal(table: Any, row: Any, column: Any, vector: Any) -> Any:
    """Map a normal back by the transposed linear part of such a map; the result is not normalized."""
    x, y, z = vector
    return (
        table[row, column] * x + table[row, column + 4] * y + table[row, column + 8] * z,
        table[row, column + 1] * x + table[row, column + 5] * y + table[row, column + 9] * z,
        table[row, column + 2] * x + table[row, column + 6] * y + table[row, column + 10] * z,
    )


@inlined
def cross(a: Any, b: Any) -> Any:
    """Return the vector product a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined
def unit(vector: Any) -> Any:
    """Return a vector scaled to length 1."""
    return scale(vector, 1.0 / dot(vector, vector) ** 0.5)


MAX_LEAF_TRIANGLES = 4
"""Maximum number of triangles in a leaf box."""
NEXT, FIRST, COUNT = 6, 7, 8
"""Columns of boxes."""
NOTHING = -1


class TriangleTree(NamedTuple):
    """Triangles ordered so that those of each box are contiguous, and the boxes in depth-first order.

    Attributes
    ----------
    boxes
        (m, 9): minimum and maximum corner; index of the next box that is not inside it; index of its first triangle;
        number of its triangles, or 0 unless it is a leaf.
    triangles
        (n, 18): first corner, the two edges from it, and the colours of the three corners.
    """

    boxes: FloatArray
    triangles: FloatArray


def triangle_tree(surface: Triangles) -> TriangleTree:
    """Split the triangles of a mesh recursively at the median along the longest extent of their centroids."""
    points = surface.points[surface.faces]
    colours = np.full_like(points, 0.6) if surface.colours is None else surface.colours[surface.faces]
    low, high, centroid = points.min(axis=1), points.max(axis=1), points.mean(axis=1)
    order = np.arange(len(points))
    boxes: list[FloatArray] = []

    def divide(begin: int, end: int) -> None:
        inside = order[begin:end]
        index = len(boxes)
        is_leaf = end - begin <= MAX_LEAF_TRIANGLES
        corners = np.concatenate([low[inside].min(axis=0), high[inside].max(axis=0)])
        boxes.append(np.array([*corners, 0.0, begin, end - begin if is_leaf else 0]))
        if not is_leaf:
            axis, half = int(np.argmax(np.ptp(centroid[inside], axis=0))), (end - begin) // 2
            order[begin:end] = inside[np.argpartition(centroid[inside, axis], half)]
            divide(begin, begin + half)
            divide(begin + half, end)
        boxes[index][NEXT] = len(boxes)

    divide(0, len(points))
    corner, second, third = (points[order, k] for k in range(3))
    return TriangleTree(
        np.array(boxes),
        np.concatenate([corner, second - corner, third - corner, colours[order].reshape(-1, 9)], axis=1),
    )


NO_TRIANGLES = TriangleTree(np.zeros((0, 9)), np.zeros((0, 18)))


@inlined
def nearest_triangle(
    boxes: Any, triangles: Any, origin: Any, direction: Any, t_min: Any, t_max: Any, nearest: Any
) -> Any:
    """Return a triangle (the nearest or any) that a ray hits at `t_min` < t < `t_max`, or `NOTHING`; and t."""
    hit_triangle, t = NOTHING, t_max
    x, y, z = 1.0 / direction[0], 1.0 / direction[1], 1.0 / direction[2]
    box = 0
    while box < len(boxes):
        a, b = (boxes[box, 0] - origin[0]) * x, (boxes[box, 3] - origin[0]) * x
        entry, exit_t = max(t_min, min(a, b)), min(t, max(a, b))
        a, b = (boxes[box, 1] - origin[1]) * y, (boxes[box, 4] - origin[1]) * y
        entry, exit_t = max(entry, min(a, b)), min(exit_t, max(a, b))
        a, b = (boxes[box, 2] - origin[2]) * z, (boxes[box, 5] - origin[2]) * z
        entry, exit_t = max(entry, min(a, b)), min(exit_t, max(a, b))
        if entry > exit_t:
            box = int(boxes[box, NEXT])
            continue
        first = int(boxes[box, FIRST])
        for triangle in range(first, first + int(boxes[box, COUNT])):
            hit = _intersect_triangle(triangles, triangle, origin, direction)
            if t_min < hit < t:
                hit_triangle, t = triangle, hit
                if not nearest:
                    return hit_triangle, t
        box += 1
    return hit_triangle, t


@inlined
def _intersect_triangle(triangles: Any, triangle: Any, origin: Any, direction: Any) -> Any:
    """Return t where a ray meets a triangle, or infinity (Moeller and Trumbore, JGT 2(1), 1997)."""
    first, second = load3(triangles, triangle, 3), load3(triangles, triangle, 6)
    p = cross(direction, second)
    determinant = dot(first, p)
    if determinant == 0.0:
        return np.inf
    to_origin = subtract(origin, load3(triangles, triangle, 0))
    u = dot(to_origin, p) / determinant
    if u < 0.0 or u > 1.0:
        return np.inf
    q = cross(to_origin, first)
    v = dot(direction, q) / determinant
    if v < 0.0 or u + v > 1.0:
        return np.inf
    return dot(second, q) / determinant
