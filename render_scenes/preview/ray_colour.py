"""What a ray sees: matte surfaces, what glossy ones reflect, and what is seen through a glass ball."""

from __future__ import annotations

from typing import Any

import numpy as np

from mirrorcam.core.compiled import inlined
from mirrorcam.render_scenes.preview.first_hits import first_hit
from mirrorcam.render_scenes.preview.surface_light import facing_normal, own_colour, scattered
from mirrorcam.render_scenes.preview.traced_scene import (
    BOUND,
    FACING,
    FIRST_SIDE,
    GLASS,
    GLOSSY,
    MATERIAL,
    MIDDLE,
    RADIANCE,
    SECOND_SIDE,
    SKY_LIGHT,
)
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING
from mirrorcam.render_scenes.preview.vectors import along, at, cross, dot, minus, times, unit
from mirrorcam.render_scenes.tabletop.objects import GLASS_INDEX

CLEARANCE_MM = 1e-2
"""Of a ray from a ball, so that it does not meet that again."""
GLOSS = 1.03
"""Light that leaves the body of a glossy surface, by that of a matte one and what the surface lets out again."""
REFLECTED_SPREAD, REFRACTED_SPREAD = 4.0, 10.0
"""How much faster rays turn from pixel to pixel when a ball has reflected or refracted them, about."""


@inlined
def ray_colour(scene: Any, start: Any, direction: Any, least: Any, right: Any, down: Any) -> Any:
    """Radiance (3,) along a ray, and what it meets first.

    Parameters
    ----------
    scene
        A `TracedScene`.
    start, direction
        Where the ray starts, and its direction, of any length, to which lengths refer.
    least
        Length from which on things are seen.
    right, down
        How the direction changes from one pixel to the next, to the right and down.

    Returns
    -------
    tuple
        Red, green and blue; the number of the object or `NOTHING`; its part; and the length, infinite of nothing.
    """
    number, length, part = first_hit(scene.objects, scene.boxes, scene.triangles, start, direction, least)
    if number == NOTHING:
        return at(scene.around, SKY_LIGHT, 0), number, part, length
    point = along(start, length, direction)
    normal = facing_normal(scene, number, part, point, direction)
    material = int(scene.objects[number, MATERIAL])
    if material == GLASS:
        return _through_ball(scene, number, point, normal, direction, right), number, part, length
    light = scattered(scene, number, part, point, normal, direction, times(right, length), times(down, length), True)
    if material == GLOSSY:
        towards = unit(direction)
        share = _reflected_share(-dot(normal, towards))
        out = along(towards, -2.0 * dot(normal, towards), normal)
        seen = _second_colour(
            scene, point, out, REFLECTED_SPREAD * np.sqrt(dot(right, right) / dot(direction, direction)), False
        )
        light = along(times(light, GLOSS * (1.0 - share)), share, seen)
    return light, number, part, length


@inlined
def _reflected_share(cosine: Any) -> Any:
    """Share of unpolarised light that glass reflects (Fresnel's equations), from outside."""
    inner = np.sqrt(1.0 - (1.0 - cosine * cosine) / (GLASS_INDEX * GLASS_INDEX))
    across = (cosine - GLASS_INDEX * inner) / (cosine + GLASS_INDEX * inner)
    along_plane = (inner - GLASS_INDEX * cosine) / (inner + GLASS_INDEX * cosine)
    return 0.5 * (across * across + along_plane * along_plane)


@inlined
def _through_ball(scene: Any, number: Any, point: Any, normal: Any, direction: Any, right: Any) -> Any:
    """Radiance from a glass ball: what its front reflects, and what is seen through both its surfaces."""
    towards = unit(direction)
    cosine = -dot(normal, towards)
    share = _reflected_share(cosine)
    turns = np.sqrt(dot(right, right) / dot(direction, direction))
    reflected = _second_colour(scene, point, along(towards, 2.0 * cosine, normal), REFLECTED_SPREAD * turns, False)
    inner_cosine = np.sqrt(1.0 - (1.0 - cosine * cosine) / (GLASS_INDEX * GLASS_INDEX))
    inside = along(times(towards, 1.0 / GLASS_INDEX), cosine / GLASS_INDEX - inner_cosine, normal)
    # A chord meets both ends at the same angle.
    centre, radius = at(scene.objects, number, BOUND), scene.objects[number, BOUND + 3]
    leaves = along(point, 2.0 * radius * inner_cosine, inside)
    outwards = times(minus(leaves, centre), 1.0 / radius)
    out = along(times(inside, GLASS_INDEX), cosine - GLASS_INDEX * inner_cosine, outwards)
    through = _second_colour(scene, leaves, out, REFRACTED_SPREAD * turns, True)
    kept = (1.0 - share) * (1.0 - share)
    return along(times(through, kept), share, reflected)


@inlined
def _second_colour(scene: Any, start: Any, direction: Any, turns: Any, shaded: Any) -> Any:
    """Radiance (3,) of what is seen in or through a ball along a unit vector: of its surface what it scatters alone.

    `turns` is by how much the direction changes from one pixel to the next. What is not to be `shaded` is in no shadow.
    """
    least = CLEARANCE_MM
    number, length, part = first_hit(scene.objects, scene.boxes, scene.triangles, start, direction, least)
    towards = -dot(direction, at(scene.lamp, FACING, 0))
    if towards > 0.0:
        to = minus(at(scene.lamp, MIDDLE, 0), start)
        there = -dot(to, at(scene.lamp, FACING, 0)) / towards
        if 0.0 < there < length:
            off = along(times(to, -1.0), there, direction)
            first, second = at(scene.lamp, FIRST_SIDE, 0), at(scene.lamp, SECOND_SIDE, 0)
            if abs(dot(off, first)) < dot(first, first) and abs(dot(off, second)) < dot(second, second):
                return at(scene.lamp, RADIANCE, 0)
    if number == NOTHING:
        return at(scene.around, SKY_LIGHT, 0)
    point = along(start, length, direction)
    normal = facing_normal(scene, number, part, point, direction)
    wide = turns * length
    # Two directions across the ray, as footprints of it.
    side = (direction[2], 0.0, -direction[0])
    if dot(side, side) < 1e-6:
        side = (1.0, 0.0, 0.0)
    side = times(unit(side), wide)
    other = cross(direction, side)
    if int(scene.objects[number, MATERIAL]) == GLASS:
        return own_colour(scene, number, part, point, normal, direction, side, other)
    return scattered(scene, number, part, point, normal, direction, side, other, shaded)
