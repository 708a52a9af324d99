"""A mirror, points visible in it, and rays traced through it surface by surface."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror, intersect_plane
from mirrorcam.optics.geometry.transforms import transform

SQUARE = np.array([[-0.18, -0.15], [0.12, -0.15], [0.12, 0.15], [-0.18, 0.15]])


FOCAL_PX = 1360.38


def mirror(**fields: object) -> Mirror:
    centre = np.array([9.0, -80.0, 84.0])
    return Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=intersect_plane(SQUARE, centre), **fields)


def scene_points(count: int = 60) -> FloatArray:
    """Points (n, 3) that this mirror shows to the camera, 200 to 900 mm away."""
    random = np.random.default_rng(5)
    plain = mirror()
    through = plain.intersect(random.uniform(SQUARE.min(axis=0), SQUARE.max(axis=0), (count, 2)))
    rays = through - plain.virtual_centre_in_rig_mm
    return through + rays / np.linalg.norm(rays, axis=1, keepdims=True) * random.uniform(200.0, 900.0, (count, 1))


def height(of: Mirror, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Height (...) of a bent face above its plane, mm, and its upward normals (..., 3), in the mirror's own frame."""
    xx, yy, xy = of.curvature_per_m / 1e3
    normal = np.stack([-(xx * x + xy * y), -(yy * y + xy * x), np.ones_like(x)], axis=-1)
    return 0.5 * xx * x**2 + 0.5 * yy * y**2 + xy * x * y, normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def above(of: Mirror, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Heights (n,) of points (n, 3), in the mirror's own frame, above the bent face, and its normals (n, 3) there."""
    foot = points[:, :2]
    for _ in range(12):
        z, normal = height(of, foot[:, 0], foot[:, 1])
        far = (points[:, 2] - z) / normal[:, 2]
        foot = points[:, :2] - far[:, None] * normal[:, :2]
    return far, normal


def followed(of: Mirror, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points where light from the pupil along directions (n, 3) leaves the mirror, and its unit directions, in rig.

    Face by face: Snell's law in vectors at the front, which has the same distance from the reflecting surface
    everywhere, and the law of reflection at that surface.
    """
    frame = of.rig_from_plane
    at = np.broadcast_to(-frame[:3, 3] @ frame[:3, :3], directions.shape)
    direction = directions @ frame[:3, :3] / np.linalg.norm(directions, axis=1, keepdims=True)
    front_mm = of.front_mm
    faces = [(front_mm, "in"), (0.0, "mirror"), (front_mm, "out")] if front_mm else [(0.0, "mirror")]
    for lift, what in faces:
        length = (lift - at[:, 2]) / direction[:, 2]
        for _ in range(12):
            far, normal = above(of, at + length[:, None] * direction)
            length = length - (far - lift) / np.sum(direction * normal, axis=1)
        at = at + length[:, None] * direction
        normal = above(of, at)[1]
        upright = np.sum(direction * normal, axis=1, keepdims=True)
        if what == "mirror":
            direction = direction - 2.0 * upright * normal
        else:
            ratio = 1.0 / of.refractive_index if what == "in" else of.refractive_index
            along = ratio * (direction - upright * normal)
            direction = along + np.sign(upright) * np.sqrt(1.0 - np.sum(along**2, axis=1, keepdims=True)) * normal
    return transform(frame, at), direction @ frame[:3, :3].T


def missed_px(of: Mirror, points: FloatArray) -> FloatArray:
    """Distances (n,), in px of a C920, at which the light seen at the images of points (n, 3) passes them."""
    seen = of.image_of(points)
    leaves, direction = followed(of, seen)
    passed = np.linalg.norm(np.cross(points - leaves, direction), axis=1)
    return FOCAL_PX * passed / np.linalg.norm(seen, axis=1)


BENDS = {
    "bowl": (0.3, 0.3, 0.0),
    "dome": (-0.3, -0.3, 0.0),
    "saddle": (0.25, -0.2, 0.15),
    "roll": (0.0, 0.35, 0.0),
}
