"""Frames of nerfstudio's `transforms.json`, in metres.

nerfstudio puts the centre of the top-left pixel at (0.5, 0.5), has cameras look along their -z with y up, and takes the
world's z for up.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mirrorcam.core.values import FloatArray

HALF_PIXEL = 0.5
"""Offset of nerfstudio's principal points from ours."""
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Axes of OpenCV's cameras from those of OpenGL's, and back."""
WORLD_FROM_VIEW = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rows: the world's x (right), y (to the scene) and z (up) in view axes."""


def frame(
    name: str,
    size: tuple[int, int],
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    world_from_camera: FloatArray,
    distortion: dict[str, float],
) -> dict[str, Any]:
    """One view as a frame: `images/NAME.png` and `masks/NAME.png`, and its camera.

    Parameters
    ----------
    name
        Name of the view.
    size
        Width and height of its picture, px.
    focal_px, centre_px
        Focal lengths and principal point, (0, 0) being the centre of the top-left pixel.
    world_from_camera
        Rigid transform (4, 4) in mm from the camera in OpenCV's axes.
    distortion
        OpenCV's coefficients by name.
    """
    transform = world_from_camera @ OPENCV_FROM_OPENGL
    transform[:3, 3] /= 1000.0
    return {
        "file_path": f"images/{name}.png",
        "mask_path": f"masks/{name}.png",
        "w": size[0],
        "h": size[1],
        "fl_x": focal_px[0],
        "fl_y": focal_px[1],
        "cx": centre_px[0] + HALF_PIXEL,
        "cy": centre_px[1] + HALF_PIXEL,
        **distortion,
        "transform_matrix": transform.tolist(),
    }
