"""Radiance along a ray that hits a matte, glossy, glass or printed surface.

Surfaces are lit by the lamp (with shadows), by the sky and, approximately, by each other.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mirrorcam.core.compiled import inlined
from mirrorcam.render_scenes.preview.first_hits import first_hit, interpolated_colour, is_hidden, normal_at, texture_uv
from mirrorcam.render_scenes.preview.traced_scene import (
    BOUNDING_SPHERE,
    COLOUR,
    FACING,
    FIRST_SIDE,
    FLOOR_LIGHT,
    GLASS,
    GLOSSY,
    GLOW,
    KIND,
    LAMP_CENTRE,
    MATERIAL,
    OPACITY,
    OWNER,
    PLAIN,
    POINTS,
    POSITIONS,
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
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING, add_scaled, cross, dot, load3, scale, subtract, unit
from mirrorcam.render_scenes.tabletop.objects import GLASS_INDEX

CLEARANCE = 1e-4
"""Fraction of a segment from a surface that is ignored at its start, so that the surface does not shadow itself."""


@inlined
def facing_normal(scene: Any, number: Any, part: Any, point: Any, direction: Any) -> Any:
    """Return the unit normal of an object at a point, on the side of the incident ray."""
    normal = unit(normal_at(scene.objects, scene.triangles, number, part, point))
    return scale(normal, -1.0) if dot(normal, direction) > 0.0 else normal


@inlined
def surface_colour(
    scene: Any, number: Any, part: Any, point: Any, normal: Any, direction: Any, right: Any, down: Any
) -> Any:
    """Return the mean colour of an object over the footprint of a ray at a point.

    `right` and `down` are the offsets, mm, to the rays of the adjacent pixels, before projection onto the surface.
    """
    objects = scene.objects
    if int(objects[number, KIND]) == TRIANGLES:
        return interpolated_colour(objects, scene.triangles, number, part, point)
    texture = int(objects[number, TEXTURE])
    if texture == PLAIN:
        return load3(objects, number, COLOUR)
    scale_to_plane = 1.0 / dot(normal, direction)
    right = add_scaled(right, -dot(normal, right) * scale_to_plane, direction)
    down = add_scaled(down, -dot(normal, down) * scale_to_plane, direction)
    uv, uv_right, uv_down = texture_uv(objects, number, part, point, right, down)
    return mean_colour(scene.texels, scene.scales, scene.textures, texture, uv, uv_right, uv_down)


@inlined
def scattered_light(
    scene: Any, number: Any, part: Any, point: Any, normal: Any, direction: Any, right: Any, down: Any, shadows: Any
) -> Any:
    """Return the radiance (3,) that a matte surface scatters back along a ray, or that a print emits.

    Shadows of the lamp are computed only if `shadows`.
    """
    colour = surface_colour(scene, number, part, point, normal, direction, right, down)
    if int(scene.objects[number, MATERIAL]) == PRINTED:
        return colour
    lamp = _lamp_light(scene.objects, scene.boxes, scene.triangles, scene.lamp, number, point, normal, shadows)
    ambient = _ambient_light(scene.surroundings, scene.balls, number, point, normal)
    light = add_scaled(ambient, lamp / np.pi, load3(scene.lamp, RADIANCE, 0))
    return (colour[0] * light[0], colour[1] * light[1], colour[2] * light[2])


@inlined
def _lamp_light(
    objects: Any, boxes: Any, triangles: Any, lamp: Any, number: Any, point: Any, normal: Any, shadows: Any
) -> Any:
    """Return the irradiance per radiance of the lamp, as if all came from its centre, times its visible fraction."""
    to_lamp = subtract(load3(lamp, LAMP_CENTRE, 0), point)
    squared = dot(to_lamp, to_lamp)
    from_surface, from_lamp = dot(normal, to_lamp), -dot(load3(lamp, FACING, 0), to_lamp)
    if from_surface <= 0.0 or from_lamp <= 0.0:
        return 0.0
    side = load3(lamp, FIRST_SIDE, 0)
    half_squared = dot(side, side)
    light = 4.0 * half_squared * from_surface * from_lamp / (squared * squared)
    if not shadows:
        return light
    # Only objects that meet the cone around the lamp can hide it.
    lamp_radius = np.sqrt(2.0 * half_squared)
    candidates = 0
    for other in range(len(objects)):
        if objects[other, SHADES] == 0.0 or (other == number and int(objects[other, KIND]) != TRIANGLES):
            continue
        offset = subtract(load3(objects, other, BOUNDING_SPHERE), point)
        fraction = min(max(dot(offset, to_lamp) / squared, 0.0), 1.0)
        limit = objects[other, BOUNDING_SPHERE + 3] + fraction * lamp_radius
        if dot(offset, offset) - fraction * (2.0 * dot(offset, to_lamp) - fraction * squared) < limit * limit:
            candidates |= 1 << other
    if candidates == 0:
        return light
    visible, tested = 0, 0
    # The mutual shadows of leaves are so irregular that few samples suffice.
    irregular = int(objects[number, KIND]) == TRIANGLES
    for row in range(POINTS, len(lamp)):
        # If the first points are all visible or all hidden, the others are assumed to be.
        if tested == FIRST_POINTS and (irregular or visible == 0 or visible == tested):
            break
        to_point = subtract(load3(lamp, row, 0), point)
        if not is_hidden(objects, boxes, triangles, candidates, point, to_point, CLEARANCE):
            visible += 1
        tested += 1
    return light * visible / tested


@inlined
def _ambient_light(surroundings: Any, balls: Any, number: Any, point: Any, normal: Any) -> Any:
    """Return the cosine-weighted mean radiance of sky, floor, wall and objects around a point."""
    light = load3(surroundings, SKY_LIGHT, 0)
    if surroundings[POSITIONS, 0] < np.inf:
        floor = 0.5 * (1.0 + normal[1]) * FLOOR_FRACTION
        light = add_scaled(light, floor, subtract(load3(surroundings, FLOOR_LIGHT, 0), light))
    if surroundings[POSITIONS, 1] < np.inf:
        wall = 0.5 * (1.0 + normal[2]) * WALL_FRACTION
        light = add_scaled(light, wall, subtract(load3(surroundings, WALL_LIGHT, 0), light))
    for ball in range(len(balls)):
        if balls[ball, OWNER] == number:
            continue
        offset = subtract(load3(balls, ball, 0), point)
        squared, radius = dot(offset, offset), balls[ball, RADIUS]
        facing = dot(normal, offset)
        if facing <= -radius or squared > FAR_RADII * FAR_RADII * radius * radius:
            continue
        # A sphere halved by the horizon gives about half its light; otherwise the cosine at its centre counts.
        facing = max(facing, 0.25 * (facing + radius))
        fraction = balls[ball, OPACITY] * facing * radius * radius / (squared * np.sqrt(squared))
        light = add_scaled(light, min(fraction, 1.0), subtract(load3(balls, ball, GLOW), light))
    return light


FAR_RADII = 7.0
"""Distance, in radii of a ball, beyond which its occlusion is neglected: at most 2 % of the light."""
FIRST_POINTS = 4
"""Number of points of the lamp that are always tested."""
FLOOR_FRACTION, WALL_FRACTION = 0.8, 0.7
"""Fractions of the half-spaces below and behind the scene that the floor and the wall fill."""


CLEARANCE_MM = 1e-2
"""Offset of the start of a secondary ray, so that it does not hit its own ball again."""
GLOSS = 1.03
"""Diffuse light of a glossy surface, including internal reflection, relative to a matte one."""
REFLECTED_SPREAD, REFRACTED_SPREAD = 4.0, 10.0
"""Approximate factor by which a ball spreads the rays of adjacent pixels when it reflects or refracts them."""


@inlined
def ray_colour(scene: Any, start: Any, direction: Any, t_min: Any, right: Any, down: Any) -> Any:
    """Return the radiance (3,) along a ray, and its first hit.

    Parameters
    ----------
    scene
        A `TracedScene`.
    start, direction
        Start and direction of the ray; t is in units of the direction's length.
    t_min
        Minimum t of a hit.
    right, down
        Changes of the direction from this pixel to the next on the right and below.

    Returns
    -------
    tuple
        Radiance (3,); number of the object or `NOTHING`; its part; and t, infinite without a hit.
    """
    number, t, part = first_hit(scene.objects, scene.boxes, scene.triangles, start, direction, t_min)
    if number == NOTHING:
        return load3(scene.surroundings, SKY_LIGHT, 0), number, part, t
    point = add_scaled(start, t, direction)
    normal = facing_normal(scene, number, part, point, direction)
    material = int(scene.objects[number, MATERIAL])
    if material == GLASS:
        return _through_ball(scene, number, point, normal, direction, right), number, part, t
    light = scattered_light(scene, number, part, point, normal, direction, scale(right, t), scale(down, t), True)
    if material == GLOSSY:
        towards = unit(direction)
        reflectance = _fresnel_reflectance(-dot(normal, towards))
        mirror_direction = add_scaled(towards, -2.0 * dot(normal, towards), normal)
        angle = np.sqrt(dot(right, right) / dot(direction, direction))
        reflected = _secondary_colour(scene, point, mirror_direction, REFLECTED_SPREAD * angle, False)
        light = add_scaled(scale(light, GLOSS * (1.0 - reflectance)), reflectance, reflected)
    return light, number, part, t


@inlined
def _fresnel_reflectance(cosine: Any) -> Any:
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
    reflectance = _fresnel_reflectance(cosine)
    angle = np.sqrt(dot(right, right) / dot(direction, direction))
    mirror_direction = add_scaled(towards, 2.0 * cosine, normal)
    reflected = _secondary_colour(scene, point, mirror_direction, REFLECTED_SPREAD * angle, False)
    inner_cosine = np.sqrt(1.0 - (1.0 - cosine * cosine) / (GLASS_INDEX * GLASS_INDEX))
    inside = add_scaled(scale(towards, 1.0 / GLASS_INDEX), cosine / GLASS_INDEX - inner_cosine, normal)
    # A chord makes the same angle with the sphere at both ends.
    centre, radius = load3(scene.objects, number, BOUNDING_SPHERE), scene.objects[number, BOUNDING_SPHERE + 3]
    exit_point = add_scaled(point, 2.0 * radius * inner_cosine, inside)
    outwards = scale(subtract(exit_point, centre), 1.0 / radius)
    refracted = add_scaled(scale(inside, GLASS_INDEX), cosine - GLASS_INDEX * inner_cosine, outwards)
    through = _secondary_colour(scene, exit_point, refracted, REFRACTED_SPREAD * angle, True)
    transmittance = (1.0 - reflectance) * (1.0 - reflectance)
    return add_scaled(scale(through, transmittance), reflectance, reflected)


@inlined
def _secondary_colour(scene: Any, start: Any, direction: Any, angle: Any, shadows: Any) -> Any:
    """Return the radiance (3,) along a reflected or refracted ray with a unit direction, which is not reflected again.

    `angle` is the change of the direction from one pixel to the next, rad. Shadows are computed only if `shadows`.
    """
    t_min = CLEARANCE_MM
    number, t, part = first_hit(scene.objects, scene.boxes, scene.triangles, start, direction, t_min)
    towards = -dot(direction, load3(scene.lamp, FACING, 0))
    if towards > 0.0:
        offset = subtract(load3(scene.lamp, LAMP_CENTRE, 0), start)
        hit = -dot(offset, load3(scene.lamp, FACING, 0)) / towards
        if 0.0 < hit < t:
            offset = add_scaled(scale(offset, -1.0), hit, direction)
            first, second = load3(scene.lamp, FIRST_SIDE, 0), load3(scene.lamp, SECOND_SIDE, 0)
            if abs(dot(offset, first)) < dot(first, first) and abs(dot(offset, second)) < dot(second, second):
                return load3(scene.lamp, RADIANCE, 0)
    if number == NOTHING:
        return load3(scene.surroundings, SKY_LIGHT, 0)
    point = add_scaled(start, t, direction)
    normal = facing_normal(scene, number, part, point, direction)
    width = angle * t
    # Two sides of the footprint, perpendicular to the ray.
    side = (direction[2], 0.0, -direction[0])
    if dot(side, side) < 1e-6:
        side = (1.0, 0.0, 0.0)
    side = scale(unit(side), width)
    other = cross(direction, side)
    if int(scene.objects[number, MATERIAL]) == GLASS:
        return surface_colour(scene, number, part, point, normal, direction, side, other)
    return scattered_light(scene, number, part, point, normal, direction, side, other, shadows)
