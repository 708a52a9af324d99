"""COLMAP: every mirror as a camera of one rig.

COLMAP drops cameras whose principal point lies outside their image, so the images are whole flipped frames, and masks
say what belongs to a view.
"""

from __future__ import annotations

from mirrorcam.optics.camera_files.write.held_lens import COLMAP
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera
from mirrorcam.optics.geometry.sfm_rigs import HALF_PIXEL, RigCamera


def rig_cameras(views: tuple[VirtualCamera, ...]) -> tuple[RigCamera, ...]:
    """The views as cameras of a rig; the world is the rig frame.

    FULL_OPENCV has fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, the last three zero of a Brown-Conrady lens;
    OPENCV_FISHEYE fx, fy, cx, cy, k1, k2, k3, k4.
    """
    cameras = []
    for view in views:
        camera = COLMAP.of(view).camera
        fx, fy, cx, cy, *distortion = (float(value) for value in camera.intrinsics)
        model = "OPENCV_FISHEYE" if camera.lens_model == "fisheye" else "FULL_OPENCV"
        unused = (0.0,) * (3 if camera.lens_model == "brown_conrady" else 0)
        parameters = (fx, fy, cx + HALF_PIXEL, cy + HALF_PIXEL, *distortion, *unused)
        cameras.append(RigCamera(view.name, model, camera.width_px, camera.height_px, parameters, view.camera_from_rig))
    return tuple(cameras)
