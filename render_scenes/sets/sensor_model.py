"""Model of lens and sensor: from radiance to the 8-bit picture of a webcam, with blur, vignetting and noise."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.settings import SensorModel

# Largest step of sigma, px, between the blur levels that defocus interpolates.
BLUR_STEP_PX = 0.25


def photograph(
    radiance: NDArray[np.float32],
    subpixels: int,
    camera: Camera,
    model: SensorModel,
    random: np.random.Generator,
    path_mm: FloatArray | None = None,
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
        The camera, for defocus and vignetting.
    model
        Lens and sensor.
    random
        Generator of the noise.
    path_mm
        Path length (h, w) of the light of each pixel; NaN or absent: in focus.

    Returns
    -------
    NDArray[np.uint8]
        Picture (h, w) or (h, w, 3).
    """
    grey = _through_lens(radiance, subpixels, model, defocus_px(camera, model, path_mm))
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


def defocus_px(camera: Camera, model: SensorModel, path_mm: FloatArray | None) -> FloatArray | None:
    """Sigma (h, w), px, of the defocus blur, with the variance of the circle of confusion; None without defocus.

    The circle of a thin lens has the diameter f A |1 / focus - 1 / path|; sigma is a quarter of it.
    """
    if model.aperture_mm == 0 or path_mm is None:
        return None
    disc = camera.fx_px * model.aperture_mm * np.abs(1.0 / model.focus_mm - 1.0 / path_mm)
    return np.nan_to_num(disc / 4.0)


def _through_lens(
    radiance: NDArray[np.float32], subpixels: int, model: SensorModel, defocus: FloatArray | None
) -> NDArray[np.float32]:
    """Irradiance (h, w[, 3]) of the pixels."""
    if defocus is None:
        return _pixels(radiance, subpixels, model.lens_blur_px)
    sigma = np.hypot(model.lens_blur_px, defocus).astype(np.float32)
    low, high = float(sigma.min()), float(sigma.max())
    steps = max(int(np.ceil((high - low) / BLUR_STEP_PX)), 1)
    levels = np.linspace(low, high, steps + 1) if high > low else np.array([low])
    light = _pixels(radiance, subpixels, float(levels[0]))
    for before, level in pairwise(levels):
        # Interpolated in variance.
        part = np.clip((sigma**2 - before**2) / (level**2 - before**2), 0.0, 1.0).astype(np.float32)
        softer = _pixels(radiance, subpixels, float(level))
        light += (part[..., None] if light.ndim == 3 else part) * (softer - light)
    return light


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
