"""What a layout must satisfy, as smooth expressions in CasADi; all lengths in units of the design's scale.

Convex bodies keep apart by an unknown plane between them: they are at least g apart exactly when some plane has one
body below it and the other at least g above it. This is exact for mirror sheets and for the light that they pass on,
needs no guess of which edge faces which, and lets a neighbour stand behind a mirror.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from optics.camera import Camera
from optics.design.program import Expression, Program
from optics.values import FloatArray

MARGIN = 1e-6
"""Kept beyond every limit (in scales), so that the rounded layout still satisfies it."""

CORNERS = 4
LEAST_TURN = 1e-3
"""Smallest turn at a corner of a sub-image, as the area its two edges span, relative to that at the start."""

LEAST_INCIDENCE = 0.1


@dataclass(frozen=True)
class MirrorUnknown:
    """One mirror: virtual centre (3), corners in normalized coordinates (2), points of its face and of its sheet (3).

    `sheet` holds the corners of the reflecting face followed by those of the other one.
    """

    centre: Expression
    corners: list[Expression]
    face: list[Expression]
    sheet: list[Expression]


def turn(a: Expression, b: Expression) -> Expression:
    """The 2-D cross product."""
    return a[0] * b[1] - a[1] * b[0]


def reflected(point: Expression, centre: Expression) -> Expression:
    """A point (3) reflected at the plane of a virtual centre (3)."""
    return point - 2.0 * (ca.dot(point, centre) / ca.dot(centre, centre) - 0.5) * centre


def polygon_area(vertices: list[Expression]) -> Expression:
    """Signed area of a polygon (shoelace), positive when it runs from +x to +y."""
    return 0.5 * sum(turn(a, b) for a, b in pairwise([*vertices, vertices[0]]))


def pixels(camera: Camera, normalized: Expression) -> Expression:
    """Brown-Conrady distortion and intrinsics, as `Camera.pixels_from_normalized`."""
    x, y = normalized[0], normalized[1]
    k1, k2, p1, p2, k3 = (float(k) for k in camera.distortion)
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return ca.vertcat(camera.fx_px * xd + camera.cx_px, camera.fy_px * yd + camera.cy_px)


def subdivided(vertices: list[Expression], per_edge: int) -> list[Expression]:
    """The outline of a polygon with `per_edge` points on each edge, the vertex among them."""
    return [a + (b - a) * (step / per_edge) for a, b in pairwise([*vertices, vertices[0]]) for step in range(per_edge)]


def add_mirror(
    program: Program, centre: FloatArray, corners: FloatArray, *, reach: float, bounds: FloatArray, back: float
) -> MirrorUnknown:
    """A mirror as a convex quadrilateral of unknown corners (4, 2) on the plane of an unknown virtual centre (3,).

    The centre stays within `reach` of its start along each axis, corners within `bounds` ((low), (high)); the sheet
    extends by `back` from the reflecting face, away from the pupil where positive.
    """
    centre_unknown = program.unknown(centre, centre - reach, centre + reach)
    quad = [program.unknown(corner, bounds[0], bounds[1]) for corner in corners]
    squared = ca.dot(centre_unknown, centre_unknown)
    face = []
    for corner in quad:
        ray = ca.vertcat(corner, 1.0)
        towards = ca.dot(ray, centre_unknown)
        program.require(towards - LEAST_INCIDENCE)
        face.append(ray * (0.5 * squared / towards))
    edges = [b - a for a, b in pairwise([*quad, quad[0]])]
    tile_area = float(np.prod(corners.max(axis=0) - corners.min(axis=0)))
    for before, after in pairwise([*edges, edges[0]]):
        program.require(turn(before, after) / tile_area - LEAST_TURN)
    length = ca.sqrt(squared)
    # A second-surface sheet lies before its reflecting face; the pupil must lie before the sheet.
    program.require(length / 2.0 + min(back, 0.0) - MARGIN, "occlusion")
    offset = centre_unknown / length * back
    return MirrorUnknown(centre_unknown, quad, face, [*face, *(point + offset for point in face)])


def keep_on_sensor(program: Program, camera: Camera, mirror: MirrorUnknown) -> None:
    """With distortion, edges bend: points along them stay on the sensor. Without, the corners' bounds are enough."""
    if not camera.distortion.any():
        return
    margin_px = 0.25
    for point in subdivided(mirror.corners, 8):
        pixel = pixels(camera, point)
        inside = ca.vertcat(pixel + 0.5, ca.DM([camera.width_px, camera.height_px]) - 0.5 - pixel)
        program.require((inside - margin_px) / camera.width_px)


def keep_nearer_than(program: Program, mirror: MirrorUnknown, depth: float) -> None:
    """The mirror stays on the camera's side of the plane y = depth."""
    for point in mirror.sheet:
        program.require(depth - point[1] - MARGIN, "depth")


def add_overlap(
    program: Program,
    mirrors: list[MirrorUnknown],
    depth: float,
    *,
    aim: FloatArray,
    half_size: FloatArray,
    vertex_count: int = 8,
) -> list[list[Expression]]:
    """A polygon on the plane y = depth that every mirror shows whole; returns it as each mirror shows it, normalized.

    Each vertex keeps to its own sector about an unknown middle, so the polygon is star-shaped and winds once. It
    starts at `aim` (x, z) with a size that looks `half_size` (tangents) from there. Unknowns are tangents too, which
    keeps them of one size at any depth.
    """
    around = 2.0 * np.pi * (np.arange(vertex_count) + 0.5) / vertex_count
    centre = program.unknown([0.0, 0.0])
    scene = []
    for angle in around:
        vertex = program.unknown(half_size * [np.cos(angle), np.sin(angle)])
        spoke = (vertex - centre) / ca.DM(half_size)
        for side in (-1.0, 1.0):
            border = angle + side * np.pi / vertex_count
            program.require(-side * turn(ca.DM([np.cos(border), np.sin(border)]), spoke))
        at = ca.DM(aim) + vertex * (1.0 + depth)
        scene.append(ca.vertcat(at[0], depth, at[1]))
    seen = []
    tile_area = float(4.0 * np.prod(half_size))
    for mirror in mirrors:
        images = [reflected(point, mirror.centre) for point in scene]
        seen.append([point[:2] / point[2] for point in images])
        for a, b in pairwise([*mirror.corners, mirror.corners[0]]):
            for point in seen[-1]:
                program.require(turn(b - a, point - a) / tile_area, "overlap")
    return seen


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)


def _plane(program: Program, normal: FloatArray, offset: float) -> tuple[Expression, Expression]:
    n, d = program.unknown(normal, -1.0, 1.0), program.unknown(offset)
    # A normal of almost unit length, so that what a slack measures is a length to within a tenth.
    program.require(1.0 - ca.dot(n, n))
    program.require(ca.dot(n, n) - 0.81)
    return n, d


def keep_sheets_apart(
    program: Program, first: MirrorUnknown, second: MirrorUnknown, gap: float, *, middles: tuple[FloatArray, FloatArray]
) -> None:
    """Two sheets stay at least `gap` apart; `middles` (3,) are where the mirrors start."""
    a, b = middles
    normal = _unit(b - a)
    n, d = _plane(program, normal, float(normal @ (a + b)) / 2.0)
    for point in first.sheet:
        program.require(d - ca.dot(n, point))
    for point in second.sheet:
        program.require(ca.dot(n, point) - d - gap - MARGIN, "spacing")


def keep_light_free(
    program: Program,
    light: MirrorUnknown,
    other: MirrorUnknown,
    gap: float,
    *,
    start_centre: FloatArray,
    start_rays: tuple[FloatArray, FloatArray],
) -> None:
    """No part of `other` reaches into the light of `light`, on its way in or out.

    On its way in, light fills the pyramid from the pupil to the face, and the other face keeps `gap` from it: that is
    the gap as the camera sees it. On its way out it fills the beam from the virtual centre through the face, to
    infinity. `start_rays` are the chief rays (u, v, 1) of both at the start.
    """
    ray, other_ray = start_rays
    normal = _unit(other_ray - ray - (other_ray - ray) @ (ray + other_ray) / 2.0 * np.array([0.0, 0.0, 1.0]))
    n, d = _plane(program, normal, 0.0)
    program.require(d)
    for point in light.face:
        program.require(d - ca.dot(n, point))
    for k, point in enumerate(other.sheet):
        clear = ca.dot(n, point) - d - MARGIN
        program.require(clear, "occlusion")
        if k < CORNERS:
            program.require(clear - gap, "spacing")

    c = start_centre
    turned = normal - 2.0 * (normal @ c) / (c @ c) * c
    n, d = _plane(program, turned, float(turned @ c))
    for point in light.face:
        program.require(d - ca.dot(n, point))
        program.require(-ca.dot(n, point - light.centre))
    for point in other.sheet:
        program.require(ca.dot(n, point) - d - MARGIN, "occlusion")
