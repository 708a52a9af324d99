"""Pictures of a wall by cameras in any poses, with distortion, and how far a light field of them is off the wall."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.light_field import LightField

SIZE, FOCAL_PX, DISTANCE_MM = (96, 72), 90.0, 500.0


def texture(x: Any, y: Any) -> Any:
    """Return the smooth grey levels, 0 to 1, of a wall at (x, y), mm."""
    return 0.5 + 0.2 * np.sin(x / 11.0) * np.cos(y / 13.0) + 0.2 * np.sin(x / 29.0 + y / 23.0)


def cameras(rows: int, cols: int, turn_deg: float, seed: int = 3) -> FloatArray:
    """Return poses (n, 4, 4) of a 20 mm grid whose cameras are each turned about a random axis."""
    random = np.random.default_rng(seed)
    t, s = np.indices((rows, cols)).reshape(2, -1)
    centres = np.stack([(s - cols // 2) * 20.0, (t - rows // 2) * 20.0, random.uniform(8, 12, s.size)], axis=1)
    turns = random.normal(size=(s.size, 3))
    turns *= np.radians(turn_deg) / np.linalg.norm(turns, axis=1, keepdims=True)
    return rigid(Rotation.from_rotvec(turns).as_matrix(), centres)


def distort(points: FloatArray, distortion: FloatArray) -> FloatArray:
    """Distort normalized points (n, 2) by OpenCV's camera model."""
    rays = np.column_stack([points, np.ones(len(points))])
    return np.asarray(cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), distortion)[0][:, 0])


def photographs(poses: FloatArray, focal_px: FloatArray, distortion: FloatArray, size: tuple[int, int] = SIZE) -> Any:
    """Return pictures (n, h, w), float, of a wall at z = 500 mm by OpenCV's camera model."""
    pictures = []
    v, u = np.indices((size[1], size[0]), dtype=np.float64)
    for pose, focal in zip(poses, focal_px, strict=True):
        distorted = (np.stack([u, v], axis=-1).reshape(-1, 2) - (np.array(size) - 1) / 2) / focal
        points = distorted.copy()
        for _ in range(50):
            points += distorted - distort(points, distortion)
        rays = np.column_stack([points, np.ones(len(points))]) @ pose[:3, :3].T
        hit = pose[:3, 3] + rays * ((DISTANCE_MM - pose[2, 3]) / rays[:, 2:])
        pictures.append(texture(hit[:, 0], hit[:, 1]).reshape(size[1], size[0]))
    return np.array(pictures)


def wall_error(light_field: LightField) -> tuple[float, float]:
    """Return the RMS difference of samples from the wall's texture at their rays, and the fraction with a sample."""
    differences = []
    turn = light_field.view_from_rig
    for index in np.ndindex(light_field.rows, light_field.cols):
        matrix, position = light_field.matrices[index], light_field.positions_mm[index]
        rays = np.concatenate([light_field.pixel_grid(), np.ones((*light_field.weights.shape[2:], 1))], axis=-1)
        rays = rays @ np.linalg.inv(matrix).T @ turn
        centre = position @ turn + light_field.reference_view_in_rig_mm
        hit = centre + rays * ((DISTANCE_MM - centre[2]) / rays[..., 2:])
        valid = light_field.valid[index]
        differences.append((light_field.samples[index][..., 0] - texture(hit[..., 0], hit[..., 1]))[valid])
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2))), float(light_field.valid.mean())
