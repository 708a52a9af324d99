"""Kalibr's camchain: the views as a chain of pinhole-radtan cameras, in metres.

Kalibr's reader refuses a principal point outside the first quadrant, so the cameras are those of the whole flipped
frame. Its radtan model is OpenCV's without k3.
"""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.base.number_text import numbers
from mirrorcam.optics.exports.virtual_cameras import VirtualCamera
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.transforms import inverse

GAUSS_NEWTON_STEPS = 10
SAMPLES = 40  # across and down a sub-image, where a lens without k3 is fitted to one with k3


def radtan(view: VirtualCamera) -> tuple[Camera, float]:
    """The view's camera without k3, and by how many px it is wrong at most in its sub-image.

    Without k3 the camera itself and 0. Else what fits the view's part of the lens best, in all eight numbers that are
    left: they describe this sub-image and nothing beyond it.
    """
    camera, cut = view.camera, view.sub_image
    if camera.distortion[4] == 0.0:
        return camera, 0.0
    x, y = np.linspace(cut.x, cut.x + cut.width - 1, SAMPLES), np.linspace(cut.y, cut.y + cut.height - 1, SAMPLES)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    normalized = camera.normalized_from_pixels(pixels)
    known = np.isfinite(normalized).all(axis=1)
    rays, pixels = np.column_stack([normalized[known], np.ones(known.sum())]), pixels[known]
    fitted = camera.replaced(distortion=[*camera.distortion[:4], 0.0])
    for _ in range(GAUSS_NEWTON_STEPS):
        found, _, jacobian = fitted.project_with_jacobians(rays)
        columns = jacobian[:, :, :8].reshape(-1, 8)
        scale = np.linalg.norm(columns, axis=0)
        step = np.linalg.lstsq(columns / scale, (pixels - found).ravel(), rcond=None)[0] / scale
        fitted = fitted.with_intrinsics(fitted.intrinsics + np.append(step, 0.0))
    error_px = np.linalg.norm(fitted.project_with_jacobians(rays)[0] - pixels, axis=1).max()
    return fitted, float(error_px)


def camchain_yaml(views: tuple[VirtualCamera, ...]) -> str:
    """`camchain.yaml`: cam0 is the first view, and T_cn_cnm1 takes points of the previous camera to this one."""
    text = ""
    for place, view in enumerate(views):
        camera, error_px = radtan(view)
        others = ", ".join(str(other) for other in range(len(views)) if other != place)
        text += f"cam{place}:\n"
        if place > 0:
            turn = view.camera_from_rig @ inverse(views[place - 1].camera_from_rig)
            turn[:3, 3] /= 1000.0
            text += "  T_cn_cnm1:\n" + "".join(f"  - [{numbers(row)}]\n" for row in turn)
        text += (
            f"  cam_overlaps: [{others}]\n"
            "  camera_model: pinhole\n"
            f"  distortion_coeffs: [{numbers(camera.distortion[:4])}]  # within {error_px:.2g} px of the lens here\n"
            "  distortion_model: radtan\n"
            f"  intrinsics: [{numbers(camera.intrinsics[:4])}]\n"
            f"  resolution: [{camera.width_px}, {camera.height_px}]\n"
            f"  rostopic: /mirrorcam/{view.name}/image_raw\n"
        )
    return text
