"""Lens and pixels: the light that each pixel gathers, in the colours that lens or sensor tell apart."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.settings import SensorModel

Light = NDArray[np.float32]

NODES = np.arange(-3, 5)
"""Pixels, from the one before a place, through which a picture is interpolated.

An edge behind a lens of 0.8 px stays in its place, and is right to 0.8 % of its step.
"""


@dataclass(frozen=True)
class _Colour:
    """Magnification of one colour about the principal point, and sigma of the blur in it, px."""

    magnification: float
    blur_px: float


def light_of_pixels(radiance: Light, subpixels: int, camera: Camera, model: SensorModel) -> Light:
    """Blur radiance by the lens and gather it in pixels.

    The lens blurs before the pixels integrate. In the other order, detail that pixels cannot resolve would already be
    aliased, and corners of boards that lie square to the pixels would err by 0.01 px.

    Parameters
    ----------
    radiance
        (h * subpixels, w * subpixels[, 3]).
    subpixels
        Squares along each side of a pixel.
    camera
        The camera, whose principal point lateral chromatic aberration leaves in place.
    model
        Lens.

    Returns
    -------
    Light
        (h, w) of grey light through a lens without chromatic aberration, (h, w, 3) otherwise.
    """
    if model.lateral_chromatic_percent == 0.0 and model.axial_chromatic_px == 0.0:
        return _gathered(radiance, subpixels, model.lens_blur_px)
    out_of_focus = float(np.hypot(model.lens_blur_px, model.axial_chromatic_px))
    more = model.lateral_chromatic_percent / 100.0
    red_green_blue = (
        _Colour(1.0 + more, out_of_focus),
        _Colour(1.0, model.lens_blur_px),
        _Colour(1.0 - more, out_of_focus),
    )
    planes = []
    for channel, colour in enumerate(red_green_blue):
        plane = radiance if radiance.ndim == 2 else np.ascontiguousarray(radiance[..., channel])
        planes.append(magnified(_gathered(plane, subpixels, colour.blur_px), camera, colour.magnification))
    return np.stack(planes, axis=-1)


def _gathered(radiance: Light, subpixels: int, blur_px: float) -> Light:
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


def magnified(picture: Light, camera: Camera, magnification: float) -> Light:
    """Magnify a picture (h, w) about the principal point; what lies beyond its border is like the border.

    Along one axis after the other, with weights in full precision: `cv2.remap` rounds places to 1/32 px.
    """
    if magnification == 1.0:
        return picture
    for axis, centre_px in ((1, camera.cx_px), (0, camera.cy_px)):
        picture = _stretched(picture, axis, centre_px, magnification)
    return picture


def _stretched(picture: Light, axis: int, centre_px: float, magnification: float) -> Light:
    places = np.arange(picture.shape[axis], dtype=np.float64)
    shift = (places - centre_px) * (1.0 / magnification - 1.0)
    before = np.floor(shift)
    offsets = np.arange(int(before.min()) + NODES[0], int(before.max()) + NODES[-1] + 1)
    low, high = int(offsets[0]), int(offsets[-1])
    weights = np.zeros((len(offsets), len(shift)))
    for node, weight in zip(NODES, _lagrange(shift - before), strict=True):
        weights[(before + node - low).astype(np.int64), np.arange(len(shift))] = weight
    margin = [(0, 0), (0, 0)]
    margin[axis] = (max(-low, 0), max(high, 0))
    padded = np.pad(picture, margin, mode="edge")
    stretched = np.zeros_like(picture)
    for offset, weight in zip(offsets + margin[axis][0], weights.astype(np.float32), strict=True):
        part = slice(int(offset), int(offset) + picture.shape[axis])
        if axis == 1:
            stretched += weight * padded[:, part]
        else:
            stretched += weight[:, None] * padded[part]
    return stretched


def _lagrange(parts: FloatArray) -> FloatArray:
    """Weights (nodes, n) of the polynomial through `NODES`, at places (n,) from 0 to 1."""
    others = [NODES[node != NODES] for node in NODES]
    return np.array(
        [np.prod((parts[:, None] - other) / (node - other), axis=1) for node, other in zip(NODES, others, strict=True)]
    )
