"""First hits of rays on objects, with normals and texture coordinates. In view axes, mm."""

from __future__ import annotations

from typing import Any

import numpy as np

from mirrorcam.core.compiled import inlined
from mirrorcam.render_scenes.preview.traced_scene import BOUND, BOX, CYLINDER, KIND, RECTANGLE, SPHERE, TRIANGLES, UNIT
from mirrorcam.render_scenes.preview.triangle_tree import (
    NOTHING,
    along,
    at,
    cross,
    dot,
    mapped_normal,
    mapped_point,
    mapped_vector,
    minus,
    nearest_triangle,
)

LID = 1
"""Part number of the lid of a cylinder; 0 is its side."""

# Texture coordinates (1 + u . p) / 2 and (1 + v . p) / 2 on the faces -x, x, -y, y, -z, z of a box, as in Mitsuba.
BOX_U = np.array([[0, 1, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 1, 0]], dtype=np.float64)
BOX_V = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, 0, -1], [1, 0, 0], [1, 0, 0]], dtype=np.float64)


@inlined
def first_hit(objects: Any, boxes: Any, triangles: Any, start: Any, direction: Any, least: Any) -> Any:
    """Return the first object on a ray beyond the length `least`, in units of the direction's length.

    Returns the number of the object or `NOTHING`, the length, and the part hit: the face of a box, the triangle of
    leaves, or the `LID` of a cylinder.
    """
    found, length, part = NOTHING, np.inf, 0
    squared = dot(direction, direction)
    for number in range(len(objects)):
        if _passes(objects, number, start, direction, squared):
            hit, face = _intersect(objects, boxes, triangles, number, start, direction, least, length, True)
            if hit < length:
                found, length, part = number, hit, face
    return found, length, part


@inlined
def is_hidden(objects: Any, boxes: Any, triangles: Any, suspects: Any, start: Any, segment: Any, least: Any) -> Any:
    """Return whether an object whose bit is set in `suspects` lies on a segment beyond its fraction `least`."""
    squared = dot(segment, segment)
    for number in range(len(objects)):
        if suspects >> number & 1 and _passes(objects, number, start, segment, squared):
            hit, _ = _intersect(objects, boxes, triangles, number, start, segment, least, 1.0, False)
            if hit < 1.0:
                return True
    return False


@inlined
def _passes(objects: Any, number: Any, start: Any, direction: Any, squared: Any) -> Any:
    """Return whether a line passes through the sphere around an object."""
    to_middle = minus(at(objects, number, BOUND), start)
    ahead, radius = dot(to_middle, direction), objects[number, BOUND + 3]
    return (dot(to_middle, to_middle) - radius * radius) * squared <= ahead * ahead


@inlined
def _intersect(
    objects: Any,
    boxes: Any,
    triangles: Any,
    number: Any,
    start: Any,
    direction: Any,
    least: Any,
    most: Any,
    nearest: Any,
) -> Any:
    """Return the length at which a ray meets an object between two lengths, or infinity, and the part that it meets.

    A mesh returns its `nearest` hit or any.
    """
    p, d = mapped_point(objects, number, UNIT, start), mapped_vector(objects, number, UNIT, direction)
    kind = int(objects[number, KIND])
    if kind == RECTANGLE:
        return _hit_plane(p, d, 0.0, False, least, most), 0
    if kind == SPHERE:
        return _quadratic_roots(dot(d, d), dot(p, d), dot(p, p) - 1.0, least, most)[0], 0
    if kind == CYLINDER:
        return _hit_cylinder(p, d, least, most)
    if kind == BOX:
        return _hit_box(p, d, least, most)
    triangle, hit = nearest_triangle(boxes, triangles, p, d, least, most, nearest)
    return (hit, triangle) if triangle != NOTHING else (np.inf, 0)


@inlined
def _hit_plane(p: Any, d: Any, height: Any, is_disc: Any, least: Any, most: Any) -> Any:
    """Return the length at which a ray meets the unit square, or the unit disc, at a height z."""
    hit = (height - p[2]) / d[2]
    if not least < hit < most:
        return np.inf
    x, y = p[0] + hit * d[0], p[1] + hit * d[1]
    inside = x * x + y * y <= 1.0 if is_disc else abs(x) <= 1.0 and abs(y) <= 1.0
    return hit if inside else np.inf


@inlined
def _quadratic_roots(a: Any, b: Any, c: Any, least: Any, most: Any) -> Any:
    """Return the two ordered solutions of a s^2 + 2 b s + c = 0 between two lengths; infinite if missing."""
    root = b * b - a * c
    if root < 0.0:
        return np.inf, np.inf
    root = np.sqrt(root)
    near, far = (-b - root) / a, (-b + root) / a
    far = far if least < far < most else np.inf
    return (near, far) if least < near < most else (far, np.inf)


@inlined
def _hit_cylinder(p: Any, d: Any, least: Any, most: Any) -> Any:
    near, far = _quadratic_roots(
        d[0] * d[0] + d[1] * d[1], p[0] * d[0] + p[1] * d[1], p[0] * p[0] + p[1] * p[1] - 1.0, least, most
    )
    side = np.inf
    if near < np.inf and abs(p[2] + near * d[2]) <= 1.0:
        side = near
    elif far < np.inf and abs(p[2] + far * d[2]) <= 1.0:
        side = far
    lid = _hit_plane(p, d, 1.0, True, least, most)
    return (lid, LID) if lid < side else (side, 0)


@inlined
def _hit_box(p: Any, d: Any, least: Any, most: Any) -> Any:
    """Return the length at which a ray enters the box from -1 to 1, and the face."""
    x, y, z = 1.0 / d[0], 1.0 / d[1], 1.0 / d[2]
    x_enters, y_enters, z_enters = -p[0] * x - abs(x), -p[1] * y - abs(y), -p[2] * z - abs(z)
    leaves = min(-p[0] * x + abs(x), -p[1] * y + abs(y), -p[2] * z + abs(z))
    enters = max(x_enters, y_enters, z_enters)
    if not (enters <= leaves and least < enters < most):
        return np.inf, 0
    if enters == x_enters:
        return enters, 0 if x > 0.0 else 1
    if enters == y_enters:
        return enters, 2 if y > 0.0 else 3
    return enters, 4 if z > 0.0 else 5


@inlined
def normal_at(objects: Any, triangles: Any, number: Any, part: Any, point: Any) -> Any:
    """Return the normal of a part of an object at a point, not normalized: outward, on either side for flat objects."""
    kind = int(objects[number, KIND])
    if kind == RECTANGLE or (kind == CYLINDER and part == LID):
        return at(objects, number, UNIT + 8)
    if kind == BOX:
        return at(objects, number, UNIT + 4 * (part // 2))
    if kind == TRIANGLES:
        return mapped_normal(objects, number, UNIT, cross(at(triangles, part, 3), at(triangles, part, 6)))
    p = mapped_point(objects, number, UNIT, point)
    return mapped_normal(objects, number, UNIT, (p[0], p[1], p[2] if kind == SPHERE else 0.0))


@inlined
def texture_uv(objects: Any, number: Any, part: Any, point: Any, right: Any, down: Any) -> Any:
    """Return texture coordinates (2,) at a point of an object, and their derivatives along two vectors."""
    kind = int(objects[number, KIND])
    p = mapped_point(objects, number, UNIT, point)
    a, b = mapped_vector(objects, number, UNIT, right), mapped_vector(objects, number, UNIT, down)
    if kind == RECTANGLE:
        uv = (0.5 + 0.5 * p[0], 0.5 + 0.5 * p[1])
        return uv, (0.5 * a[0], 0.5 * a[1]), (0.5 * b[0], 0.5 * b[1])
    if kind == BOX:
        u, v = at(BOX_U, part, 0), at(BOX_V, part, 0)
        uv = (0.5 + 0.5 * dot(u, p), 0.5 + 0.5 * dot(v, p))
        return uv, (0.5 * dot(u, a), 0.5 * dot(v, a)), (0.5 * dot(u, b), 0.5 * dot(v, b))
    squared = max(p[0] * p[0] + p[1] * p[1], 1e-12)
    around = np.arctan2(p[1], p[0]) / (2.0 * np.pi)
    around = around if around >= 0.0 else around + 1.0
    around_scale = 1.0 / (2.0 * np.pi * squared)
    around_a, around_b = (p[0] * a[1] - p[1] * a[0]) * around_scale, (p[0] * b[1] - p[1] * b[0]) * around_scale
    radius = np.sqrt(squared)
    if kind == SPHERE:
        height_scale = -1.0 / (np.pi * radius)
        height = np.arccos(min(max(p[2], -1.0), 1.0)) / np.pi
        return (around, height), (around_a, height_scale * a[2]), (around_b, height_scale * b[2])
    if part == LID:
        outwards_a, outwards_b = (p[0] * a[0] + p[1] * a[1]) / radius, (p[0] * b[0] + p[1] * b[1]) / radius
        return (radius, around), (outwards_a, around_a), (outwards_b, around_b)
    return (around, 0.5 + 0.5 * p[2]), (around_a, 0.5 * a[2]), (around_b, 0.5 * b[2])


@inlined
def corner_colour(objects: Any, triangles: Any, number: Any, part: Any, point: Any) -> Any:
    """Interpolate the colour of a triangle at a point from its corners."""
    p = minus(mapped_point(objects, number, UNIT, point), at(triangles, part, 0))
    a, b = at(triangles, part, 3), at(triangles, part, 6)
    aa, ab, bb, pa, pb = dot(a, a), dot(a, b), dot(b, b), dot(p, a), dot(p, b)
    area = aa * bb - ab * ab
    first, second = (bb * pa - ab * pb) / area, (aa * pb - ab * pa) / area
    colour = at(triangles, part, 9)
    mixed = along(colour, first, minus(at(triangles, part, 12), colour))
    return along(mixed, second, minus(at(triangles, part, 15), colour))
