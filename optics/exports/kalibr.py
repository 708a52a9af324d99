"""Kalibr's camchain: the views as a chain of pinhole-radtan cameras, in metres.

Kalibr's reader refuses a principal point outside the first quadrant, so the cameras are those of the whole flipped
frame. Its radtan model is OpenCV's without k3.
"""

from __future__ import annotations

import numpy as np

from optics.camera import Camera
from optics.exports.numbers import numbers
from optics.exports.virtual_cameras import VirtualCamera
from optics.values import FloatArray

SAMPLES = 40  # across and down a sub-image, where a lens with k3 is met by one without


def radtan(view: VirtualCamera) -> tuple[FloatArray, float]:
    """(k1, k2, p1, p2) for the view, and by how many px they are wrong at most in its sub-image.

    Without k3 the lens's own and 0. Else those that fit the view's part of the lens best: the model is linear in them.
    """
    camera, cut = view.camera, view.sub_image
    if camera.distortion[4] == 0.0:
        return camera.distortion[:4], 0.0
    x, y = np.linspace(cut.x, cut.x + cut.width - 1, SAMPLES), np.linspace(cut.y, cut.y + cut.height - 1, SAMPLES)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    normalized = camera.normalized_from_pixels(pixels)
    known = np.isfinite(normalized).all(axis=1)
    pixels, normalized = pixels[known], normalized[known]
    # Each coefficient's effect is the projection with it alone at 1, less the one without distortion.
    plain = _project(camera, normalized, np.zeros(4))
    effects = np.stack([(_project(camera, normalized, unit) - plain).ravel() for unit in np.eye(4)], axis=1)
    coefficients = np.asarray(np.linalg.lstsq(effects, (pixels - plain).ravel(), rcond=None)[0], dtype=np.float64)
    error = np.linalg.norm(_project(camera, normalized, coefficients) - pixels, axis=1).max()
    return coefficients, float(error)


def _project(camera: Camera, normalized: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Pixels (n, 2) of the radtan model, wherever it folds."""
    points = np.column_stack([normalized, np.ones(len(normalized))])
    return camera.replaced(distortion=[*coefficients, 0.0]).project_with_jacobians(points)[0]


def camchain_yaml(views: tuple[VirtualCamera, ...]) -> str:
    """`camchain.yaml`: cam0 is the first view, and T_cn_cnm1 takes points of the previous camera to this one."""
    text = ""
    for place, view in enumerate(views):
        camera = view.camera
        coefficients, error_px = radtan(view)
        others = ", ".join(str(other) for other in range(len(views)) if other != place)
        text += f"cam{place}:\n"
        if place > 0:
            turn = view.camera_from_rig @ np.linalg.inv(views[place - 1].camera_from_rig)
            turn[:3, 3] /= 1000.0
            text += "  T_cn_cnm1:\n" + "".join(f"  - [{numbers(row)}]\n" for row in turn)
        text += (
            f"  cam_overlaps: [{others}]\n"
            "  camera_model: pinhole\n"
            f"  distortion_coeffs: [{numbers(coefficients)}]  # within {error_px:.2g} px of the lens here\n"
            "  distortion_model: radtan\n"
            f"  intrinsics: [{numbers(camera.intrinsics[:4])}]\n"
            f"  resolution: [{camera.width_px}, {camera.height_px}]\n"
            f"  rostopic: /mirrorcam/{view.name}/image_raw\n"
        )
    return text
