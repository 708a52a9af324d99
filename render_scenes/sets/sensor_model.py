"""Model of lens and sensor: from radiance to the 8-bit picture of a webcam.

Blur, colours, vignetting, veiling glare and noise, then what the webcam does to the raw picture.
Pupil and focus are the renderers': they decide which light comes to a pixel.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.chromatic_lens import light_of_pixels
from mirrorcam.render_scenes.sets.image_processing import mosaic, processed
from mirrorcam.render_scenes.settings import SensorModel

NOISE_ROWS = 32
"""Rows that get their noise at a time."""


def photograph(
    radiance: NDArray[np.float32],
    subpixels: int,
    camera: Camera,
    model: SensorModel,
    random: np.random.Generator,
) -> NDArray[np.uint8]:
    """Expose a picture.

    Parameters
    ----------
    radiance
        (h * subpixels, w * subpixels[, 3]).
    subpixels
        Squares along each side of a pixel.
    camera
        The camera, for vignetting and chromatic aberration.
    model
        Lens and sensor.
    random
        Generator of the noise.

    Returns
    -------
    NDArray[np.uint8]
        Picture (h, w) of grey light where nothing tells colours apart, otherwise (h, w, 3).
    """
    light = light_of_pixels(radiance, subpixels, camera, model)
    light *= np.float32(255.0 * model.exposure)
    if model.vignetting > 0:
        light *= _per_pixel(_vignette(camera, model.vignetting), light)
    if model.veiling_glare > 0:
        light += np.float32(model.veiling_glare) * light.mean(axis=(0, 1))
    grey = mosaic(light) if model.bayer else light
    if model.prnu_percent > 0:
        grey *= _per_pixel(_sensitivity(camera.width_px, camera.height_px, model.prnu_percent), grey)
    if model.full_well_electrons > 0 or model.read_noise_grey > 0:
        _add_noise(grey, model, random)
    return np.asarray(cv2.convertScaleAbs(np.maximum(processed(grey, model), 0.0)))


def _add_noise(grey: NDArray[np.float32], model: SensorModel, random: np.random.Generator) -> None:
    """Add shot and read noise to a picture (h, w[, 3]), some rows at a time, which stay in the processor's cache."""
    for start in range(0, len(grey), NOISE_ROWS):
        rows = grey[start : start + NOISE_ROWS]
        noise = random.standard_normal(rows.shape, dtype=np.float32)
        if model.full_well_electrons > 0:
            # Shot noise has the variance of the number of electrons; the read noise adds to it.
            variance = np.maximum(rows, 0.0)
            variance *= np.float32(255.0 / model.full_well_electrons)
            variance += np.float32(model.read_noise_grey**2)
            noise *= np.sqrt(variance, out=variance)
        else:
            noise *= np.float32(model.read_noise_grey)
        rows += noise


def _per_pixel(factor: NDArray[np.float32], grey: NDArray[np.float32]) -> NDArray[np.float32]:
    return factor[..., None] if grey.ndim == 3 else factor


@lru_cache(maxsize=2)
def _sensitivity(width_px: int, height_px: int, percent: float) -> NDArray[np.float32]:
    """Sensitivity (h, w) of the pixels of one and the same sensor."""
    pattern = np.random.default_rng(0).standard_normal((height_px, width_px), dtype=np.float32)
    return np.asarray(1.0 + np.float32(percent / 100.0) * pattern)


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
