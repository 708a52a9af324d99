"""Kalibr's camchain: the views as a chain of pinhole-radtan cameras, in metres.

Kalibr's reader refuses a principal point outside the first quadrant, so the cameras are those of the whole flipped
frame. Its radtan model is OpenCV's without k3, its equidistant one is OpenCV's fisheye.
"""

from __future__ import annotations

from mirrorcam.core.number_text import numbers
from mirrorcam.optics.camera_files.write.held_lens import KALIBR
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera
from mirrorcam.optics.geometry.transforms import inverse


def camchain_yaml(views: tuple[VirtualCamera, ...]) -> str:
    """`camchain.yaml`: cam0 is the first view, and T_cn_cnm1 takes points of the previous camera to this one."""
    text = ""
    for place, view in enumerate(views):
        lens = KALIBR.of(view)
        camera = lens.camera
        model = "equidistant" if camera.lens_model == "fisheye" else "radtan"
        others = ", ".join(str(other) for other in range(len(views)) if other != place)
        text += f"cam{place}:\n"
        if place > 0:
            turn = view.camera_from_rig @ inverse(views[place - 1].camera_from_rig)
            turn[:3, 3] /= 1000.0
            text += "  T_cn_cnm1:\n" + "".join(f"  - [{numbers(row)}]\n" for row in turn)
        text += (
            f"  cam_overlaps: [{others}]\n"
            "  camera_model: pinhole\n"
            f"  distortion_coeffs: [{numbers(camera.distortion[:4])}]"
            f"  # within {lens.error_px:.2g} px of the lens here\n"
            f"  distortion_model: {model}\n"
            f"  intrinsics: [{numbers(camera.intrinsics[:4])}]\n"
            f"  resolution: [{camera.width_px}, {camera.height_px}]\n"
            f"  rostopic: /mirrorcam/{view.name}/image_raw\n"
        )
    return text
