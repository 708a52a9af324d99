"""A camera whose lens is off the model that calibrations have of it, by smooth waves."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from pydantic import Field

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
