"""Frames of analytic scenes, traced pixel by pixel from `Camera.unproject`, and pictures of ideal pinholes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.light_field.light_field import Views

Texture = Callable[[FloatArray, FloatArray], FloatArray]


def waves(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a smooth aperiodic texture (0 to 1) at (x, y) in mm."""
    return 0.5 + 0.2 * np.sin(x / 4.1 + 0.3 * np.sin(y / 13.0)) + 0.2 * np.cos(y / 3.7 + 0.4) * np.sin(x / 29.0 + 1.0)


def letter(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a white F on black, 24 mm high, readable for the viewer (x right, y down in view axes)."""
    stem = (np.abs(x + 6) < 2.5) & (np.abs(y) < 12)
    bar = (np.abs(x) < 8) & (np.abs(y + 9.5) < 2.5)
    short = (np.abs(x + 2) < 6) & (np.abs(y + 1) < 2.5)
    return (stem | bar | short).astype(np.float64)


@cache
def reflected_rays(layout: Layout) -> list[tuple[NDArray[np.bool_], FloatArray, FloatArray]]:
    """Return for each mirror the mask (h, w) of its pixels, and points and directions (n, 3) of reflected rays."""
    camera = layout.camera
    u, v = np.meshgrid(np.arange(camera.width_px, dtype=float), np.arange(camera.height_px, dtype=float))
    rays = camera.unproject(np.stack([u, v], axis=-1))
    found = []
    for mirror in layout.mirrors:
        hit = shapely.contains_xy(shapely.Polygon(mirror.usable_normalized), rays[..., 0], rays[..., 1])
        start, turned = through_mirror(mirror, rays[hit])
        found.append((hit, start @ layout.view_from_rig.T, turned @ layout.view_from_rig.T))
    return found


def through_mirror(mirror: Mirror, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points and directions (n, 3), in rig, of rays from the pupil after a mirror, by Snell's law in vectors."""
    normal = mirror.normal_in_rig
    if not mirror.is_second_surface:
        return mirror.intersect(rays[:, :2]), rays @ mirror.reflection
    index, thickness_mm = mirror.refractive_index, mirror.thickness_mm
    front_mm = mirror.distance_mm - thickness_mm
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    cosine = -(rays @ normal)[:, None]
    inside = rays / index + (cosine / index - np.sqrt(1.0 - (1.0 - cosine**2) / index**2)) * normal
    enters = rays * (front_mm / cosine)
    leaves = enters + 2.0 * thickness_mm * (inside / -(inside @ normal)[:, None] + normal)
    # The ray leaves the plate in the direction of a reflection by a first-surface mirror in the same plane.
    return leaves, rays @ mirror.reflection


def photographed(layout: Layout, depth_mm: float, texture: Texture) -> NDArray[np.float32]:
    """Return the base camera's frame (h, w, 3) of a texture on the plane at a depth, black between mirrors.

    Each sensor pixel's ray is traced via its mirror, through the plate of a second-surface one, to the scene.
    """
    frame = np.zeros((layout.camera.height_px, layout.camera.width_px))
    for hit, start, turned in reflected_rays(layout):
        points = start + turned * ((depth_mm - start[:, 2]) / turned[:, 2])[:, None]
        frame[hit] = texture(points[:, 0], points[:, 1])
    return np.repeat(frame[..., None], 3, axis=2).astype(np.float32)


def seen_by_pinholes(views: Views, depth_mm: float, texture: Texture) -> FloatArray:
    """Return pictures (t, s, v, u) of the same plane by ideal pinholes at the true view positions."""
    pixels = np.concatenate([views.pixel_grid(), np.ones((views.height_px, views.width_px, 1))], axis=-1)
    rays = np.einsum("tsij,vuj->tsvui", np.linalg.inv(views.matrices), pixels)
    start = (views.reference_view_in_rig_mm @ views.view_from_rig.T + views.positions_mm)[:, :, None, None]
    points = start + rays * ((depth_mm - start[..., 2:]) / rays[..., 2:])
    return texture(points[..., 0], points[..., 1])
