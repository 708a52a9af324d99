"""OpenCV's FileStorage: camera matrix, distortion and pose of every view, in the layout's own mm."""

from __future__ import annotations

import cv2
import numpy as np

from mirrorcam.optics.camera_files.write.held_lens import OPENCV
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera


def opencv_yaml(views: tuple[VirtualCamera, ...]) -> str:
    """The views as `cv2.FileStorage` reads them; x_camera = R x_rig + T, as in `cv2.projectPoints`."""
    flip = views[0].flip
    file = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML)
    file.write("image_width", views[0].camera.width_px)
    file.write("image_height", views[0].camera.height_px)
    file.write("flip_code", 1 if flip == "left-right" else 0)
    file.writeComment(f"cv2.flip(frame, flip_code) is the image of every view: {flip}")
    file.write("unit", "mm")
    if views[0].camera.lens_model == "fisheye":
        file.writeComment("distortion_coefficients are those of cv2.fisheye.projectPoints")
        file.write("distortion_model", "fisheye")
    file.startWriteStruct("views", cv2.FILE_NODE_SEQ)
    for view in views:
        cut = view.sub_image
        file.startWriteStruct("", cv2.FILE_NODE_MAP)
        file.write("name", view.name)
        camera = OPENCV.of(view).camera
        file.write("camera_matrix", camera.matrix)
        file.write("distortion_coefficients", camera.distortion[None])
        file.write("R", view.camera_from_rig[:3, :3])
        file.write("T", view.camera_from_rig[:3, 3:])
        file.write("roi", np.array([[cut.x, cut.y, cut.width, cut.height]], dtype=np.int32))
        file.endWriteStruct()
    file.endWriteStruct()
    return str(file.releaseAndGetString())
