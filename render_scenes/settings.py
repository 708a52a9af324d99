"""Settings of a rendered set: renderer, light, surface finish and sensor. Imports no renderer, for the command line."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mirrorcam.core.bounds import APERTURE_MM, DEPTH_MM, LENGTH_MM, SAMPLES_PER_PIXEL, TOLERANCE_MM, Bounds
from mirrorcam.core.values import Value
from mirrorcam.optics.geometry.pupil import Pupil

ToneCurve = Literal["linear", "srgb"]
PUPIL_WALK_MM = Bounds(-10.0, 10.0)


class SensorModel(Value):
    """Model of lens, sensor and 8-bit processing: radiance 1 / `exposure` is grey level 255.

    All fields but `exposure` are zero or off in an ideal camera. If the lens or the sensor separates colours, pictures
    of grey scenes are in colour, too.
    """

    lens_blur_px: float = Bounds(0.0, 100.0).field(0.8, "sigma of the lens's Gaussian blur in focus")
    focus_mm: float = DEPTH_MM.field(500.0, "focus distance along the axis, via the mirrors")
    aperture_mm: float = APERTURE_MM.field(0.0, "diameter of the pupil; 0: a pinhole, in focus everywhere")
    pupil_walk_mm: float = PUPIL_WALK_MM.field(
        0.0, "shift of the pupil towards the scene for light at 45 degrees to the axis; it grows as the tangent squared"
    )
    lens_waves_px: float = Bounds(0.0, 10.0).field(
        0.0, "RMS deviation of the lens from its model along each axis, in waves of half the sensor's width"
    )
    lateral_chromatic_percent: float = Bounds(-5.0, 5.0).field(
        0.0, "excess magnification of red over green, and of green over blue"
    )
    axial_chromatic_px: float = Bounds(0.0, 100.0).field(
        0.0, "sigma of the additional blur of red and blue where green is in focus"
    )
    vignetting: float = Bounds(0.0, 100.0).field(
        0.0,
        "exponent of the cosine in the fall-off of light away from the axis; 4 is natural vignetting",
    )
    veiling_glare: float = Bounds(0.0, 1.0).field(
        0.0, "fraction of the picture's mean light that is spread evenly over it"
    )
    prnu_percent: float = Bounds(0.0, 100.0).field(
        0.0, "sigma of the pixels' sensitivity, a pattern that all pictures share"
    )
    exposure: float = Bounds(1e-6, 1e6).field(1.0, "grey level 255 per radiance")
    full_well_electrons: float = Bounds(0.0, 1e9).field(
        0.0, "electrons at grey level 255, which set the shot noise; 0: no shot noise"
    )
    read_noise_grey: float = Bounds(0.0, 255.0).field(1.0, "sigma of the signal-independent noise, in grey levels")
    bayer: bool = Field(default=False, description="one colour per pixel (RGGB), demosaiced along edges")
    denoising_grey: float = Bounds(0.0, 255.0).field(0.0, "range sigma of the bilateral filter, in grey levels")
    tone_curve: ToneCurve = Field(default="linear", description="response of the picture to light: linear or srgb")
    sharpening: float = Bounds(0.0, 10.0).field(0.0, "amount of unsharp masking")
    jpeg_quality: int | None = Bounds(1, 100).field(None, "quality of JPEG files; none: PNG")
    h264_crf: int | None = Bounds(0, 51).field(None, "constant rate factor of x264 for PNG files or the video")
    readout_ms: float = Bounds(0.0, 10_000.0).field(
        0.0, "time from the exposure of the first row to that of the last: a rolling shutter"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.jpeg_quality is not None and self.h264_crf is not None:
            raise ValueError("jpeg_quality and h264_crf: expected at most one of the two")
        return self

    @property
    def pupil(self) -> Pupil:
        """Pupil of the lens."""
        return Pupil(self.aperture_mm, self.focus_mm, self.pupil_walk_mm)


RendererName = Literal["mitsuba", "fast"]
SensorName = Literal["ideal", "c920", "poor", "webcam"]
VideoName = Literal["mp4", "avi"]

_C920 = SensorModel(
    aperture_mm=1.8,
    vignetting=2.0,
    full_well_electrons=8000.0,
    read_noise_grey=0.8,
    jpeg_quality=95,
    readout_ms=30.0,
)

SENSORS: dict[SensorName, SensorModel] = {
    # No defect but 8-bit quantisation. The lens blur stays, because sharp corners would alias.
    "ideal": SensorModel(read_noise_grey=0.0),
    # A webcam in good light: f/2 at 3.67 mm, a small chip, JPEG compression over USB.
    "c920": _C920,
    # A cheap webcam in dim light.
    "poor": SensorModel(
        lens_blur_px=1.3,
        aperture_mm=2.2,
        focus_mm=900.0,
        vignetting=4.0,
        veiling_glare=0.03,
        prnu_percent=1.0,
        exposure=0.45,
        full_well_electrons=2000.0,
        read_noise_grey=3.0,
        jpeg_quality=70,
        readout_ms=33.0,
    ),
    # c920 with the colour and edge processing of a webcam.
    "webcam": _C920.replaced(
        pupil_walk_mm=0.1,
        lens_waves_px=0.05,
        lateral_chromatic_percent=0.04,
        axial_chromatic_px=0.5,
        veiling_glare=0.01,
        prnu_percent=0.5,
        bayer=True,
        denoising_grey=3.0,
        tone_curve="srgb",
        sharpening=0.5,
        jpeg_quality=85,
    ),
}


Bend = Literal["sphere", "cylinder"]
TINT = Bounds(0.0, 100.0)
Tint = Annotated[float, TINT.limits]
RADIANCE = Bounds(0.0, 1e6)
RATE_HZ = Bounds(0.01, 500.0)
POSES_HZ = Bounds(1e-3, 1e4)


class SurfaceFinish(Value):
    """Distribution of the surface finish of a device's mirrors; each mirror's is drawn with the seed of its set."""

    tint: tuple[Tint, Tint, Tint] = Field(
        default=(1.0, 1.0, 1.0), description=f"factors of the reflectance in red, green and blue, {TINT}"
    )
    reflectance_percent: float = Bounds(0.0, 100.0).field(0.0, "sigma of the reflectance between mirrors")
    roughness: float = Field(default=0.0, ge=0, lt=1, description="alpha of the Beckmann microfacet distribution")
    bend: Bend = Field(default="sphere", description="shape of the sag: curved along both axes or along one")
    sag_mm: float = TOLERANCE_MM.field(0.0, "sigma of the sag: depth of the centre below the rim")
    ripple_mm: float = TOLERANCE_MM.field(0.0, "amplitude of the surface waviness")
    ripple_wavelength_mm: float = LENGTH_MM.field(20.0)


class RenderSettings(Value):
    """Settings of a rendered set, beyond its layout, board and poses.

    Radiance is linear and dimensionless; a sensor with `exposure` 1 maps radiance 1 to grey level 255.
    """

    renderer: RendererName = Field(
        default="mitsuba", description="mitsuba: the reference, by path tracing; fast: analytic, for large sets"
    )
    spp: int = SAMPLES_PER_PIXEL.field(16, "samples per pixel of the reference renderer")
    paper: float = RADIANCE.narrowed(min=1e-6).field(0.85, "radiance of the board's paper")
    ink: float = RADIANCE.field(0.05, "radiance of the board's ink")
    mirror_reflectance: float = Field(default=0.92, gt=0, le=1)
    finish: SurfaceFinish = SurfaceFinish()
    surroundings: float = RADIANCE.field(
        0.25,
        "radiance of the surroundings if the parts of a device are in the scene; otherwise unused",
    )
    sensor: SensorModel = SENSORS["c920"]
    maps: bool = Field(default=True, description="write ground-truth maps with a value for every pixel")
    video: VideoName | None = Field(
        default=None,
        description="also write the frames as a video: mp4 with H.264, or avi with the unchanged JPEG files",
    )
    video_crf: int = Bounds(0, 51).field(18, "constant rate factor of an mp4 encoded from JPEG or PNG frames")

    @model_validator(mode="after")
    def _check(self) -> Self:
        rough = [name for name in ("roughness", "sag_mm", "ripple_mm") if getattr(self.finish, name) > 0]
        if self.renderer == "fast" and rough:
            raise ValueError(f"renderer fast: mirrors are smooth and flat, expected {rough[0]} 0 or renderer mitsuba")
        return self

    @property
    def subpixels(self) -> int:
        """Number of subpixels along each side of a pixel, for the lens blur: two if `spp` allows it."""
        return 2 if self.renderer == "fast" or self.spp % 4 == 0 else 1

    @property
    def suffix(self) -> str:
        """File name suffix of the pictures."""
        return ".png" if self.sensor.jpeg_quality is None else ".jpg"
