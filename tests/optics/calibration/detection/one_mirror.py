"""A camera with lens distortion, with or without a mirror, and the pixels of a board's corners."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import transform

CAMERA = Camera(
    width_px=800,
    height_px=500,
    fx_px=700.0,
    fy_px=702.0,
    cx_px=395.0,
    cy_px=255.0,
    distortion=[0.05, -0.1, 3e-4, -5e-4, 0],
)


def one_mirror() -> Layout:
    """A single mirror that folds the entire view by 90 degrees."""
    plane = Mirror.from_plane(
        np.array([0.0, 0.0, 80.0]),
        np.array([0.0, 1.0, -1.0]),
        outline_in_rig_mm=np.array([[-40.0, -20, 60], [40, -20, 60], [40, 20, 100], [-40, 20, 100]]),
    )
    return Layout(rows=1, cols=1, camera=CAMERA, mirrors=(plane,))


def seen(points_in_board: FloatArray, pose: FloatArray, layout: Layout | None) -> FloatArray:
    points = transform(pose, points_in_board)
    return CAMERA.project(points) if layout is None else layout.project(points, 0)


def rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2)))
