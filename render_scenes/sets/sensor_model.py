"""Model of lens and sensor: from radiance to the 8-bit picture of a webcam.

It applies blur, chromatic aberration, vignetting, veiling glare and noise, then the webcam's processing of the raw
picture: demosaicing, noise reduction, the tone curve and sharpening, in this order. The renderers model pupil and
focus.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.settings import SensorModel

Float32 = NDArray[np.float32]

NODES = np.arange(-3, 5)
"""Offsets of the pixels from which a picture is interpolated, relative to the pixel to the left of the point.

The interpolation does not shift an edge blurred with sigma 0.8 px; its error is below 0.8 % of the edge's contrast.
"""


@dataclass(frozen=True)
class _Colour:
    """Magnification of one colour about the principal point, and sigma of its blur, px."""

    magnification: float
    blur_px: float


def pixel_irradiance(radiance: Float32, subpixels: int, camera: Camera, model: SensorModel) -> Float32:
    """Blur radiance as the lens does, and integrate it over the pixels.

    The blur comes first. In the reverse order, detail that pixels cannot resolve would already be aliased, with errors
    of 0.01 px at corners of boards aligned with the pixels.

    Parameters
    ----------
    radiance
        (h * subpixels, w * subpixels[, 3]).
    subpixels
        Subpixels along each side of a pixel.
    camera
        The camera; its principal point is the centre of lateral chromatic aberration.
    model
        The model; only its lens is used.

    Returns
    -------
    Float32
        (h, w) for grey light through a lens without chromatic aberration, otherwise (h, w, 3).
    """
    if model.lateral_chromatic_percent == 0.0 and model.axial_chromatic_px == 0.0:
        return _blurred_pixels(radiance, subpixels, model.lens_blur_px)
    out_of_focus = float(np.hypot(model.lens_blur_px, model.axial_chromatic_px))
    excess = model.lateral_chromatic_percent / 100.0
    red_green_blue = (
        _Colour(1.0 + excess, out_of_focus),
        _Colour(1.0, model.lens_blur_px),
        _Colour(1.0 - excess, out_of_focus),
    )
    planes = []
    for channel, colour in enumerate(red_green_blue):
        plane = radiance if radiance.ndim == 2 else np.ascontiguousarray(radiance[..., channel])
        planes.append(magnify(_blurred_pixels(plane, subpixels, colour.blur_px), camera, colour.magnification))
    return np.stack(planes, axis=-1)


def _blurred_pixels(radiance: Float32, subpixels: int, blur_px: float) -> Float32:
    if blur_px > 0:
        radiance = np.asarray(
            cv2.GaussianBlur(radiance, (0, 0), blur_px * subpixels, borderType=cv2.BORDER_REPLICATE), dtype=np.float32
        )
    if subpixels == 1:
        return radiance.copy()
    height, width = radiance.shape[:2]
    # With an integer factor, INTER_AREA is the mean of the subpixels.
    size = (width // subpixels, height // subpixels)
    return np.asarray(cv2.resize(radiance, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def magnify(picture: Float32, camera: Camera, magnification: float) -> Float32:
    """Magnify a picture (h, w) about the principal point, with its border replicated.

    Each axis is interpolated with weights in full precision, because `cv2.remap` rounds coordinates to 1/32 px.
    """
    if magnification == 1.0:
        return picture
    for axis, centre_px in ((1, camera.cx_px), (0, camera.cy_px)):
        picture = _magnify_axis(picture, axis, centre_px, magnification)
    return picture


def _magnify_axis(picture: Float32, axis: int, centre_px: float, magnification: float) -> Float32:
    coordinates = np.arange(picture.shape[axis], dtype=np.float64)
    shift = (coordinates - centre_px) * (1.0 / magnification - 1.0)
    whole_px = np.floor(shift)
    offsets = np.arange(int(whole_px.min()) + NODES[0], int(whole_px.max()) + NODES[-1] + 1)
    low, high = int(offsets[0]), int(offsets[-1])
    weights = np.zeros((len(offsets), len(shift)))
    for node, weight in zip(NODES, _lagrange(shift - whole_px), strict=True):
        weights[(whole_px + node - low).astype(np.int64), np.arange(len(shift))] = weight
    margin = [(0, 0), (0, 0)]
    margin[axis] = (max(-low, 0), max(high, 0))
    padded = np.pad(picture, margin, mode="edge")
    result = np.zeros_like(picture)
    for offset, weight in zip(offsets + margin[axis][0], weights.astype(np.float32), strict=True):
        window = slice(int(offset), int(offset) + picture.shape[axis])
        if axis == 1:
            result += weight * padded[:, window]
        else:
            result += weight[:, None] * padded[window]
    return result


def _lagrange(positions: FloatArray) -> FloatArray:
    """Return the Lagrange weights (nodes, n) of `NODES` at positions (n,) from 0 to 1."""
    other_nodes = [NODES[node != NODES] for node in NODES]
    return np.array(
        [
            np.prod((positions[:, None] - others) / (node - others), axis=1)
            for node, others in zip(NODES, other_nodes, strict=True)
        ]
    )


DENOISING_PX = 5
"""Diameter of the bilateral filter's neighbourhood."""
DENOISING_SIGMA_PX = 1.5
"""Spatial sigma of the bilateral filter."""
SHARPENING_SIGMA_PX = 1.0
"""Sigma of the blur that unsharp masking subtracts."""
_STEPS = 256
"""Number of steps per grey level, in the raw picture and in the tone curve."""


def mosaic(light: Float32) -> Float32:
    """Sample one colour per pixel (h, w), in rows R G R G... and G B G B...; grey light stays unchanged."""
    if light.ndim == 2:
        return light
    raw = light[..., 1].copy()
    raw[::2, ::2] = light[::2, ::2, 0]
    raw[1::2, 1::2] = light[1::2, 1::2, 2]
    return raw


def process(levels: Float32, model: SensorModel) -> Float32:
    """Process a raw picture, digital numbers: (h, w) if grey or with a Bayer pattern, otherwise (h, w, 3)."""
    if model.bayer:
        levels = demosaic(levels)
    if model.denoising_grey > 0:
        levels = np.asarray(
            cv2.bilateralFilter(
                levels, DENOISING_PX, model.denoising_grey, DENOISING_SIGMA_PX, borderType=cv2.BORDER_REPLICATE
            ),
            dtype=np.float32,
        )
    if model.tone_curve == "srgb":
        levels = _tone_curve()[_in_steps(levels)]
    if model.sharpening > 0:
        blurred = cv2.GaussianBlur(levels, (0, 0), SHARPENING_SIGMA_PX, borderType=cv2.BORDER_REPLICATE)
        levels = levels + np.float32(model.sharpening) * (levels - blurred)
    return levels


def demosaic(raw: Float32) -> Float32:
    """Interpolate the colours (h, w, 3) of a Bayer pattern (h, w), with green interpolated along edges."""
    colours = cv2.demosaicing(_in_steps(raw), cv2.COLOR_BayerRGGB2RGB_EA)
    return np.asarray(colours, dtype=np.float32) / np.float32(_STEPS)


def srgb(linear: FloatArray) -> FloatArray:
    """Apply the tone curve of IEC 61966-2-1 to values from 0 to 1."""
    return np.asarray(
        np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055)
    )


def _in_steps(levels: Float32) -> NDArray[np.uint16]:
    """Return digital numbers in integer steps, clipped at white."""
    return np.asarray(np.clip(np.rint(levels * np.float32(_STEPS)), 0.0, 255.0 * _STEPS).astype(np.uint16))


@cache
def _tone_curve() -> Float32:
    """Return the tone curve's output grey level for each input step."""
    return (255.0 * srgb(np.arange(255 * _STEPS + 1) / (255.0 * _STEPS))).astype(np.float32)


NOISE_ROWS = 32
"""Number of rows per batch of noise."""


def photograph(
    radiance: NDArray[np.float32],
    subpixels: int,
    camera: Camera,
    model: SensorModel,
    random: np.random.Generator,
) -> NDArray[np.uint8]:
    """Convert radiance to an 8-bit picture.

    Parameters
    ----------
    radiance
        (h * subpixels, w * subpixels[, 3]).
    subpixels
        Subpixels along each side of a pixel.
    camera
        The camera, for vignetting and chromatic aberration.
    model
        Lens and sensor.
    random
        Generator of the noise.

    Returns
    -------
    NDArray[np.uint8]
        Picture (h, w) for grey light if neither lens nor sensor separates colours, otherwise (h, w, 3).
    """
    light = pixel_irradiance(radiance, subpixels, camera, model)
    light *= np.float32(255.0 * model.exposure)
    if model.vignetting > 0:
        light *= _per_pixel(_vignette(camera, model.vignetting), light)
    if model.veiling_glare > 0:
        light += np.float32(model.veiling_glare) * light.mean(axis=(0, 1))
    levels = mosaic(light) if model.bayer else light
    if model.prnu_percent > 0:
        levels *= _per_pixel(_sensitivity(camera.width_px, camera.height_px, model.prnu_percent), levels)
    if model.full_well_electrons > 0 or model.read_noise_grey > 0:
        _add_noise(levels, model, random)
    return np.asarray(cv2.convertScaleAbs(np.maximum(process(levels, model), 0.0)))


def _add_noise(levels: NDArray[np.float32], model: SensorModel, random: np.random.Generator) -> None:
    """Add shot and read noise to a picture (h, w[, 3]), in batches of rows that fit the processor's cache."""
    for start in range(0, len(levels), NOISE_ROWS):
        rows = levels[start : start + NOISE_ROWS]
        noise = random.standard_normal(rows.shape, dtype=np.float32)
        if model.full_well_electrons > 0:
            # The variance of shot noise is the number of electrons; the read noise's variance adds to it.
            variance = np.maximum(rows, 0.0)
            variance *= np.float32(255.0 / model.full_well_electrons)
            variance += np.float32(model.read_noise_grey**2)
            noise *= np.sqrt(variance, out=variance)
        else:
            noise *= np.float32(model.read_noise_grey)
        rows += noise


def _per_pixel(factor: NDArray[np.float32], levels: NDArray[np.float32]) -> NDArray[np.float32]:
    return factor[..., None] if levels.ndim == 3 else factor


@lru_cache(maxsize=2)
def _sensitivity(width_px: int, height_px: int, percent: float) -> NDArray[np.float32]:
    """Return the relative sensitivity (h, w) of the pixels, the same for all pictures."""
    pattern = np.random.default_rng(0).standard_normal((height_px, width_px), dtype=np.float32)
    return np.asarray(1.0 + np.float32(percent / 100.0) * pattern)


@lru_cache(maxsize=2)
def _vignette_of(key: str, exponent: float) -> NDArray[np.float32]:
    camera = Camera.model_validate_json(key)
    x, y = np.arange(camera.width_px), np.arange(camera.height_px)
    # Vignetting neglects distortion, which is small.
    squared = ((x - camera.cx_px) / camera.fx_px) ** 2 + (((y - camera.cy_px) / camera.fy_px) ** 2)[:, None]
    return np.asarray((1.0 + squared) ** (-exponent / 2.0), dtype=np.float32)


def _vignette(camera: Camera, exponent: float) -> NDArray[np.float32]:
    """Return the vignetting factor (h, w): the cosine of the field angle raised to `exponent`."""
    return _vignette_of(camera.model_dump_json(), exponent)
