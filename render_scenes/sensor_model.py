"""What lens and chip do to light, as numbers; needs no renderer."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from optics.values import Value


class SensorModel(Value):
    """From radiance to an 8-bit picture with a linear response: radiance 1 / `exposure` is grey level 255."""

    lens_blur_px: float = Field(default=0.8, ge=0, description="sigma of the lens's Gaussian blur where it is in focus")
    focus_mm: float = Field(default=500.0, gt=0, description="length of the light's way at which the lens is in focus")
    aperture_mm: float = Field(default=0.0, ge=0, description="diameter of the pupil; 0: all is in focus")
    vignetting: float = Field(
        default=0.0, ge=0, description="exponent of the lens's loss of light away from its axis, over cos; 4 is natural"
    )
    exposure: float = Field(default=1.0, gt=0, description="grey level 255 per radiance")
    full_well_electrons: float = Field(
        default=0.0, ge=0, description="electrons at grey level 255, whose number is uncertain by its root; 0: no noise"
    )
    read_noise_grey: float = Field(default=1.0, ge=0, description="sigma of the other noise, in grey levels")
    jpeg_quality: int | None = Field(default=None, ge=1, le=100, description="quality of JPEG files, without it PNG")
    readout_ms: float = Field(
        default=0.0, ge=0, description="from the first row's exposure to the last one's: a rolling shutter"
    )


SensorName = Literal["ideal", "c920", "poor"]

SENSORS: dict[SensorName, SensorModel] = {
    # No flaw but eight bits. A perfect corner is harder to find than a soft one: a lens blur is no flaw.
    "ideal": SensorModel(read_noise_grey=0.0),
    # A webcam in good light: f/2 of 3.67 mm, a small chip, compressed as it comes over USB.
    "c920": SensorModel(
        aperture_mm=1.8,
        vignetting=2.0,
        full_well_electrons=8000.0,
        read_noise_grey=0.8,
        jpeg_quality=95,
        readout_ms=30.0,
    ),
    # A cheap one in a dim room.
    "poor": SensorModel(
        lens_blur_px=1.3,
        aperture_mm=2.2,
        focus_mm=900.0,
        vignetting=4.0,
        exposure=0.45,
        full_well_electrons=2000.0,
        read_noise_grey=3.0,
        jpeg_quality=70,
        readout_ms=33.0,
    ),
}
