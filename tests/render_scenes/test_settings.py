"""Settings of sets: presets, and refused combinations."""

from __future__ import annotations

import pytest

from mirrorcam.core.values import InvalidValue
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorModel, SurfaceFinish


def test_subpixels_divide_the_samples() -> None:
    assert RenderSettings(spp=16).subpixels == 2
    assert RenderSettings(spp=6).subpixels == 1
    assert RenderSettings(spp=6, renderer="fast").subpixels == 2


def test_pictures_are_jpeg_where_the_sensor_compresses_them_so() -> None:
    assert {name: RenderSettings(sensor=sensor).suffix for name, sensor in SENSORS.items()} == {
        "ideal": ".png",
        "c920": ".jpg",
        "poor": ".jpg",
        "webcam": ".jpg",
    }
    assert RenderSettings(sensor=SensorModel(h264_crf=20)).suffix == ".png"


def test_a_picture_is_compressed_once() -> None:
    with pytest.raises(InvalidValue, match="jpeg_quality and h264_crf: expected at most one of the two"):
        SensorModel(jpeg_quality=90, h264_crf=20)


def test_a_webcam_is_a_c920_that_processes_its_pictures() -> None:
    webcam, c920 = SENSORS["webcam"].model_dump(), SENSORS["c920"].model_dump()
    assert {name for name, value in webcam.items() if value != c920[name]} == {
        "pupil_walk_mm",
        "lens_waves_px",
        "lateral_chromatic_percent",
        "axial_chromatic_px",
        "veiling_glare",
        "prnu_percent",
        "bayer",
        "denoising_grey",
        "tone_curve",
        "sharpening",
        "jpeg_quality",
    }


@pytest.mark.parametrize("name", ["veiling_glare", "prnu_percent", "sharpening", "denoising_grey"])
def test_a_flaw_of_a_sensor_is_not_negative(name: str) -> None:
    with pytest.raises(InvalidValue, match=name):
        SensorModel.model_validate({name: -0.1})


def test_a_tint_is_not_negative() -> None:
    with pytest.raises(InvalidValue, match="greater than or equal to 0"):
        SurfaceFinish(tint=(1.0, 1.0, -0.1))


@pytest.mark.parametrize(
    "finish", [SurfaceFinish(roughness=0.001), SurfaceFinish(sag_mm=0.01), SurfaceFinish(ripple_mm=0.001)]
)
def test_the_analytic_renderer_refuses_what_it_cannot_show(finish: SurfaceFinish) -> None:
    with pytest.raises(InvalidValue, match=r"renderer fast: mirrors are smooth and flat, expected .* 0"):
        RenderSettings(renderer="fast", finish=finish)
