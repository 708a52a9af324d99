"""Ray tracing in float64 from the pupil via a flat or bent mirror, surface by surface.

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
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, radius_mm


class Obstacles(Protocol):
    """Opaque bodies around the mirrors of a device, in the frame of its camera."""

    def distance_to_body_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the distance (...) along rays to the first body.

        Parameters
        ----------
        start
            Origins (..., 3) in the rig frame, mm.
        direction
            Unit vectors (..., 3).

        Returns
        -------
        FloatArray
            Distances (...), mm; infinite without a body, NaN where the origin or direction is NaN.
        """

    def distance_from_pupil_mm(self, rays: FloatArray) -> FloatArray:
        """Return the distance (...), mm, from the pupil along unit rays (..., 3) to a body other than the camera."""


# Distance to the mirror, point of exit, direction there, and path length up to there.
Reflected = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
SURFACE_STEPS = 8  # of Newton's method to a surface with slopes below a degree: each step squares the error
IMAGE_STEPS = 8  # Newton steps to an image
DIFFERENCE_PX = 1e-3  # of finite differences
FLAT = MirrorFinish(reflectance=(1.0, 1.0, 1.0))


@dataclass(frozen=True)
class _Ray:
    """Rays (..., 3) in the mirror's frame `plane`, mm: unit vectors `direction` from `start`, after `path_mm` (...)."""

    start: FloatArray
    direction: FloatArray
    path_mm: FloatArray


def trace_via_mirror(
    mirror: Mirror, rays: FloatArray, finish: MirrorFinish | None = None, origin: FloatArray | None = None
) -> Reflected:
    """Trace rays from the pupil via a mirror.

    Parameters
    ----------
    mirror
        First- or second-surface mirror.
    rays
        Unit vectors (..., 3) in the rig frame.
    finish
        Its surface finish; by default it is flat.
    origin
        Start points (..., 3) in the pupil, mm; by default its centre.

    Returns
    -------
    entry_mm
        Distance (...) from the start point to the mirror's front, mm; infinite where a ray misses it.
    start
        Point (..., 3), mm, where the ray leaves the mirror; NaN where it does not.
    direction
        Unit vector (..., 3) of the ray there; NaN likewise.
    path_mm
        Geometric path length (...) from the pupil to that point, mm; NaN likewise.
    """
    start = np.zeros(3) if origin is None else origin
    if finish is not None and not finish.flat:
        points, out = _trace(mirror, finish, rays, start)
        first, last = _in_rig(mirror, points[0]), _in_rig(mirror, points[-1])
        direction = out.direction @ mirror.rig_from_plane[:3, :3].T
        return _masked_by_outline(mirror, first, np.linalg.norm(first - start, axis=-1), last, direction, out.path_mm)
    normal = mirror.normal_in_rig
    cosine = np.maximum(-(rays @ normal), 1e-12)
    entry_mm = (start @ normal + mirror.distance_mm - mirror.front_mm) / cosine
    entry = start + rays * entry_mm[..., None]
    exit_point, path_mm = entry, entry_mm
    if mirror.is_second_surface:
        # To the coating and back. Snell's law: the tangential component is divided by the refractive index.
        tangential = (rays + cosine[..., None] * normal) / mirror.refractive_index
        inside_mm = 2.0 * mirror.thickness_mm / np.sqrt(1.0 - np.square(tangential).sum(axis=-1))
        exit_point, path_mm = entry + tangential * inside_mm[..., None], entry_mm + inside_mm
    return _masked_by_outline(mirror, entry, entry_mm, exit_point, rays + 2.0 * cosine[..., None] * normal, path_mm)


def _masked_by_outline(
    mirror: Mirror,
    entry: FloatArray,
    entry_mm: FloatArray,
    exit_point: FloatArray,
    direction: FloatArray,
    path_mm: FloatArray,
) -> Reflected:
    """Mask rays that enter or leave the mirror, at points (..., 3), outside its outline."""
    enters_inside = _inside_outline(mirror, entry)
    leaves_inside = enters_inside if exit_point is entry else enters_inside & _inside_outline(mirror, exit_point)
    return (
        np.where(enters_inside, entry_mm, np.inf),
        np.where(leaves_inside[..., None], exit_point, np.nan),
        np.where(leaves_inside[..., None], direction, np.nan),
        np.where(leaves_inside, path_mm, np.nan),
    )


def _inside_outline(mirror: Mirror, points: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of points (..., 3) on a mirror's face that lie within its outline."""
    frame = mirror.rig_from_plane
    in_plane = (points - frame[:3, 3]) @ frame[:3, :2]
    outline = mirror.outline_in_plane_mm
    edges = np.roll(outline, -1, axis=0) - outline
    # Twice the area of a triangle of adjacent corners: positive where the outline turns left.
    orientation = np.sign(edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    inside = np.ones(in_plane.shape[:-1], dtype=np.bool_)
    for corner, edge in zip(outline, orientation * edges, strict=True):
        inside &= edge[0] * (in_plane[..., 1] - corner[1]) >= edge[1] * (in_plane[..., 0] - corner[0])
    return inside


def chief_rays(camera: Camera, px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return start points (..., 3), mm, and unit vectors (..., 3) of the chief rays of pixels (..., 2)."""
    rays, pupil = camera.unproject(px), camera.pupil
    start = np.zeros_like(rays)
    start[..., 2] = pupil.walk_mm * np.square(rays[..., :2]).sum(axis=-1)
    rays = pupil.focus_mm * rays - start
    return start, np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def image_px(
    camera: Camera,
    mirror: Mirror | None,
    points_in_rig: FloatArray,
    finish: MirrorFinish | None = None,
) -> FloatArray:
    """Project points (n, 3) in the rig frame, mm, via a mirror or directly to pixels (n, 2); NaN without an image.

    Newton's method finds the pixel whose traced chief ray passes through the point. It starts at the image via a flat
    mirror.
    """
    px = camera.project(points_in_rig if mirror is None else mirror.image_of(points_in_rig))
    if (finish is None or finish.flat) and camera.pupil.walk_mm == 0.0:
        return px
    frame = np.eye(4) if mirror is None else mirror.rig_from_plane
    points = (points_in_rig - frame[:3, 3]) @ frame[:3, :3]

    def offsets_mm(px: FloatArray) -> FloatArray:
        """Return offsets (..., 2), mm, of the rays of pixels from the points, in the plane z = const. of `frame`."""
        start, unit = chief_rays(camera, px)
        out = _Ray(start, unit, np.zeros(0)) if mirror is None else _trace(mirror, finish or FLAT, unit, start)[1]
        length = (points[:, 2] - out.start[..., 2]) / out.direction[..., 2]
        return (out.start + length[..., None] * out.direction - points)[..., :2]

    for _ in range(IMAGE_STEPS):
        offset = offsets_mm(px)
        moved = [offsets_mm(px + DIFFERENCE_PX * axis) for axis in np.eye(2)]
        jacobian = np.stack([(offsets - offset) / DIFFERENCE_PX for offsets in moved], axis=-1)
        valid = np.isfinite(jacobian.sum(axis=2) + offset).all(axis=1)[:, None]
        step = np.asarray(np.linalg.solve(np.where(valid[..., None], jacobian, np.eye(2)), offset[..., None])[..., 0])
        px = np.asarray(np.where(valid, px - step, np.nan), dtype=np.float64)
    return px


def _trace(mirror: Mirror, finish: MirrorFinish, rays: FloatArray, origin: FloatArray) -> tuple[list[FloatArray], _Ray]:
    """Return the points where unit rays (..., 3) from the pupil meet each surface, and the rays after the last one.

    Points (..., 3) are in the frame `plane`; the surfaces extend beyond the outline.
    """
    frame = mirror.rig_from_plane
    pupil = (origin - frame[:3, 3]) @ frame[:3, :3]
    ray = _Ray(np.broadcast_to(pupil, rays.shape), rays @ frame[:3, :3], np.zeros(rays.shape[:-1]))
    if not mirror.is_second_surface:
        ray, normal = _advance(mirror, finish, ray, 0.0)
        return [ray.start], _Ray(ray.start, _reflect(ray.direction, normal), ray.path_mm)
    thickness_mm, index = mirror.thickness_mm, mirror.refractive_index
    ray, normal = _advance(mirror, finish, ray, thickness_mm)
    points = [ray.start]
    ray = _Ray(ray.start, _refract(ray.direction, normal, 1.0 / index), ray.path_mm)
    ray, normal = _advance(mirror, finish, ray, 0.0)
    points.append(ray.start)
    ray = _Ray(ray.start, _reflect(ray.direction, normal), ray.path_mm)
    ray, normal = _advance(mirror, finish, ray, thickness_mm)
    points.append(ray.start)
    return points, _Ray(ray.start, _refract(ray.direction, -normal, index), ray.path_mm)


def _advance(mirror: Mirror, finish: MirrorFinish, ray: _Ray, height_mm: float) -> tuple[_Ray, FloatArray]:
    """Advance rays to a surface of the mirror; also return its unit normals (..., 3) there."""
    radius = radius_mm(mirror)
    length = (height_mm - ray.start[..., 2]) / ray.direction[..., 2]
    for _ in range(SURFACE_STEPS):
        point = ray.start + length[..., None] * ray.direction
        height, slopes = finish.shape(radius, point[..., :2])
        above = point[..., 2] - height_mm - height
        length = length - above / (ray.direction[..., 2] - (slopes * ray.direction[..., :2]).sum(axis=-1))
    point = ray.start + length[..., None] * ray.direction
    _, slopes = finish.shape(radius, point[..., :2])
    normal = np.concatenate([-slopes, np.ones((*slopes.shape[:-1], 1))], axis=-1)
    return _Ray(point, ray.direction, ray.path_mm + length), normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def _reflect(direction: FloatArray, normal: FloatArray) -> FloatArray:
    return np.asarray(direction - 2.0 * (direction * normal).sum(axis=-1, keepdims=True) * normal)


def _refract(direction: FloatArray, normal: FloatArray, ratio: float) -> FloatArray:
    """Refract unit vectors by Snell's law; `ratio` is the index in front of the surface divided by that behind it."""
    cosine = -(direction * normal).sum(axis=-1, keepdims=True)
    tangential = ratio * (direction + cosine * normal)
    return np.asarray(tangential - np.sqrt(1.0 - (tangential * tangential).sum(axis=-1, keepdims=True)) * normal)


def _in_rig(mirror: Mirror, points: FloatArray) -> FloatArray:
    frame = mirror.rig_from_plane
    return transform(frame, points)
