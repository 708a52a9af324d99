"""From radiance to the picture that a webcam delivers: lens blur, pixels, noise, eight bits."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from render_scenes.dataset import SensorModel


def photograph(
    radiance: NDArray[np.float32], subpixels: int, model: SensorModel, random: np.random.Generator
) -> NDArray[np.uint8]:
    """A grey picture (h, w) of radiance (h * subpixels, w * subpixels); radiance 1 is grey level 255.

    The lens blurs before the pixels collect the light. The other way round, what pixels cannot resolve would already
    have turned into false detail, and corners of boards that lie square to the pixels would err by .01 px.
    """
    light = radiance
    if model.lens_blur_px > 0:
        sigma = model.lens_blur_px * subpixels
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
    height, width = (length // subpixels for length in radiance.shape)
    grey = 255.0 * light.reshape(height, subpixels, width, subpixels).mean(axis=(1, 3), dtype=np.float32)
    if model.read_noise_grey > 0:
        grey = grey + np.float32(model.read_noise_grey) * random.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
