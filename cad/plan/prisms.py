"""Convex prisms as plain numbers, from which parts are composed, and their overlap with light beams."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mirrorcam.cad.plan.fasteners import ROOF_DEG
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Frustum:
    """The box between two opposite corners (3,), in the rig frame."""
    (x, y, z), (x1, y1, z1) = low, high
    base = np.array([(x, y, z), (x, y1, z), (x, y1, z1), (x, y, z1)])
    return Frustum(base, base + np.array([x1 - x, 0.0, 0.0]))


def prism_along_x(points: FloatArray, from_mm: float, to_mm: float) -> Frustum:
    """The prism on a convex polygon (n, 2) in y and z, between two x coordinates."""
    base = np.column_stack([np.full(len(points), from_mm), points])
    return Frustum(base, base + np.array([to_mm - from_mm, 0.0, 0.0]))


def prism_along_y(points: FloatArray, from_mm: float, to_mm: float) -> Frustum:
    """The prism on a convex polygon (n, 2) in x and z, between two y coordinates."""
    base = np.column_stack([points[:, 0], np.full(len(points), from_mm), points[:, 1]])
    return Frustum(base, base + np.array([0.0, to_mm - from_mm, 0.0]))


def prism_along_z(points: FloatArray, from_mm: float, to_mm: float) -> Frustum:
    """The prism on a convex polygon (n, 2) in x and y, between two z coordinates."""
    base = np.column_stack([points, np.full(len(points), from_mm)])
    return Frustum(base, base + np.array([0.0, 0.0, to_mm - from_mm]))


def roofed_window(x_mm: tuple[float, float], z_mm: tuple[float, float], y_mm: tuple[float, float]) -> Frustum:
    """A window along y with a steep roof at its larger x, for a part that prints with x up."""
    (low, high), (near, far) = x_mm, z_mm
    ridge = (high + (far - near) / 2.0 / np.tan(np.deg2rad(ROOF_DEG)), (near + far) / 2.0)
    return prism_along_y(np.array([(low, near), (low, far), (high, far), ridge, (high, near)]), *y_mm)


def shifted(solid: Frustum, shift_mm: FloatArray) -> Frustum:
    """A solid shifted by a vector (3,)."""
    return Frustum(solid.base + shift_mm, solid.top + shift_mm)


def corners_of(solids: Iterable[Frustum]) -> FloatArray:
    """All corners (n, 3) of solids."""
    return np.vstack([np.vstack([solid.base, solid.top]) for solid in solids])


def clip_loop(loop: FloatArray, direction: FloatArray, limit: float) -> FloatArray:
    """Clip a flat convex loop (n, k) to the half-space x @ direction <= limit; the loop (m, k) may be empty."""
    clipped = []
    excess = np.array([point @ direction for point in loop]) - limit
    for start, end, a, b in zip(loop, np.roll(loop, -1, axis=0), excess, np.roll(excess, -1), strict=True):
        if a <= 0.0:
            clipped.append(start)
        if a * b < 0.0:
            clipped.append(start + (end - start) * a / (a - b))
    return np.array(clipped).reshape(-1, loop.shape[1])


def volume_mm3(solid: Frustum) -> float:
    """Volume of a solid by the divergence theorem: a pyramid from the origin to each face."""
    return sum(
        float(np.cross(face[i] - face[0], face[i + 1] - face[0]) @ face[0]) / 6.0
        for face in solid.faces
        for i in range(1, len(face) - 1)
    )


def overlap_mm(a: Frustum, b: Frustum) -> float:
    """Penetration depth of two convex solids: the smallest shift that separates them; 0 or less without overlap.

    Separating axis theorem: two convex polyhedra are disjoint exactly if they are separated along a face normal of
    either, or along the cross product of an edge of one and an edge of the other (Gottschalk 1996).
    """
    corners_a, corners_b = np.vstack([a.base, a.top]), np.vstack([b.base, b.top])
    crosses = np.cross(_edges(a)[:, None], _edges(b)[None]).reshape(-1, 3)
    lengths = np.linalg.norm(crosses, axis=1)
    crosses = crosses[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    axes = np.vstack([a.half_spaces[0], b.half_spaces[0], crosses])
    span_a, span_b = corners_a @ axes.T, corners_b @ axes.T
    depths = np.minimum(span_a.max(axis=0) - span_b.min(axis=0), span_b.max(axis=0) - span_a.min(axis=0))
    return float(depths.min())


def _edges(solid: Frustum) -> FloatArray:
    edges = [np.roll(face, -1, axis=0) - face for face in solid.faces]
    directions = np.vstack(edges)
    directions = directions[np.linalg.norm(directions, axis=1) > 1e-9]
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    # Opposite directions define the same axis.
    signs = np.sign(directions[np.arange(len(directions)), np.abs(directions).argmax(axis=1)])
    unique: FloatArray = np.unique((directions * signs[:, None]).round(12), axis=0)
    return unique


def require_clear_of_light(
    name: str, solids: Iterable[Frustum], layout: Layout, light: list[list[Frustum]], remedy: str = ""
) -> None:
    """Raise InputError if a mirror's light enters a solid; the message gives the mirror, the solid and the depth in mm.

    `light` is the result of `plan.seats.keep_outs` for the layout; a mirror's pocket counts as its light. `remedy`
    states what to do.
    """
    worst = (1e-6, 0)
    for solid in solids:
        corners = np.vstack([solid.base, solid.top])
        centre = corners.mean(axis=0)
        radius = float(np.linalg.norm(corners - centre, axis=1).max())
        for index, volumes in enumerate(light):
            for volume in volumes:
                if volume.may_touch_ball(centre, radius):
                    worst = max(worst, (overlap_mm(solid, volume), index))
    if worst[0] > 1e-6:
        mirror = layout.mirror_names[worst[1]]
        finding = f"light of mirror {mirror} enters the {name} by {worst[0]:.1f} mm, but must not touch it"
        raise InputError(f"{finding}: {remedy}" if remedy else finding)
