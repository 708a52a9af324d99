"""What a webcam does to its raw picture: demosaicing, noise reduction, the tone curve and sharpening, in this order."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.render_scenes.settings import SensorModel

Picture = NDArray[np.float32]

DENOISED_PX = 5
"""Width of the neighbourhood of the bilateral filter."""
DENOISING_PX = 1.5
"""Sigma of its weights by distance."""
SHARPENING_PX = 1.0
"""Sigma of the blur that unsharp masking subtracts."""
_STEPS = 256
"""Steps of the raw picture, and of the tone curve, in a grey level."""


def mosaic(light: Picture) -> Picture:
    """The light (h, w) of one colour in each pixel, of rows R G R G... and G B G B...; grey light is itself."""
    if light.ndim == 2:
        return light
    raw = light[..., 1].copy()
    raw[::2, ::2] = light[::2, ::2, 0]
    raw[1::2, 1::2] = light[1::2, 1::2, 2]
    return raw


def processed(grey: Picture, model: SensorModel) -> Picture:
    """Process a picture as it left the pixels, in grey levels: (h, w) of a Bayer pattern or of grey, or (h, w, 3)."""
    if model.bayer:
        grey = demosaiced(grey)
    if model.denoising_grey > 0:
        grey = np.asarray(
            cv2.bilateralFilter(grey, DENOISED_PX, model.denoising_grey, DENOISING_PX, borderType=cv2.BORDER_REPLICATE),
            dtype=np.float32,
        )
    if model.tone_curve == "srgb":
        grey = _toned()[_in_steps(grey)]
    if model.sharpening > 0:
        soft = cv2.GaussianBlur(grey, (0, 0), SHARPENING_PX, borderType=cv2.BORDER_REPLICATE)
        grey = grey + np.float32(model.sharpening) * (grey - soft)
    return grey


def demosaiced(raw: Picture) -> Picture:
    """Fill in the colours (h, w, 3) of a Bayer pattern (h, w), green along edges."""
    colours = cv2.demosaicing(_in_steps(raw), cv2.COLOR_BayerRGGB2RGB_EA)
    return np.asarray(colours, dtype=np.float32) / np.float32(_STEPS)


def srgb(linear: FloatArray) -> FloatArray:
    """Tone curve of IEC 61966-2-1, of values from 0 to 1."""
    return np.asarray(
        np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055)
    )


def _in_steps(grey: Picture) -> NDArray[np.uint16]:
    """Grey levels as whole steps; what is brighter than white is white."""
    return np.asarray(np.clip(np.rint(grey * np.float32(_STEPS)), 0.0, 255.0 * _STEPS).astype(np.uint16))


@cache
def _toned() -> Picture:
    """Grey level behind the tone curve, for each step of grey before it."""
    return (255.0 * srgb(np.arange(255 * _STEPS + 1) / (255.0 * _STEPS))).astype(np.float32)
