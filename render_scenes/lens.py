"""The lens of a sensor: undistorted pixels of the full sensor, smooth deviations from the lens model, and defocus.

Undistorted pixels come from a spline between nodes at which they are exact.

A thin lens images a point out of focus as a disc with diameter f A |1 / focus - 1 / distance|, both distances along the
axis. For a plane, the diameter is linear in the image. Views of planar boards are blurred by a Gaussian with the
variance of this circle of confusion.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.interpolate import RectBivariateSpline

from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lateral_colour import LUMA
from mirrorcam.render_scenes.settings import SensorModel

STEPS = 4
"""Fixed-point iterations; each divides the error by more than 100 if the RMS of the waves is below a pixel."""
PERIODS = 2.0
"""Number of waves across the width of the sensor."""


class WavyCamera(Camera):
    """A camera whose pixel p has the ray of the model's pixel p - w(p).

    With a = 2 pi `PERIODS` p / width and A twice the RMS, w = A (sin a_x cos a_y, cos a_x sin a_y).

    Attributes
    ----------
    waves_px
        RMS of w along an axis.
    """

    waves_px: float = Field(ge=0)

    @cached_property
    def model(self) -> Camera:
        """The camera without waves."""
        return Camera.model_validate(self.model_dump(exclude={"waves_px"}))

    def waves(self, pixels: FloatArray) -> FloatArray:
        """Return the waves w (..., 2) in px at pixels (..., 2)."""
        angle = 2.0 * np.pi * PERIODS * pixels / self.width_px
        sine, cosine = np.sin(angle), np.cos(angle)
        return 2.0 * self.waves_px * np.stack([sine[..., 0] * cosine[..., 1], cosine[..., 0] * sine[..., 1]], axis=-1)

    def pixels_from_normalized(self, normalized: FloatArray) -> FloatArray:
        in_model = self.model.pixels_from_normalized(normalized)
        pixels = in_model
        for _ in range(STEPS):
            pixels = in_model + self.waves(pixels)
        return pixels

    def normalized_from_pixels(self, pixels: FloatArray) -> FloatArray:
        pixels = np.asarray(pixels, dtype=np.float64)
        return self.model.normalized_from_pixels(pixels - self.waves(pixels))


class TrueLens(Value):
    """What a layout cannot describe of the lens of a set: its waves, and the magnification of grey pictures.

    Attributes
    ----------
    waves_px
        See `WavyCamera`.
    grey_magnification
        Magnification of grey pictures about the principal point, relative to green light, which the layout describes.
    """

    waves_px: float = Field(ge=0)
    grey_magnification: float = Field(gt=0)

    @classmethod
    def of(cls, sensor: SensorModel) -> TrueLens:
        """Return the lens of a sensor model."""
        return cls(waves_px=sensor.lens_waves_px, grey_magnification=grey_magnification(sensor))

    def camera(self, green: Camera) -> Camera:
        """Return the camera that grey pictures show, given that of green light without waves."""
        factor = self.grey_magnification
        grey = green.replaced(fx_px=factor * green.fx_px, fy_px=factor * green.fy_px)
        return WavyCamera(**grey.model_dump(), waves_px=self.waves_px) if self.waves_px > 0.0 else grey


PIXEL_VARIANCE_PX2 = 1.0 / 12.0
MOSAIC_VARIANCE_PX2 = 0.5
"""Variance of the blur by which the mosaic's interpolation widens edges of red and blue."""


def grey_magnification(sensor: SensorModel) -> float:
    """Magnification of edges in grey pictures, relative to green light.

    Least squares locate an edge by a model with the mean blur. Each colour then counts by its weight, and by the
    correlation of its edge's slope with that of the model, both of them Gaussian. Other methods find other
    magnifications: for the sensor `webcam`, this one gives 66e-6 and `cv2.cornerSubPix` 39e-6 to 48e-6.
    """
    excess = sensor.lateral_chromatic_percent / 100.0 * np.array([1.0, 0.0, -1.0])
    variance = sensor.lens_blur_px**2 + PIXEL_VARIANCE_PX2 + np.zeros(3)
    variance[[0, 2]] += sensor.axial_chromatic_px**2 + (MOSAIC_VARIANCE_PX2 if sensor.bayer else 0.0)
    weights = LUMA / np.sqrt(variance + LUMA @ variance)
    return float(1.0 + weights @ excess / weights.sum())


def with_pupil_of(camera: Camera, sensor: SensorModel) -> Camera:
    """Return the camera with the pupil of a sensor model: its diameter, its focus, and its walk."""
    return camera.with_pupil(sensor.pupil).replaced(pupil_walk_mm=sensor.pupil_walk_mm or None)


def true_camera(camera: Camera, sensor: SensorModel) -> Camera:
    """Return the camera with the waves of a sensor model's lens, or the camera itself without waves."""
    if sensor.lens_waves_px == 0.0:
        return camera
    return WavyCamera(**camera.model_dump(), waves_px=sensor.lens_waves_px)


GRID_PX = 8.0  # spacing of the exact nodes; a quintic spline between them is accurate to 1e-7 px


def undistorted_pixels(camera: Camera, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return normalized coordinates (n_v, n_u, 2) of the pixels with columns u and rows v, both increasing."""
    # Nodes up to the edge of the sensor, beyond which the lens model may have no rays.
    nodes = [
        np.linspace(-0.5, length - 0.5, int(length / GRID_PX) + 2) for length in (camera.height_px, camera.width_px)
    ]
    exact = camera.normalized_from_pixels(np.stack(np.meshgrid(nodes[1], nodes[0]), axis=-1))
    splines = [RectBivariateSpline(*nodes, exact[..., axis], kx=5, ky=5) for axis in range(2)]
    return np.stack([spline(v, u) for spline in splines], axis=-1)


BLUR_STEP_PX = 0.25
"""Maximum step of sigma in px between the blurred copies that are interpolated."""

MIN_BLUR_PX = 0.02
"""Sigma in px below which blur is neglected."""

ROWS = 32
"""Number of rows per batch of interpolation."""

MIN_SAMPLED_SIGMA = 0.7
"""Minimum sigma in subpixels at which a sampled Gaussian has the right variance; smaller ones are interpolated."""


def defocused(sharp: NDArray[np.float32], variance_px2: NDArray[np.float32], subpixels: int) -> NDArray[np.float32]:
    """Blur a view (h, w) with a different variance at each subpixel (h, w), interpolating between blurred copies.

    Parameters
    ----------
    sharp
        The view in focus.
    variance_px2
        Variance of the defocus along an axis, px^2.
    subpixels
        Subpixels along each side of a pixel.
    """
    low, high = (float(np.sqrt(bound)) for bound in (variance_px2.min(), variance_px2.max()))
    if high < MIN_BLUR_PX:
        return sharp
    levels = _levels(low * subpixels, high * subpixels, BLUR_STEP_PX * subpixels)
    blurred = [_blurred(sharp, level) for level in levels]
    result = np.empty_like(sharp)
    # Batches of rows fit the processor's cache.
    for start in range(0, len(sharp), ROWS):
        rows = slice(start, start + ROWS)
        mixed = blurred[0][rows]
        for (lower, upper), copy in zip(pairwise(levels), blurred[1:], strict=True):
            blend = variance_px2[rows] * np.float32(subpixels**2 / (upper**2 - lower**2))
            blend -= np.float32(lower**2 / (upper**2 - lower**2))
            if len(levels) > 2:
                np.clip(blend, 0.0, 1.0, out=blend)
            blend *= copy[rows] - mixed
            blend += mixed
            mixed = blend
        result[rows] = mixed
    return result


def _levels(low: float, high: float, step: float) -> list[float]:
    """Return ascending sigmas from `low` (or less) to `high` (or more), all 0 or at least `MIN_SAMPLED_SIGMA`."""
    low = low if low >= MIN_SAMPLED_SIGMA else 0.0
    even = np.linspace(low, high, max(int(np.ceil((high - low) / step)), 1) + 1).tolist()
    inner = [level for level in even[1:-1] if level >= MIN_SAMPLED_SIGMA]
    return sorted({low, *inner, max(high, MIN_SAMPLED_SIGMA)})


def _blurred(picture: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    if sigma == 0.0:
        return picture
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
