"""Ray tracing in float64 from the pupil via a flat or bent mirror, surface by surface, up to an obstacle.

It shares only the shape of a mirror with the renderers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, radius_mm


class Obstacles(Protocol):
    """Opaque bodies around the mirrors of a device, in the frame of its camera."""

    def free_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the length (...) of rays up to the first body.

        Parameters
        ----------
        start
            Origins (..., 3) in rig, mm.
        direction
            Unit vectors (..., 3) in rig.

        Returns
        -------
        FloatArray
            Lengths (...), mm; infinite without a body, NaN where the origin or direction is NaN.
        """

    def free_from_pupil_mm(self, rays: FloatArray) -> FloatArray:
        """Return the length (...), mm, of unit rays (..., 3) from the pupil; the camera's own body is ignored."""


# Distance to the mirror, point of exit, direction there, and path length up to there.
Reflected = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
SURFACE_STEPS = 8  # of Newton's method to a surface with slopes below a degree: each step squares the error
IMAGE_STEPS = 8
STEP_PX = 1e-3
FLAT = MirrorFinish(reflectance=(1.0, 1.0, 1.0))


@dataclass(frozen=True)
class _Ray:
    """Rays (..., 3) in the frame `plane`, mm: unit vectors `direction` from `start`, after `path_mm` (...)."""

    start: FloatArray
    direction: FloatArray
    path_mm: FloatArray


def reflected(
    mirror: Mirror, rays: FloatArray, finish: MirrorFinish | None = None, origin: FloatArray | None = None
) -> Reflected:
    """Trace rays from the pupil via a mirror.

    Parameters
    ----------
    mirror
        First- or second-surface mirror.
    rays
        Unit vectors (..., 3) in rig.
    finish
        Its surface finish; without one it is flat.
    origin
        Start points (..., 3) in the pupil, in rig, mm; by default its centre.

    Returns
    -------
    entry_mm
        Distance (...) from the start point to the mirror's front, mm; infinite where a ray misses it.
    start
        Point (..., 3) in rig, mm, where the ray leaves the mirror; NaN where it does not.
    direction
        Unit vector (..., 3) in rig of the ray there; NaN likewise.
    path_mm
        Geometric path length (...) from the pupil to that point, mm; NaN likewise.
    """
    begin = np.zeros(3) if origin is None else origin
    if finish is not None and not finish.flat:
        points, out = _traced(mirror, finish, rays, begin)
        first, last = _in_rig(mirror, points[0]), _in_rig(mirror, points[-1])
        along = out.direction @ mirror.rig_from_plane[:3, :3].T
        return _cut(mirror, first, np.linalg.norm(first - begin, axis=-1), last, along, out.path_mm)
    normal = mirror.normal_in_rig
    cosine = np.maximum(-(rays @ normal), 1e-12)
    entry_mm = (begin @ normal + mirror.distance_mm - mirror.front_mm) / cosine
    entry = begin + rays * entry_mm[..., None]
    leaves, path_mm = entry, entry_mm
    if mirror.is_second_surface:
        # To the coating and back. Snell's law: the tangential component is divided by the refractive index.
        flat = (rays + cosine[..., None] * normal) / mirror.refractive_index
        inside_mm = 2.0 * mirror.thickness_mm / np.sqrt(1.0 - np.square(flat).sum(axis=-1))
        leaves, path_mm = entry + flat * inside_mm[..., None], entry_mm + inside_mm
    return _cut(mirror, entry, entry_mm, leaves, rays + 2.0 * cosine[..., None] * normal, path_mm)


def _cut(
    mirror: Mirror, entry: FloatArray, entry_mm: FloatArray, leaves: FloatArray, along: FloatArray, path_mm: FloatArray
) -> Reflected:
    """Mask rays that enter or leave the mirror, at points (..., 3), outside its outline."""
    entered = _inside_outline(mirror, entry)
    through = entered if leaves is entry else entered & _inside_outline(mirror, leaves)
    return (
        np.where(entered, entry_mm, np.inf),
        np.where(through[..., None], leaves, np.nan),
        np.where(through[..., None], along, np.nan),
        np.where(through, path_mm, np.nan),
    )


def _inside_outline(mirror: Mirror, points: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of points (..., 3) on a mirror's face that lie within its outline."""
    frame = mirror.rig_from_plane
    flat = (points - frame[:3, 3]) @ frame[:3, :2]
    outline = mirror.outline_in_plane_mm
    edges = np.roll(outline, -1, axis=0) - outline
    # Twice the area of a triangle of adjacent corners: positive where the outline turns left.
    turn = np.sign(edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    inside = np.ones(flat.shape[:-1], dtype=np.bool_)
    for corner, edge in zip(outline, turn * edges, strict=True):
        inside &= edge[0] * (flat[..., 1] - corner[1]) >= edge[1] * (flat[..., 0] - corner[0])
    return inside


def chief_rays(camera: Camera, pupil: Pupil, px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the start points (..., 3) in rig, mm, and unit vectors (..., 3) of the chief rays of pixels (..., 2)."""
    rays = camera.unproject(px)
    start = np.zeros_like(rays)
    start[..., 2] = pupil.walk_mm * np.square(rays[..., :2]).sum(axis=-1)
    rays = pupil.focus_mm * rays - start
    return start, np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def image_px(
    camera: Camera,
    mirror: Mirror | None,
    points_in_rig: FloatArray,
    finish: MirrorFinish | None = None,
    pupil: Pupil = PINHOLE,
) -> FloatArray:
    """Project points (n, 3) in rig, mm, via a mirror, or directly, to pixels (n, 2); NaN without an image.

    Newton's method finds the pixel whose traced chief ray passes through the point. It starts at the image via a flat
    mirror from the centre of the pupil on the axis.
    """
    px = camera.project(points_in_rig if mirror is None else mirror.image_of(points_in_rig))
    if (finish is None or finish.flat) and pupil.walk_mm == 0.0:
        return px
    frame = np.eye(4) if mirror is None else mirror.rig_from_plane
    points = (points_in_rig - frame[:3, 3]) @ frame[:3, :3]

    def missed(at: FloatArray) -> FloatArray:
        """Return offsets (..., 2), mm, of rays from the points, perpendicular to the axis or parallel to the mirror."""
        start, unit = chief_rays(camera, pupil, at)
        out = _Ray(start, unit, np.zeros(0)) if mirror is None else _traced(mirror, finish or FLAT, unit, start)[1]
        along = (points[:, 2] - out.start[..., 2]) / out.direction[..., 2]
        return (out.start + along[..., None] * out.direction - points)[..., :2]

    for _ in range(IMAGE_STEPS):
        offset = missed(px)
        columns: list[FloatArray] = [(missed(px + STEP_PX * np.eye(2)[axis]) - offset) / STEP_PX for axis in range(2)]
        jacobian = np.stack(columns, axis=-1)
        known = np.isfinite(jacobian.sum(axis=2) + offset).all(axis=1)[:, None]
        step = np.asarray(np.linalg.solve(np.where(known[..., None], jacobian, np.eye(2)), offset[..., None])[..., 0])
        px = np.asarray(np.where(known, px - step, np.nan), dtype=np.float64)
    return px


def _traced(
    mirror: Mirror, finish: MirrorFinish, rays: FloatArray, origin: FloatArray
) -> tuple[list[FloatArray], _Ray]:
    """Intersect unit rays (..., 3) from the pupil with each surface; also return the rays after the last one.

    Points (..., 3) are in the frame `plane`; the surfaces extend beyond the outline.
    """
    frame = mirror.rig_from_plane
    pupil = (origin - frame[:3, 3]) @ frame[:3, :3]
    ray = _Ray(np.broadcast_to(pupil, rays.shape), rays @ frame[:3, :3], np.zeros(rays.shape[:-1]))
    if not mirror.is_second_surface:
        ray, normal = _advanced(mirror, finish, ray, 0.0)
        return [ray.start], _Ray(ray.start, _reflected(ray.direction, normal), ray.path_mm)
    thick, index = mirror.thickness_mm, mirror.refractive_index
    ray, normal = _advanced(mirror, finish, ray, thick)
    points = [ray.start]
    ray = _Ray(ray.start, _refracted(ray.direction, normal, 1.0 / index), ray.path_mm)
    ray, normal = _advanced(mirror, finish, ray, 0.0)
    points.append(ray.start)
    ray = _Ray(ray.start, _reflected(ray.direction, normal), ray.path_mm)
    ray, normal = _advanced(mirror, finish, ray, thick)
    points.append(ray.start)
    return points, _Ray(ray.start, _refracted(ray.direction, -normal, index), ray.path_mm)


def _advanced(mirror: Mirror, finish: MirrorFinish, ray: _Ray, lift_mm: float) -> tuple[_Ray, FloatArray]:
    """Advance rays to a surface of the mirror; also return its unit normals (..., 3) there."""
    radius = radius_mm(mirror)
    length = (lift_mm - ray.start[..., 2]) / ray.direction[..., 2]
    for _ in range(SURFACE_STEPS):
        at = ray.start + length[..., None] * ray.direction
        height, slopes = finish.shape(radius, at[..., :2])
        above = at[..., 2] - lift_mm - height
        length = length - above / (ray.direction[..., 2] - (slopes * ray.direction[..., :2]).sum(axis=-1))
    at = ray.start + length[..., None] * ray.direction
    _, slopes = finish.shape(radius, at[..., :2])
    normal = np.concatenate([-slopes, np.ones((*slopes.shape[:-1], 1))], axis=-1)
    return _Ray(at, ray.direction, ray.path_mm + length), normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def _reflected(direction: FloatArray, normal: FloatArray) -> FloatArray:
    return np.asarray(direction - 2.0 * (direction * normal).sum(axis=-1, keepdims=True) * normal)


def _refracted(direction: FloatArray, normal: FloatArray, ratio: float) -> FloatArray:
    """Refract unit vectors by Snell's law; `ratio` is the index before the surface over that behind it."""
    cosine = -(direction * normal).sum(axis=-1, keepdims=True)
    flat = ratio * (direction + cosine * normal)
    return np.asarray(flat - np.sqrt(1.0 - (flat * flat).sum(axis=-1, keepdims=True)) * normal)


def _in_rig(mirror: Mirror, points: FloatArray) -> FloatArray:
    frame = mirror.rig_from_plane
    return transform(frame, points)
