"""How a set is rendered, as numbers: renderer, light and sensor. Light to import: the command shows the options."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from mirrorcam.optics.base.values import Value


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
    h264_crf: int | None = Field(
        default=None, ge=0, le=51, description="what H.264 loses of PNG files or of the video, as x264 counts it"
    )
    readout_ms: float = Field(
        default=0.0, ge=0, description="from the first row's exposure to the last one's: a rolling shutter"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.jpeg_quality is not None and self.h264_crf is not None:
            raise ValueError("jpeg_quality and h264_crf: expected one of the two")
        return self


RendererName = Literal["mitsuba", "fast"]
SensorName = Literal["ideal", "c920", "poor"]
VideoName = Literal["mp4", "avi"]

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


Bend = Literal["sphere", "cylinder"]


class SurfaceFinish(Value):
    """How the mirrors of a device stray from even, smooth and flat ones; each is drawn from the seed of its set."""

    tint: tuple[float, float, float] = Field(
        default=(1.0, 1.0, 1.0), description="red, green and blue of what a mirror leaves, over its reflectance"
    )
    reflectance_percent: float = Field(default=0.0, ge=0, description="sigma of a mirror's reflectance")
    roughness: float = Field(default=0.0, ge=0, lt=1, description="alpha of Beckmann's distribution of slopes")
    bend: Bend = Field(default="sphere", description="which way a mirror sags: all ways or one")
    sag_mm: float = Field(default=0.0, ge=0, description="sigma of how far the middle lies behind the rim")
    ripple_mm: float = Field(default=0.0, ge=0, description="amplitude of waves")
    ripple_wavelength_mm: float = Field(default=20.0, gt=0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if min(self.tint) < 0:
            raise ValueError(f"tint {self.tint}: expected numbers from 0 on")
        return self


class RenderSettings(Value):
    """How a set is rendered, beyond its layout, board and poses."""

    renderer: RendererName = Field(
        default="mitsuba", description="mitsuba: the reference, by light paths; fast: by formula, for large sets"
    )
    spp: int = Field(default=16, ge=1, le=65536, description="samples in a pixel, of the reference")
    paper: float = Field(default=0.85, gt=0, description="radiance of the board's paper")
    ink: float = Field(default=0.05, ge=0, description="radiance of its print")
    mirror_reflectance: float = Field(default=0.92, gt=0, le=1)
    finish: SurfaceFinish = SurfaceFinish()
    surroundings: float = Field(
        default=0.25, ge=0, description="radiance of all around, where a device's parts stand in the scene; else none"
    )
    sensor: SensorModel = SENSORS["c920"]
    maps: bool = Field(default=True, description="write what every pixel truly shows, beside the truth")
    video: VideoName | None = Field(
        default=None, description="the frames as a video, too: mp4, of H.264; or avi, of the JPEG files as they are"
    )
    video_crf: int = Field(
        default=18, ge=0, le=51, description="what H.264 loses in an mp4 of frames that came as JPEG or PNG"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        rough = [name for name in ("roughness", "sag_mm", "ripple_mm") if getattr(self.finish, name) > 0]
        if self.renderer == "fast" and rough:
            raise ValueError(f"renderer fast: mirrors are smooth and flat, expected {rough[0]} 0 or renderer mitsuba")
        return self

    @property
    def subpixels(self) -> int:
        """How many squares a pixel is cut into, along each side, before the lens blurs: two where `spp` allows it."""
        return 2 if self.renderer == "fast" or self.spp % 4 == 0 else 1

    @property
    def suffix(self) -> str:
        """Of the pictures."""
        return ".png" if self.sensor.jpeg_quality is None else ".jpg"
