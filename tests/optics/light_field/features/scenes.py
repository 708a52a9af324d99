"""Light fields of closed-form scenes: textured planes, seen by exact pinholes ray by ray, and astigmatic ones."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import FOLD_90_VIEW_FROM_RIG
from mirrorcam.optics.light_field.light_field import LightField, Views

SUPERSAMPLING = 2
MM_PER_TEXEL = 0.4
# Plane: its distance where x = y = 0, tan of its slants along x and y, and (left, top, right, bottom) in mm or nothing.
Plane = tuple[float, tuple[float, float], tuple[float, float, float, float] | None, int]


def uneven_views(rows: int = 3, cols: int = 3, **changes: Any) -> Views:
    """Return views some 35 and 25 mm apart, uneven in all three axes; the reference view is 80 mm behind the pupil."""
    across, down = np.arange(cols) - cols // 2, np.arange(rows) - rows // 2
    positions = np.zeros((rows, cols, 3))
    positions[..., 0], positions[..., 1] = 35.0 * across, 25.0 * down[:, None]
    positions += np.random.default_rng(5).uniform(-3.0, 3.0, positions.shape)
    positions -= positions[rows // 2, cols // 2]
    given: dict[str, Any] = {
        "positions_mm": positions,
        "focal_px": 800.0,
        "centre_px": np.array([131.0, 88.5]),
        "width_px": 260,
        "height_px": 180,
        "reference_depth_mm": 380.0,
        "reference_view_in_rig_mm": np.array([2.0, -80.0, 90.0]),
        "view_from_rig": np.array(FOLD_90_VIEW_FROM_RIG),
        "layout_identity": "0123456789abcdef",
    }
    return Views(**(given | changes))


@cache
def noise(seed: int) -> FloatArray:
    """A texture (0 to 255) of blobs of several sizes that repeats nowhere within a view."""
    random = np.random.default_rng(seed)
    layers = [gaussian_filter(random.standard_normal((1000, 1000)), sigma, mode="wrap") for sigma in (1.6, 3.0, 8.0)]
    picture: FloatArray = np.sum([layer / layer.std() for layer in layers], axis=0)
    return np.clip(128.0 + 30.0 * picture, 0.0, 255.0)


def painted(x: FloatArray, y: FloatArray, seed: int) -> FloatArray:
    """The texture at (x, y) in mm."""
    across, down = ((each.reshape(-1, x.shape[-1]) / MM_PER_TEXEL + 500.0).astype(np.float32) for each in (x, y))
    picture = noise(seed).astype(np.float32)
    parts = [
        cv2.remap(
            picture,
            across[start : start + 2**14],
            down[start : start + 2**14],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_WRAP,
        )
        for start in range(0, len(across), 2**14)
    ]
    return np.concatenate(parts).reshape(x.shape).astype(np.float64)


def rays(views: Views, t: int, s: int) -> FloatArray:
    """Directions (v, u, k, 3) of k samples within each pixel."""
    step = (np.arange(SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5
    within = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    pixels = views.pixel_grid()[:, :, None] + within
    homogeneous = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1)
    return np.asarray(homogeneous @ np.linalg.inv(views.matrices[t, s]).T)


def met(plane: Plane, start: FloatArray, ways: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return the points (..., 3) where rays meet a plane, their lengths, and a mask of those within its bounds."""
    distance, (slant_x, slant_y), bounds, _ = plane
    normal = np.array([-slant_x, -slant_y, 1.0])
    along = (distance - start @ normal) / (ways @ normal)
    points = start + ways * along[..., None]
    inside = np.ones(along.shape, dtype=bool)
    if bounds is not None:
        left, top, right, bottom = bounds
        x, y = points[..., 0], points[..., 1]
        inside = (x > left) & (x < right) & (y > top) & (y < bottom)
    return points, along, inside


def of_planes(views: Views, planes: list[Plane], noise_grey: float = 0.0) -> tuple[LightField, FloatArray]:
    """The 8-bit RGB light field of planes, the nearer hiding the farther, and the central view's depths (v, u)."""
    random = np.random.default_rng(9)
    shape = (views.rows, views.cols, views.height_px, views.width_px)
    grey, true_mm = np.zeros(shape), np.zeros(shape[2:])
    for t, s in np.ndindex(views.rows, views.cols):
        start, ways = views.positions_mm[t, s], rays(views, t, s)
        nearest, shown = np.full(ways.shape[:-1], np.inf), np.zeros(ways.shape[:-1])
        for plane in planes:
            points, along, inside = met(plane, start, ways)
            closer = inside & (along < nearest)
            nearest[closer] = along[closer]
            shown[closer] = painted(points[..., 0], points[..., 1], plane[3])[closer]
        grey[t, s] = shown.mean(axis=-1)
        if not views.positions_mm[t, s].any():
            true_mm = nearest.mean(axis=-1) * 1.0 + views.reference_view_depth_mm
    return of_grey(views, grey + random.normal(0.0, noise_grey, shape)), true_mm


def astigmatic(views: Views, slopes_mm: FloatArray, seed: int = 1) -> LightField:
    """Return a light field in which every point has the slopes W (2, 2) in 1/mm; views have no positions along z.

    u = f (a - W p) + c for a point in direction a, so that pixel u shows direction (u - c) / f + W p.
    """
    grey = np.zeros((views.rows, views.cols, views.height_px, views.width_px))
    for t, s in np.ndindex(views.rows, views.cols):
        direction = rays(views, t, s)[..., :2] + slopes_mm @ views.positions_mm[t, s, :2]
        grey[t, s] = painted(450.0 * direction[..., 0], 450.0 * direction[..., 1], seed).mean(axis=-1)
    return of_grey(views, grey)


def of_grey(views: Views, grey: FloatArray) -> LightField:
    samples = np.repeat(np.rint(np.clip(grey, 0, 255)).astype(np.uint8)[..., None], 3, axis=-1)
    return LightField.of(views, samples, np.ones(grey.shape, np.float32))
