"""Settings of a rendered set: renderer, light, surface finish and sensor. Imports no renderer, for the command line."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from mirrorcam.optics.base.values import Value


class SensorModel(Value):
    """Model of lens and sensor with a linear response of 8 bits: radiance 1 / `exposure` is grey level 255."""

    lens_blur_px: float = Field(default=0.8, ge=0, description="sigma of the lens's Gaussian blur where it is in focus")
    focus_mm: float = Field(default=500.0, gt=0, description="length of the light path at which the lens is in focus")
    aperture_mm: float = Field(default=0.0, ge=0, description="diameter of the pupil; 0: everything is in focus")
    vignetting: float = Field(
        default=0.0,
        ge=0,
        description="exponent of cos in the fall-off of light away from the axis; 4 is natural vignetting",
    )
    exposure: float = Field(default=1.0, gt=0, description="grey level 255 per radiance")
    full_well_electrons: float = Field(
        default=0.0, ge=0, description="electrons at grey level 255, which set the shot noise; 0: no shot noise"
    )
    read_noise_grey: float = Field(default=1.0, ge=0, description="sigma of the other noise, in grey levels")
    jpeg_quality: int | None = Field(default=None, ge=1, le=100, description="quality of JPEG files, without it PNG")
    h264_crf: int | None = Field(
        default=None, ge=0, le=51, description="constant rate factor of x264 for PNG files or the video"
    )
    readout_ms: float = Field(
        default=0.0, ge=0, description="time from the exposure of the first row to that of the last: a rolling shutter"
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
    # No defect but 8-bit quantisation. Sharp corners alias, so that the lens blur is kept.
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
    # A cheap webcam in dim light.
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
    """Surface finish of the mirrors of a device; the finish of each mirror is drawn from the seed of its set."""

    tint: tuple[float, float, float] = Field(
        default=(1.0, 1.0, 1.0), description="factors of the reflectance in red, green and blue"
    )
    reflectance_percent: float = Field(default=0.0, ge=0, description="sigma of the reflectance between mirrors")
    roughness: float = Field(default=0.0, ge=0, lt=1, description="alpha of the Beckmann microfacet distribution")
    bend: Bend = Field(default="sphere", description="shape of the sag: along both axes or along one")
    sag_mm: float = Field(default=0.0, ge=0, description="sigma of the sag: depth of the middle below the rim")
    ripple_mm: float = Field(default=0.0, ge=0, description="amplitude of the surface waviness")
    ripple_wavelength_mm: float = Field(default=20.0, gt=0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if min(self.tint) < 0:
            raise ValueError(f"tint {self.tint}: expected numbers from 0 on")
        return self


class RenderSettings(Value):
    """Settings of rendering a set, beyond its layout, board and poses.

    Radiance is linear and without unit; a sensor of `exposure` 1 maps radiance 1 to grey level 255.
    """

    renderer: RendererName = Field(
        default="mitsuba", description="mitsuba: the reference, by path tracing; fast: analytic, for large sets"
    )
    spp: int = Field(default=16, ge=1, le=65536, description="samples per pixel of the reference renderer")
    paper: float = Field(default=0.85, gt=0, description="radiance of the board's paper")
    ink: float = Field(default=0.05, ge=0, description="radiance of the board's ink")
    mirror_reflectance: float = Field(default=0.92, gt=0, le=1)
    finish: SurfaceFinish = SurfaceFinish()
    surroundings: float = Field(
        default=0.25,
        ge=0,
        description="radiance of the surroundings where the parts of a device are in the scene; otherwise unused",
    )
    sensor: SensorModel = SENSORS["c920"]
    maps: bool = Field(default=True, description="write ground-truth maps of every pixel")
    video: VideoName | None = Field(
        default=None,
        description="also write the frames as a video: mp4, of H.264; or avi, of the JPEG files as they are",
    )
    video_crf: int = Field(
        default=18, ge=0, le=51, description="constant rate factor of an mp4 of frames that came as JPEG or PNG"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        rough = [name for name in ("roughness", "sag_mm", "ripple_mm") if getattr(self.finish, name) > 0]
        if self.renderer == "fast" and rough:
            raise ValueError(f"renderer fast: mirrors are smooth and flat, expected {rough[0]} 0 or renderer mitsuba")
        return self

    @property
    def subpixels(self) -> int:
        """Number of subpixels along each side of a pixel, on which the lens blur acts: two where `spp` allows it."""
        return 2 if self.renderer == "fast" or self.spp % 4 == 0 else 1

    @property
    def suffix(self) -> str:
        """File name suffix of the pictures."""
        return ".png" if self.sensor.jpeg_quality is None else ".jpg"
