"""nerfstudio's `transforms.json`: the views of one picture as cropped images, in metres."""

from __future__ import annotations

import json

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write.held_lens import NERFSTUDIO
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera
from mirrorcam.optics.geometry.sfm_rigs import WORLD_FROM_VIEW, frame
from mirrorcam.optics.geometry.transforms import inverse, rigid


def transforms_json(views: tuple[VirtualCamera, ...], view_from_rig: FloatArray) -> str:
    """The views as a dataset; its world is at the pupil, x right, y to the scene, z up (by default the rig frame)."""
    world_from_rig = rigid(WORLD_FROM_VIEW @ view_from_rig, np.zeros(3))
    frames = []
    for view in views:
        camera = view.cut_to_sub_image(NERFSTUDIO.of(view).camera)
        frames.append(
            frame(
                view.name,
                (camera.width_px, camera.height_px),
                (camera.fx_px, camera.fy_px),
                (camera.cx_px, camera.cy_px),
                world_from_rig @ inverse(view.camera_from_rig),
                dict(zip(camera.lens.names, camera.distortion.tolist(), strict=True)),
            )
        )
    model = "OPENCV_FISHEYE" if views[0].camera.lens_model == "fisheye" else "OPENCV"
    return json.dumps({"camera_model": model, "frames": frames}, indent=1, allow_nan=False) + "\n"
