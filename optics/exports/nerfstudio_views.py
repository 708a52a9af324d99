"""nerfstudio's `transforms.json`: the views of one picture as cropped images, in metres.

nerfstudio puts the centre of the top-left pixel at (0.5, 0.5), has cameras look along their -z with y up, and takes the
world's z for up.
"""

from __future__ import annotations

import json

import numpy as np

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.exports.virtual_cameras import VirtualCamera
from mirrorcam.optics.geometry.transforms import rigid

HALF_PIXEL = 0.5
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
WORLD_FROM_VIEW = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rows: the world's x (right), y (to the scene) and z (up) in view axes."""


def transforms_json(views: tuple[VirtualCamera, ...], view_from_rig: FloatArray) -> str:
    """The views as a dataset; its world is at the pupil, x right, y to the scene, z up (by default the rig frame)."""
    world_from_rig = rigid(WORLD_FROM_VIEW @ view_from_rig, np.zeros(3))
    frames = []
    for view in views:
        camera = view.cropped
        world_from_camera = world_from_rig @ np.linalg.inv(view.camera_from_rig) @ OPENCV_FROM_OPENGL
        world_from_camera[:3, 3] /= 1000.0
        frames.append(
            {
                "file_path": f"images/{view.name}.png",
                "mask_path": f"masks/{view.name}.png",
                "w": camera.width_px,
                "h": camera.height_px,
                "fl_x": camera.fx_px,
                "fl_y": camera.fy_px,
                "cx": camera.cx_px + HALF_PIXEL,
                "cy": camera.cy_px + HALF_PIXEL,
                **dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion.tolist(), strict=True)),
                "transform_matrix": world_from_camera.tolist(),
            }
        )
    return json.dumps({"camera_model": "OPENCV", "frames": frames}, indent=1, allow_nan=False) + "\n"
