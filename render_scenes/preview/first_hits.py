"""First hits of rays on objects, with normals and texture coordinates. Coordinates are in view axes, in mm."""

from __future__ import annotations

from typing import Any

import numpy as np

from mirrorcam.core.compiled import inlined
from mirrorcam.render_scenes.preview.traced_scene import (
    BOUNDING_SPHERE,
    BOX,
    CYLINDER,
    KIND,
    RECTANGLE,
    SPHERE,
    TO_UNIT,
    TRIANGLES,
)
from mirrorcam.render_scenes.preview.triangle_tree import (
    NOTHING,
    add_scaled,
    cross,
    dot,
    load3,
    map_normal,
    map_point,
    map_vector,
    nearest_triangle,
    subtract,
)

LID = 1
"""Part number of the lid of a cylinder; the side is 0."""

# Texture coordinates (1 + u . p) / 2 and (1 + v . p) / 2 on the faces -x, x, -y, y, -z, z of a box, as in Mitsuba.
BOX_U = np.array([[0, 1, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 1, 0]], dtype=np.float64)
BOX_V = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, 0, -1], [1, 0, 0], [1, 0, 0]], dtype=np.float64)


@inlined
def first_hit(objects: Any, boxes: Any, triangles: Any, start: Any, direction: Any, t_min: Any) -> Any:
    """Return the first object that a ray hits beyond `t_min`; t is in units of the direction's length.

    Returns the number of the object or `NOTHING`, t, and the part hit: the face of a box, the triangle of a foliage
    mesh, or the `LID` of a cylinder.
    """
    nearest, t, part = NOTHING, np.inf, 0
    squared = dot(direction, direction)
    for number in range(len(objects)):
        if _may_hit(objects, number, start, direction, squared):
            hit, hit_part = _intersect(objects, boxes, triangles, number, start, direction, t_min, t, True)
            if hit < t:
                nearest, t, part = number, hit, hit_part
    return nearest, t, part


@inlined
def is_hidden(objects: Any, boxes: Any, triangles: Any, candidates: Any, start: Any, segment: Any, t_min: Any) -> Any:
    """Return whether an object whose bit is set in `candidates` lies on a segment beyond the fraction `t_min` of it."""
    squared = dot(segment, segment)
    for number in range(len(objects)):
        if candidates >> number & 1 and _may_hit(objects, number, start, segment, squared):
            hit, _ = _intersect(objects, boxes, triangles, number, start, segment, t_min, 1.0, False)
            if hit < 1.0:
                return True
    return False


@inlined
def _may_hit(objects: Any, number: Any, start: Any, direction: Any, squared: Any) -> Any:
    """Return whether a line passes through the bounding sphere of an object."""
    to_centre = subtract(load3(objects, number, BOUNDING_SPHERE), start)
    ahead, radius = dot(to_centre, direction), objects[number, BOUNDING_SPHERE + 3]
    return (dot(to_centre, to_centre) - radius * radius) * squared <= ahead * ahead


@inlined
def _intersect(
    objects: Any,
    boxes: Any,
    triangles: Any,
    number: Any,
    start: Any,
    direction: Any,
    t_min: Any,
    t_max: Any,
    nearest: Any,
) -> Any:
    """Return t where a ray hits an object, `t_min` < t < `t_max`, or infinity; and the part that it hits.

    For a mesh, this is the nearest hit if `nearest`, otherwise any.
    """
    p, d = map_point(objects, number, TO_UNIT, start), map_vector(objects, number, TO_UNIT, direction)
    kind = int(objects[number, KIND])
    if kind == RECTANGLE:
        return _hit_plane(p, d, 0.0, False, t_min, t_max), 0
    if kind == SPHERE:
        return _quadratic_roots(dot(d, d), dot(p, d), dot(p, p) - 1.0, t_min, t_max)[0], 0
    if kind == CYLINDER:
        return _hit_cylinder(p, d, t_min, t_max)
    if kind == BOX:
        return _hit_box(p, d, t_min, t_max)
    triangle, hit = nearest_triangle(boxes, triangles, p, d, t_min, t_max, nearest)
    return (hit, triangle) if triangle != NOTHING else (np.inf, 0)


@inlined
def _hit_plane(p: Any, d: Any, height: Any, is_disc: Any, t_min: Any, t_max: Any) -> Any:
    """Return t where a ray meets the square from -1 to 1, or the unit disc, at a height z; infinity without a hit."""
    hit = (height - p[2]) / d[2]
    if not t_min < hit < t_max:
        return np.inf
    x, y = p[0] + hit * d[0], p[1] + hit * d[1]
    inside = x * x + y * y <= 1.0 if is_disc else abs(x) <= 1.0 and abs(y) <= 1.0
    return hit if inside else np.inf


@inlined
def _quadratic_roots(a: Any, b: Any, c: Any, t_min: Any, t_max: Any) -> Any:
    """Return the two ordered solutions of a t^2 + 2 b t + c = 0 between `t_min` and `t_max`; infinite if missing."""
    root = b * b - a * c
    if root < 0.0:
        return np.inf, np.inf
    root = np.sqrt(root)
    near, far = (-b - root) / a, (-b + root) / a
    far = far if t_min < far < t_max else np.inf
    return (near, far) if t_min < near < t_max else (far, np.inf)


@inlined
def _hit_cylinder(p: Any, d: Any, t_min: Any, t_max: Any) -> Any:
    near, far = _quadratic_roots(
        d[0] * d[0] + d[1] * d[1], p[0] * d[0] + p[1] * d[1], p[0] * p[0] + p[1] * p[1] - 1.0, t_min, t_max
    )
    side = np.inf
    if near < np.inf and abs(p[2] + near * d[2]) <= 1.0:
        side = near
    elif far < np.inf and abs(p[2] + far * d[2]) <= 1.0:
        side = far
    lid = _hit_plane(p, d, 1.0, True, t_min, t_max)
    return (lid, LID) if lid < side else (side, 0)


@inlined
def _hit_box(p: Any, d: Any, t_min: Any, t_max: Any) -> Any:
    """Return t where a ray enters the box from -1 to 1, and the face."""
    x, y, z = 1.0 / d[0], 1.0 / d[1], 1.0 / d[2]
    x_entry, y_entry, z_entry = -p[0] * x - abs(x), -p[1] * y - abs(y), -p[2] * z - abs(z)
    exit_t = min(-p[0] * x + abs(x), -p[1] * y + abs(y), -p[2] * z + abs(z))
    entry = max(x_entry, y_entry, z_entry)
    if not (entry <= exit_t and t_min < entry < t_max):
        return np.inf, 0
    if entry == x_entry:
        return entry, 0 if x > 0.0 else 1
    if entry == y_entry:
        return entry, 2 if y > 0.0 else 3
    return entry, 4 if z > 0.0 else 5


@inlined
def normal_at(objects: Any, triangles: Any, number: Any, part: Any, point: Any) -> Any:
    """Return the unnormalized normal of an object's part at a point: outward, or to either side of a flat object."""
    kind = int(objects[number, KIND])
    if kind == RECTANGLE or (kind == CYLINDER and part == LID):
        return load3(objects, number, TO_UNIT + 8)
    if kind == BOX:
        return load3(objects, number, TO_UNIT + 4 * (part // 2))
    if kind == TRIANGLES:
        return map_normal(objects, number, TO_UNIT, cross(load3(triangles, part, 3), load3(triangles, part, 6)))
    p = map_point(objects, number, TO_UNIT, point)
    return map_normal(objects, number, TO_UNIT, (p[0], p[1], p[2] if kind == SPHERE else 0.0))


@inlined
def texture_uv(objects: Any, number: Any, part: Any, point: Any, right: Any, down: Any) -> Any:
    """Return texture coordinates (2,) at a point of an object, and their changes along `right` and `down`."""
    kind = int(objects[number, KIND])
    p = map_point(objects, number, TO_UNIT, point)
    a, b = map_vector(objects, number, TO_UNIT, right), map_vector(objects, number, TO_UNIT, down)
    if kind == RECTANGLE:
        uv = (0.5 + 0.5 * p[0], 0.5 + 0.5 * p[1])
        return uv, (0.5 * a[0], 0.5 * a[1]), (0.5 * b[0], 0.5 * b[1])
    if kind == BOX:
        u, v = load3(BOX_U, part, 0), load3(BOX_V, part, 0)
        uv = (0.5 + 0.5 * dot(u, p), 0.5 + 0.5 * dot(v, p))
        return uv, (0.5 * dot(u, a), 0.5 * dot(v, a)), (0.5 * dot(u, b), 0.5 * dot(v, b))
    squared = max(p[0] * p[0] + p[1] * p[1], 1e-12)
    turns = np.arctan2(p[1], p[0]) / (2.0 * np.pi)
    turns = turns if turns >= 0.0 else turns + 1.0
    d_turns = 1.0 / (2.0 * np.pi * squared)
    turns_a, turns_b = (p[0] * a[1] - p[1] * a[0]) * d_turns, (p[0] * b[1] - p[1] * b[0]) * d_turns
    radius = np.sqrt(squared)
    if kind == SPHERE:
        height_scale = -1.0 / (np.pi * radius)
        height = np.arccos(min(max(p[2], -1.0), 1.0)) / np.pi
        return (turns, height), (turns_a, height_scale * a[2]), (turns_b, height_scale * b[2])
    if part == LID:
        radius_a, radius_b = (p[0] * a[0] + p[1] * a[1]) / radius, (p[0] * b[0] + p[1] * b[1]) / radius
        return (radius, turns), (radius_a, turns_a), (radius_b, turns_b)
    return (turns, 0.5 + 0.5 * p[2]), (turns_a, 0.5 * a[2]), (turns_b, 0.5 * b[2])


@inlined
def interpolated_colour(objects: Any, triangles: Any, number: Any, part: Any, point: Any) -> Any:
    """Return the colour of a triangle at a point, interpolated from its corners."""
    p = subtract(map_point(objects, number, TO_UNIT, point), load3(triangles, part, 0))
    a, b = load3(triangles, part, 3), load3(triangles, part, 6)
    aa, ab, bb, pa, pb = dot(a, a), dot(a, b), dot(b, b), dot(p, a), dot(p, b)
    determinant = aa * bb - ab * ab
    first, second = (bb * pa - ab * pb) / determinant, (aa * pb - ab * pa) / determinant
    colour = load3(triangles, part, 9)
    partial = add_scaled(colour, first, subtract(load3(triangles, part, 12), colour))
    return add_scaled(partial, second, subtract(load3(triangles, part, 15), colour))
