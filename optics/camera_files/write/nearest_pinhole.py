"""The pinhole nearest to a view that is not one: that of a second-surface mirror, or of a bent one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray, InputError, InvalidValue
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout, working_range_mm

GRID = 12  # samples across and down a sub-image
DISTANCES_MM = (300.0, 1000.0)
"""From the virtual centre, of layouts that tell no working range."""
BEYOND = 1.05
"""Nearest points, in distances of the mirror along the ray."""
STEPS = 8
FREE = ("fx_px", "fy_px", "k1", "k2", "p1", "p2")
"""What is fitted beside the pose; the principal point would only be correlated with the rotation."""
EXACT_PX = 1e-9


@dataclass(frozen=True)
class Pinhole:
    """A camera that looks at the apparent mirror's images X' of points, from camera = `turn` X' + `shift_mm`.

    `error_px` is the largest distance between where a point appears and where this camera puts it, over the sub-image
    and the range of depths.
    """

    camera: Camera
    turn: FloatArray
    shift_mm: FloatArray
    error_px: float


@np.errstate(all="ignore")  # of numbers that grow past all bounds, which ends the fit
def nearest_pinhole(layout: Layout, number: int, outline_px: FloatArray) -> Pinhole:
    """The camera nearest to what a mirror shows within its sub-image (n, 2), in the layout's working range.

    Of a flat first-surface mirror it is the base camera itself. Else pose, focal lengths and distortion are fitted by
    Gauss-Newton steps from there to points that appear on a grid: they describe this sub-image and nothing beyond it.
    Steps end where they lead to no camera. Raises InputError where not even the base camera shows these points.
    """
    mirror, apparent = layout.mirrors[number], layout.mirrors[number].apparent
    pixels = np.concatenate([outline_px, _grid(outline_px)])
    rays = layout.camera.unproject(pixels)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    nearest = BEYOND * np.linalg.norm(apparent.cut(rays[:, :2] / rays[:, 2:]), axis=-1, keepdims=True)
    near, far = fitted_distances_mm(layout)
    images = np.concatenate([rays * np.maximum(mm, nearest) for mm in (near, 2.0 / (1.0 / near + 1.0 / far), far)])
    seen = layout.camera.project(mirror.image_of(apparent.reflect(images)))
    camera, turn, shift = layout.camera, np.eye(3), np.zeros(3)
    best = Pinhole(camera, turn, shift, _worst(camera, images, seen))
    if best.error_px < EXACT_PX:
        return best
    free = [place for place, name in enumerate(layout.camera.intrinsic_names) if name in FREE]
    for _ in range(STEPS):
        turned = images @ turn.T + shift
        found, by_point, by_intrinsic = camera.project_with_jacobians(turned)
        by_turn = -np.cross(by_point, turned[:, None])  # d(w x X)/dw, row by row: r . (w x X) = w . (X x r)
        columns = np.concatenate([by_turn, by_point, by_intrinsic[:, :, free]], axis=2).reshape(-1, 6 + len(free))
        scale = np.linalg.norm(columns, axis=0)
        if not (np.isfinite(columns / scale).all() and np.isfinite(seen - found).all()):
            break
        step = np.linalg.lstsq(columns / scale, (seen - found).ravel(), rcond=1e-9)[0] / scale
        rotation = Rotation.from_rotvec(step[:3]).as_matrix()
        turn, shift = rotation @ turn, rotation @ shift + step[3:6]
        intrinsics = camera.intrinsics.copy()
        intrinsics[free] += step[6:]
        try:
            camera = camera.with_intrinsics(intrinsics)
        except InvalidValue:
            break
        error_px = _worst(camera, images @ turn.T + shift, seen)
        if error_px < best.error_px:
            best = Pinhole(camera, turn, shift, error_px)
    if not np.isfinite(best.error_px):
        raise InputError("shows points where the lens model or the plate of the mirror is not defined, expected others")
    return best


def fitted_distances_mm(layout: Layout) -> tuple[float, float]:
    """The range of distances from the virtual centres over which cameras are fitted."""
    return working_range_mm(layout) or DISTANCES_MM


def _grid(outline_px: FloatArray) -> FloatArray:
    low, high = outline_px.min(axis=0), outline_px.max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, GRID).T), axis=-1).reshape(-1, 2)
    return np.asarray(grid[shapely.contains_xy(shapely.Polygon(outline_px), grid)])


def _worst(camera: Camera, points: FloatArray, seen: FloatArray) -> float:
    return float(np.linalg.norm(camera.project(points) - seen, axis=1).max())
