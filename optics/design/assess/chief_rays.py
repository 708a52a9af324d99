"""Rays from the pupil via mirrors to the scene, refracted by second-surface mirrors, and their occlusion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import FOLD_90_VIEW_FROM_RIG
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import stacked
from mirrorcam.optics.geometry.plate import rise_mm, tangent_in_glass
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil
from mirrorcam.optics.geometry.sub_images import unvignetted_outline

TOUCH_MM = 1e-6
"""Length inside a solid up to which a ray counts as only touching it."""
SAMPLES = 24
RIM_POINTS = 8


@dataclass(frozen=True)
class Occlusion:
    """Fraction of the rays of one mirror that the solid of another blocks before ("in") or after ("out") reflection."""

    mirror: int
    occluder: int
    leg: Literal["in", "out"]
    fraction: float


def length_inside_mm(starts: FloatArray, ends: FloatArray, normals: FloatArray, offsets: FloatArray) -> FloatArray:
    """Length (n,) of each segment from `starts` to `ends` (n, 3) inside the convex solid n.x <= d (k faces)."""
    heights, slopes = starts @ normals.T - offsets, (ends - starts) @ normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = -heights / slopes
    entry = np.where(slopes < 0, crossings, np.where((slopes == 0) & (heights > 0), np.inf, -np.inf)).max(axis=1)
    departure = np.where(slopes > 0, crossings, np.inf).min(axis=1)
    inside = np.minimum(departure, 1.0) - np.maximum(entry, 0.0)
    return np.maximum(inside, 0.0) * np.linalg.norm(ends - starts, axis=1)


def sampled(polygon: FloatArray, steps: int = SAMPLES) -> FloatArray:
    """Points (n, 2) that cover a convex polygon (k, 2) evenly, including its border; (0, 2) for an empty polygon."""
    i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1))
    weights = np.stack([i, j], axis=-1)[i + j <= steps] / steps
    fans = [
        polygon[0] + weights @ np.array([polygon[k] - polygon[0], polygon[k + 1] - polygon[0]])
        for k in range(1, len(polygon) - 1)
    ]
    return np.concatenate(fans) if fans else np.zeros((0, 2))


def traced(
    mirror: Mirror, normalized: FloatArray, origins_mm: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (n, 3), mm, where rays (n, 2) enter and leave a mirror's front, and their directions (n, 3) afterwards.

    The rays start at the pupil's centre or at `origins_mm` (n, 3) in the pupil.

    Exact, also for second-surface mirrors: the front refracts the ray by Snell's law, the back reflects it, and it
    leaves the front 2 t tan' farther on, as if reflected there.
    """
    rays = np.column_stack([normalized, np.ones(len(normalized))])
    normal = mirror.normal_in_rig
    glass_mm = mirror.front_mm
    normal_part = -rays @ normal
    starts = np.zeros_like(rays) if origins_mm is None else origins_mm
    entry_mm = starts + rays * ((mirror.distance_mm - glass_mm + starts @ normal) / normal_part)[:, None]
    in_plane = rays + normal_part[:, None] * normal
    exit_mm = entry_mm
    if glass_mm > 0.0:
        tangent = np.linalg.norm(in_plane, axis=1) / normal_part
        ratio = np.divide(
            tangent_in_glass(tangent, mirror.refractive_index),
            tangent,
            out=np.full_like(tangent, 1.0 / mirror.refractive_index),
            where=tangent > 0,
        )
        exit_mm = entry_mm + 2.0 * glass_mm * (ratio / normal_part)[:, None] * in_plane
    return entry_mm, exit_mm, rays @ mirror.reflection


def sampled_light(mirror: Mirror, pupil: Pupil, steps: int = SAMPLES) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) at centre and rim of the pupil, and rays (n, 2) from them to the mirror, for unvignetted pixels.

    `steps` is the number of pixels along an edge of the sub-image.
    """
    chief = sampled(unvignetted_outline(mirror, pupil), steps)
    if pupil.radius_mm == 0.0:
        return np.zeros((len(chief), 3)), chief
    angles = 2.0 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    rim = pupil.radius_mm * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(RIM_POINTS)])
    origins = np.concatenate([np.zeros((1, 3)), rim])
    rays = chief[:, None] - origins[:, :2] / pupil.focus_mm
    return np.tile(origins, (len(chief), 1)), rays.reshape(-1, 2)


def traced_to(
    mirror: Mirror, pupil: Pupil, depth_mm: float, view_axis: FloatArray, steps: int = SAMPLES
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sampled light of a mirror that is reflected towards the scene, as points (n, 3), mm.

    Returns the points in the pupil, where rays enter the front, where they leave it, and at a depth along `view_axis`.
    """
    origins, rays = sampled_light(mirror, pupil, steps)
    entry_mm, exit_mm, directions = traced(mirror, rays, origins)
    forward = directions @ view_axis > 1e-9
    origins, entry_mm, exit_mm, directions = (array[forward] for array in (origins, entry_mm, exit_mm, directions))
    steps_to_depth = (depth_mm - exit_mm @ view_axis) / (directions @ view_axis)
    return origins, entry_mm, exit_mm, exit_mm + directions * steps_to_depth[:, None]


def apparent_offset_mm(mirror: Mirror) -> float:
    """Largest lateral offset, mm, between a mirror's rays and the parallel rays of its apparent mirror.

    A ray at the incidence i whose apparent plane is d higher than the chief ray's is offset by 2 d sin(i).
    """
    normalized = sampled(mirror.usable_normalized)
    if not mirror.is_second_surface or len(normalized) == 0:
        return 0.0
    rays = np.column_stack([normalized, np.ones(len(normalized))])
    cosine = -(rays @ mirror.normal_in_rig) / np.linalg.norm(rays, axis=1)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    rise = mirror.distance_mm - mirror.apparent.distance_mm
    difference = rise_mm(sine / cosine, mirror.thickness_mm, mirror.refractive_index) - rise
    return float(np.abs(2.0 * difference * sine).max())


def _may_meet(points: FloatArray, normals: FloatArray, bodies: FloatArray) -> FloatArray:
    """Mask (n,) of the solids with corners (n, k, 3) that may meet the convex hull of points (m, 3).

    Planes with the given normals (p, 3) separate the others from it.
    """
    extent = (points @ normals.T).max(axis=0)
    return ~((bodies @ normals.T).min(axis=1) >= extent).any(axis=1)


def blocked_light(
    mirrors: Sequence[Mirror],
    depth_mm: float,
    steps: int = SAMPLES,
    *,
    view_axis: FloatArray | tuple[float, ...] = FOLD_90_VIEW_FROM_RIG[2],
    pupil: Pupil = PINHOLE,
) -> list[Occlusion]:
    """Find mirrors whose solids block others' light, by casting rays from the pupil through sub-images to a depth.

    Rays cover the unvignetted part of each mirror.

    Parameters
    ----------
    mirrors : mirrors of a layout.
    depth_mm : depth up to which light must not be blocked.
    steps : number of rays along an edge of a sub-image.
    view_axis : view axis (3,) in the rig frame, `layout.view_from_rig[2]`; by default for a fold of 90 degrees.
    pupil : pupil from which the light starts; by default only its centre.

    Returns
    -------
    Each pair of mirrors and leg of the light with blocked rays.
    """
    occlusions, axis = [], np.asarray(view_axis, dtype=np.float64)
    faces = [mirror.solid.half_spaces for mirror in mirrors]
    bodies = stacked([mirror.solid.corners_in_rig_mm for mirror in mirrors])
    for index, mirror in enumerate(mirrors):
        origins, entry_mm, exit_mm, at_depth = traced_to(mirror, pupil, depth_mm, axis, steps)
        if len(entry_mm) == 0:
            continue
        outline = mirror.outline_in_rig_mm
        legs: tuple[tuple[Literal["in", "out"], FloatArray, FloatArray, FloatArray], ...] = (
            ("in", origins, entry_mm, np.zeros(3)),
            ("out", exit_mm, at_depth, mirror.apparent.virtual_centre_in_rig_mm),
        )
        for leg, starts, ends, source in legs:
            # The light is bounded by planes through its source and each edge, and by the mirror plane.
            sides = np.cross(outline - source, np.roll(outline, -1, axis=0) - source)
            normals = np.concatenate([sides, -sides, -mirror.normal_in_rig[None]])
            near = _may_meet(np.concatenate([starts, ends]), normals, bodies)
            for occluder in np.flatnonzero(near):
                if occluder == index:
                    continue
                fraction = float(np.mean(length_inside_mm(starts, ends, *faces[occluder]) > TOUCH_MM))
                if fraction > 0:
                    occlusions.append(Occlusion(index, int(occluder), leg, fraction))
    return occlusions
