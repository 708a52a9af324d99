"""Model of lens and sensor: from radiance to the 8-bit picture of a webcam, with blur, vignetting and noise.

Pupil and focus are the renderers': they decide which light comes to a pixel.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.settings import SensorModel


def photograph(
    radiance: NDArray[np.float32],
    subpixels: int,
    camera: Camera,
    model: SensorModel,
    random: np.random.Generator,
) -> NDArray[np.uint8]:
    """Expose a picture.

    The lens blurs before the pixels integrate. In the other order, detail that pixels cannot resolve would already be
    aliased, and corners of boards that lie square to the pixels would err by 0.01 px.

    Parameters
    ----------
    radiance
        (h * subpixels, w * subpixels[, 3]).
    subpixels
        Squares along each side of a pixel.
    camera
        The camera, for vignetting.
    model
        Lens and sensor.
    random
        Generator of the noise.

    Returns
    -------
    NDArray[np.uint8]
        Picture (h, w) or (h, w, 3).
    """
    grey = _pixels(radiance, subpixels, model.lens_blur_px)
    grey *= np.float32(255.0 * model.exposure)
    if model.vignetting > 0:
        lost = _vignette(camera, model.vignetting)
        grey *= lost[..., None] if grey.ndim == 3 else lost
    if model.full_well_electrons > 0 or model.read_noise_grey > 0:
        noise = random.standard_normal(grey.shape, dtype=np.float32)
        if model.full_well_electrons > 0:
            # Shot noise has the variance of the number of electrons; the read noise adds to it.
            electrons = np.maximum(grey, 0.0) * np.float32(255.0 / model.full_well_electrons)
            noise *= np.sqrt(electrons + np.float32(model.read_noise_grey**2))
        else:
            noise *= np.float32(model.read_noise_grey)
        grey += noise
    return np.asarray(cv2.convertScaleAbs(np.clip(np.rint(grey), 0, 255)))


def _pixels(radiance: NDArray[np.float32], subpixels: int, blur_px: float) -> NDArray[np.float32]:
    if blur_px > 0:
        radiance = np.asarray(
            cv2.GaussianBlur(radiance, (0, 0), blur_px * subpixels, borderType=cv2.BORDER_REPLICATE), dtype=np.float32
        )
    if subpixels == 1:
        return radiance.copy()
    height, width = radiance.shape[:2]
    # Whole pixels, so that "area" is their mean.
    size = (width // subpixels, height // subpixels)
    return np.asarray(cv2.resize(radiance, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


@lru_cache(maxsize=2)
def _vignette_of(key: str, exponent: float) -> NDArray[np.float32]:
    camera = Camera.model_validate_json(key)
    x, y = np.arange(camera.width_px), np.arange(camera.height_px)
    # Distortion is small: vignetting is computed from undistorted angles.
    squared = ((x - camera.cx_px) / camera.fx_px) ** 2 + (((y - camera.cy_px) / camera.fy_px) ** 2)[:, None]
    return np.asarray((1.0 + squared) ** (-exponent / 2.0), dtype=np.float32)


def _vignette(camera: Camera, exponent: float) -> NDArray[np.float32]:
    """Vignetting factor (h, w): cos of the field angle to an exponent."""
    return _vignette_of(camera.model_dump_json(), exponent)
