"""The lens of a sensor: undistorted pixels of a whole sensor, and a camera whose lens is off its model by smooth waves.

Undistorted pixels come from a spline between nodes at which they are exact.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from pydantic import Field
from scipy.interpolate import RectBivariateSpline

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.settings import SensorModel

STEPS = 4
"""Of a fixed-point iteration: each reduces the error to less than a hundredth, for waves below a pixel."""
PERIODS = 2.0
"""Waves across the width of the sensor."""


class WavyCamera(Camera):
    """A camera whose pixel p sees what the model's pixel p - w(p) sees.

    With a = 2 pi `PERIODS` p / width and A twice the RMS, w = A (sin a_x cos a_y, cos a_x sin a_y).

    Attributes
    ----------
    waves_px
        RMS of w along an axis.
    """

    waves_px: float = Field(ge=0)

    @cached_property
    def model(self) -> Camera:
        """The same camera without waves."""
        return Camera.model_validate(self.model_dump(exclude={"waves_px"}))

    def waves(self, pixels: FloatArray) -> FloatArray:
        """The waves w (..., 2) at pixels (..., 2), px."""
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


def as_it_is(camera: Camera, sensor: SensorModel) -> Camera:
    """The camera with the lens of a sensor model, which is that of its model unless it has waves."""
    if sensor.lens_waves_px == 0.0:
        return camera
    return WavyCamera(**camera.model_dump(), waves_px=sensor.lens_waves_px)


GRID_PX = 8.0  # spacing of exact undistortion; a quintic spline between the nodes is good to 1e-7 px


def undistorted_pixels(camera: Camera, u: FloatArray, v: FloatArray) -> FloatArray:
    """Normalized coordinates (n_v, n_u, 2) of the pixels with columns u and rows v, both increasing."""
    # Nodes up to the edge of the sensor, beyond which the lens model may have no rays.
    nodes = [
        np.linspace(-0.5, length - 0.5, int(length / GRID_PX) + 2) for length in (camera.height_px, camera.width_px)
    ]
    exact = camera.normalized_from_pixels(np.stack(np.meshgrid(nodes[1], nodes[0]), axis=-1))
    splines = [RectBivariateSpline(*nodes, exact[..., axis], kx=5, ky=5) for axis in range(2)]
    return np.stack([spline(v, u) for spline in splines], axis=-1)
