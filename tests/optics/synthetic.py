"""A small renderer for the tests of calibration, which shares no projection code with the calibrator.

It goes from pixels to the board (undistort by fixed-point iteration, reflect the ray, meet the board, look up the
print), where the calibrator goes from the board to pixels.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid

SUPERSAMPLING = 2
PX_PER_SQUARE = 48
# Rays that change by less than this, in normalised coordinates, change no more than by rounding.
CONVERGED = 1e-14
ROWS_AT_ONCE = 32


@lru_cache(maxsize=2)
def rays_through(camera: Camera) -> FloatArray:
    """Viewing rays (h * k, w * k, 3) of k x k samples in each pixel."""
    k = SUPERSAMPLING
    x = ((np.arange(camera.width_px * k) + 0.5) / k - 0.5 - camera.cx_px) / camera.fx_px
    y = ((np.arange(camera.height_px * k) + 0.5) / k - 0.5 - camera.cy_px) / camera.fy_px
    rays = np.ones((len(y), len(x), 3))
    for row in range(0, len(y), ROWS_AT_ONCE):  # as many as the processor's cache holds
        band = rays[row : row + ROWS_AT_ONCE]
        band[..., 0], band[..., 1] = undistorted(camera, x, y[row : row + ROWS_AT_ONCE, None])
    return rays


def undistorted(camera: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What the lens maps to the normalised coordinates `x` (w,), `y` (h, 1): arrays (h, w)."""
    k1, k2, p1, p2, k3 = camera.distortion
    gx, gy = np.broadcast_arrays(x, y)
    for _ in range(30):
        before = gx, gy
        r2 = gx * gx + gy * gy
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        shift_x = 2 * p1 * gx * gy + p2 * (r2 + 2 * gx * gx)
        shift_y = p1 * (r2 + 2 * gy * gy) + 2 * p2 * gx * gy
        gx, gy = (x - shift_x) / radial, (y - shift_y) / radial
        if max(np.abs(gx - before[0]).max(), np.abs(gy - before[1]).max()) < CONVERGED:
            break
    return gx, gy


class Drawn(Protocol):
    """What can be drawn in squares on a sheet: a board, or any other print."""

    @property
    def square_mm(self) -> float: ...

    @property
    def corners_in_board_mm(self) -> FloatArray: ...

    def image(self, px_per_square: int, /) -> NDArray[np.uint8]: ...


def render(
    camera: Camera,
    layout: Layout | None,
    board: Drawn,
    rig_from_board: FloatArray,
    *,
    blur_px: float = 0.7,
    noise_grey: float = 0.0,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """A grey frame (h, w) of the board via the mirrors of `layout`, or seen directly where it is None."""
    rays = rays_through(camera)
    height, width = rays.shape[:2]
    image = np.full((height, width), 12.0, dtype=np.float32)
    texture = np.pad(board.image(PX_PER_SQUARE), PX_PER_SQUARE, constant_values=255)
    # Soft by a texel: sharp edges that lie along the pixels would err by part of a sample.
    soft = cv2.GaussianBlur(texture.astype(np.float32), (0, 0), 1.0)
    views = [None] if layout is None else list(layout.mirrors)
    turn, shift = rig_from_board[:3, :3], rig_from_board[:3, 3]
    for mirror in views:
        mask = np.ones((height, width), dtype=np.uint8)
        origin, reflection = np.zeros(3), np.eye(3)
        if mirror is not None:
            outline = camera.pixels_from_normalized(mirror.outline_normalized)
            corners = np.rint((outline + 0.5) * SUPERSAMPLING - 0.5).astype(np.int32)
            mask = np.zeros((height, width), dtype=np.uint8)
            cv2.fillConvexPoly(mask, corners, 1)
            origin = mirror.virtual_centre_in_rig_mm
            reflection = np.eye(3) - 2 * np.outer(origin, origin) / (origin @ origin)
        for row in range(0, height, ROWS_AT_ONCE):
            band = np.s_[row : row + ROWS_AT_ONCE]
            inside = mask[band].astype(bool)
            directions = rays[band][inside] @ reflection
            along = (shift - origin) @ turn[:, 2] / (directions @ turn[:, 2])
            on_board = (origin + along[:, None] * directions - shift) @ turn[:, :2] / board.square_mm
            lookup = (on_board[:, ::-1].T + 1) * PX_PER_SQUARE - 0.5
            sampled = map_coordinates(soft, lookup, output=np.float32, order=1, cval=60)
            image[band][inside] = np.where(along > 0, 25.0 + 0.75 * sampled, 12.0)
    small = cv2.resize(image, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(small, (0, 0), blur_px)
    noisy = blurred + np.random.default_rng(seed).normal(0.0, noise_grey, blurred.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def posed(board: Drawn, centre_in_rig: FloatArray, turn_deg: FloatArray, *, direct: bool) -> FloatArray:
    """rig_from_board (4, 4): the board's middle at a point, facing the pupil (direct) or the mirrors, then turned."""
    facing = np.eye(3) if direct else np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    turn = facing @ Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    return rigid(turn, centre_in_rig - turn @ board.corners_in_board_mm.mean(axis=0))
