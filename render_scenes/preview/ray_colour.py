"""Radiance along a ray that hits a matte, glossy, glass or printed surface.

Surfaces are lit by the lamp (with shadows), by the sky and, approximately, by each other.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mirrorcam.core.compiled import inlined
from mirrorcam.render_scenes.preview.first_hits import corner_colour, first_hit, is_hidden, normal_at, texture_uv
from mirrorcam.render_scenes.preview.traced_scene import (
    BOUND,
    COLOUR,
    FACING,
    FIRST_SIDE,
    FLOOR_LIGHT,
    GLASS,
    GLOSSY,
    GLOW,
    KIND,
    MATERIAL,
    MIDDLE,
    OPAQUE,
    OWNER,
    PLACES,
    PLAIN,
    POINTS,
    PRINTED,
    RADIANCE,
    RADIUS,
    SECOND_SIDE,
    SHADES,
    SKY_LIGHT,
    TEXTURE,
    TRIANGLES,
    WALL_LIGHT,
    mean_colour,
)
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING, along, at, cross, dot, minus, times, unit
from mirrorcam.render_scenes.tabletop.objects import GLASS_INDEX

CLEARANCE = 1e-4
"""Ignored fraction at the start of a segment from a surface, so that the surface does not shade itself."""


@inlined
def facing_normal(scene: Any, number: Any, part: Any, point: Any, direction: Any) -> Any:
    """Return the unit normal of an object at a point, on the side of the incident ray."""
    normal = unit(normal_at(scene.objects, scene.triangles, number, part, point))
    return times(normal, -1.0) if dot(normal, direction) > 0.0 else normal


@inlined
def own_colour(
    scene: Any, number: Any, part: Any, point: Any, normal: Any, direction: Any, right: Any, down: Any
) -> Any:
    """Return the mean colour of an object over the footprint of a ray at a point.

    `right` and `down` are the offsets, mm, to the rays of the adjacent pixels before they meet the surface.
    """
    objects = scene.objects
    if int(objects[number, KIND]) == TRIANGLES:
        return corner_colour(objects, scene.triangles, number, part, point)
    texture = int(objects[number, TEXTURE])
    if texture == PLAIN:
        return at(objects, number, COLOUR)
    slope = 1.0 / dot(normal, direction)
    right = along(right, -dot(normal, right) * slope, direction)
    down = along(down, -dot(normal, down) * slope, direction)
    uv, uv_right, uv_down = texture_uv(objects, number, part, point, right, down)
    return mean_colour(scene.texels, scene.scales, scene.textures, texture, uv, uv_right, uv_down)


@inlined
def scattered(
    scene: Any, number: Any, part: Any, point: Any, normal: Any, direction: Any, right: Any, down: Any, shaded: Any
) -> Any:
    """Return the radiance (3,) that a matte surface scatters against a ray, or that a print emits.

    Shadows of the lamp are computed only if `shaded`.
    """
    colour = own_colour(scene, number, part, point, normal, direction, right, down)
    if int(scene.objects[number, MATERIAL]) == PRINTED:
        return colour
    lamp = _lamp_light(scene.objects, scene.boxes, scene.triangles, scene.lamp, number, point, normal, shaded)
    around = _light_around(scene.around, scene.balls, number, point, normal)
    light = along(around, lamp / np.pi, at(scene.lamp, RADIANCE, 0))
    return (colour[0] * light[0], colour[1] * light[1], colour[2] * light[2])


@inlined
def _lamp_light(
    objects: Any, boxes: Any, triangles: Any, lamp: Any, number: Any, point: Any, normal: Any, shaded: Any
) -> Any:
    """Return the irradiance per radiance of the lamp, as from its centre, times its visible fraction."""
    to_lamp = minus(at(lamp, MIDDLE, 0), point)
    squared = dot(to_lamp, to_lamp)
    from_surface, from_lamp = dot(normal, to_lamp), -dot(at(lamp, FACING, 0), to_lamp)
    if from_surface <= 0.0 or from_lamp <= 0.0:
        return 0.0
    side = at(lamp, FIRST_SIDE, 0)
    half_squared = dot(side, side)
    light = 4.0 * half_squared * from_surface * from_lamp / (squared * squared)
    if not shaded:
        return light
    # Only objects that meet the cone around the lamp can hide it.
    reach = np.sqrt(2.0 * half_squared)
    suspects = 0
    for other in range(len(objects)):
        if objects[other, SHADES] == 0.0 or (other == number and int(objects[other, KIND]) != TRIANGLES):
            continue
        to = minus(at(objects, other, BOUND), point)
        fraction = min(max(dot(to, to_lamp) / squared, 0.0), 1.0)
        limit = objects[other, BOUND + 3] + fraction * reach
        if dot(to, to) - fraction * (2.0 * dot(to, to_lamp) - fraction * squared) < limit * limit:
            suspects |= 1 << other
    if suspects == 0:
        return light
    visible, tested = 0, 0
    # The mutual shadows of leaves are so irregular that few samples suffice.
    irregular = int(objects[number, KIND]) == TRIANGLES
    for row in range(POINTS, len(lamp)):
        # If the first points are all visible or all hidden, the others are assumed to be.
        if tested == FIRST_POINTS and (irregular or visible == 0 or visible == tested):
            break
        to_point = minus(at(lamp, row, 0), point)
        if not is_hidden(objects, boxes, triangles, suspects, point, to_point, CLEARANCE):
            visible += 1
        tested += 1
    return light * visible / tested


@inlined
def _light_around(around: Any, balls: Any, number: Any, point: Any, normal: Any) -> Any:
    """Return the cosine-weighted mean radiance of sky, floor, wall and objects around a point."""
    light = at(around, SKY_LIGHT, 0)
    if around[PLACES, 0] < np.inf:
        floor = 0.5 * (1.0 + normal[1]) * FLOOR_SHARE
        light = along(light, floor, minus(at(around, FLOOR_LIGHT, 0), light))
    if around[PLACES, 1] < np.inf:
        wall = 0.5 * (1.0 + normal[2]) * WALL_SHARE
        light = along(light, wall, minus(at(around, WALL_LIGHT, 0), light))
    for ball in range(len(balls)):
        if balls[ball, OWNER] == number:
            continue
        to = minus(at(balls, ball, 0), point)
        squared, radius = dot(to, to), balls[ball, RADIUS]
        facing = dot(normal, to)
        if facing <= -radius or squared > FAR_RADII * FAR_RADII * radius * radius:
            continue
        # A sphere that the horizon halves gives about half its light; otherwise the cosine of its centre counts.
        facing = max(facing, 0.25 * (facing + radius))
        fraction = balls[ball, OPAQUE] * facing * radius * radius / (squared * np.sqrt(squared))
        light = along(light, min(fraction, 1.0), minus(at(balls, ball, GLOW), light))
    return light


FAR_RADII = 7.0
"""Distance, in radii of a ball, beyond which its occlusion is neglected: at most 2 % of the light."""
FIRST_POINTS = 4
"""Number of points of the lamp that are always tested."""
FLOOR_SHARE, WALL_SHARE = 0.8, 0.7
"""Fractions of the half spaces below and behind that the floor and the wall fill."""


CLEARANCE_MM = 1e-2
"""Offset of a ray from a ball, so that it does not meet the ball again."""
GLOSS = 1.03
"""Diffuse light of a glossy surface, with internal reflection, relative to a matte one."""
REFLECTED_SPREAD, REFRACTED_SPREAD = 4.0, 10.0
"""Approximate factor by which a ball spreads the rays of adjacent pixels when it reflects or refracts them."""


@inlined
def ray_colour(scene: Any, start: Any, direction: Any, least: Any, right: Any, down: Any) -> Any:
    """Return the radiance (3,) along a ray, and its first hit.

    Parameters
    ----------
    scene
        A `TracedScene`.
    start, direction
        Start and direction of the ray; lengths are in units of the direction's length.
    least
        Smallest length of a hit.
    right, down
        Changes of the direction from this pixel to the next on the right and below.

    Returns
    -------
    tuple
        Radiance (3,); number of the object or `NOTHING`; its part; and the length, infinite without a hit.
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
        mirrored = along(towards, -2.0 * dot(normal, towards), normal)
        seen = _second_colour(
            scene, point, mirrored, REFLECTED_SPREAD * np.sqrt(dot(right, right) / dot(direction, direction)), False
        )
        light = along(times(light, GLOSS * (1.0 - share)), share, seen)
    return light, number, part, length


@inlined
def _reflected_share(cosine: Any) -> Any:
    """Return the reflectance of glass for unpolarised light from outside (Fresnel's equations)."""
    inner = np.sqrt(1.0 - (1.0 - cosine * cosine) / (GLASS_INDEX * GLASS_INDEX))
    s_wave = (cosine - GLASS_INDEX * inner) / (cosine + GLASS_INDEX * inner)
    p_wave = (inner - GLASS_INDEX * cosine) / (inner + GLASS_INDEX * cosine)
    return 0.5 * (s_wave * s_wave + p_wave * p_wave)


@inlined
def _through_ball(scene: Any, number: Any, point: Any, normal: Any, direction: Any, right: Any) -> Any:
    """Return the radiance from a glass ball: reflected at its front, and refracted at both surfaces."""
    towards = unit(direction)
    cosine = -dot(normal, towards)
    share = _reflected_share(cosine)
    angle = np.sqrt(dot(right, right) / dot(direction, direction))
    reflected = _second_colour(scene, point, along(towards, 2.0 * cosine, normal), REFLECTED_SPREAD * angle, False)
    inner_cosine = np.sqrt(1.0 - (1.0 - cosine * cosine) / (GLASS_INDEX * GLASS_INDEX))
    inside = along(times(towards, 1.0 / GLASS_INDEX), cosine / GLASS_INDEX - inner_cosine, normal)
    # A chord makes the same angle with the sphere at both ends.
    centre, radius = at(scene.objects, number, BOUND), scene.objects[number, BOUND + 3]
    exit_point = along(point, 2.0 * radius * inner_cosine, inside)
    outwards = times(minus(exit_point, centre), 1.0 / radius)
    refracted = along(times(inside, GLASS_INDEX), cosine - GLASS_INDEX * inner_cosine, outwards)
    through = _second_colour(scene, exit_point, refracted, REFRACTED_SPREAD * angle, True)
    transmittance = (1.0 - share) * (1.0 - share)
    return along(times(through, transmittance), share, reflected)


@inlined
def _second_colour(scene: Any, start: Any, direction: Any, angle: Any, shaded: Any) -> Any:
    """Return the radiance (3,) along a reflected or refracted ray, a unit vector; it is not reflected again.

    `angle` is the change of the direction from one pixel to the next, rad. Shadows are computed only if `shaded`.
    """
    least = CLEARANCE_MM
    number, length, part = first_hit(scene.objects, scene.boxes, scene.triangles, start, direction, least)
    towards = -dot(direction, at(scene.lamp, FACING, 0))
    if towards > 0.0:
        to = minus(at(scene.lamp, MIDDLE, 0), start)
        hit = -dot(to, at(scene.lamp, FACING, 0)) / towards
        if 0.0 < hit < length:
            offset = along(times(to, -1.0), hit, direction)
            first, second = at(scene.lamp, FIRST_SIDE, 0), at(scene.lamp, SECOND_SIDE, 0)
            if abs(dot(offset, first)) < dot(first, first) and abs(dot(offset, second)) < dot(second, second):
                return at(scene.lamp, RADIANCE, 0)
    if number == NOTHING:
        return at(scene.around, SKY_LIGHT, 0)
    point = along(start, length, direction)
    normal = facing_normal(scene, number, part, point, direction)
    width = angle * length
    # Two sides of the footprint, perpendicular to the ray.
    side = (direction[2], 0.0, -direction[0])
    if dot(side, side) < 1e-6:
        side = (1.0, 0.0, 0.0)
    side = times(unit(side), width)
    other = cross(direction, side)
    if int(scene.objects[number, MATERIAL]) == GLASS:
        return own_colour(scene, number, part, point, normal, direction, side, other)
    return scattered(scene, number, part, point, normal, direction, side, other, shaded)
