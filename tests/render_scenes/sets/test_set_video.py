"""Which videos the frames of a set can make."""

from __future__ import annotations

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.set_video import check_video
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorModel

EVEN = Camera.c920()
ODD = EVEN.replaced(width_px=1919)


def refused(settings: RenderSettings, camera: Camera, rate_hz: float | None) -> str:
    """The complaint about a video, empty where there is none."""
    try:
        check_video(settings, camera, rate_hz)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("settings", "camera", "rate_hz", "complaint"),
    [
        (RenderSettings(video="mp4"), EVEN, None, "video mp4: its frames are moments of a motion, expected a rate_hz"),
        (RenderSettings(video="avi", sensor=SENSORS["ideal"]), EVEN, 30.0, "video avi: holds the JPEG files"),
        (RenderSettings(video="mp4"), ODD, 30.0, "H.264: a sensor of 1919 x 1080 pixels, expected even numbers"),
        (RenderSettings(sensor=SensorModel(h264_crf=20)), ODD, None, "H.264: a sensor of 1919 x 1080 pixels"),
    ],
)
def test_videos_that_cannot_be_encoded_are_refused(
    settings: RenderSettings, camera: Camera, rate_hz: float | None, complaint: str
) -> None:
    assert refused(settings, camera, rate_hz).startswith(complaint)


@pytest.mark.parametrize(
    ("settings", "camera", "rate_hz"),
    [
        (RenderSettings(), ODD, None),
        (RenderSettings(video="avi"), ODD, 30.0),
        (RenderSettings(video="mp4"), EVEN, 30.0),
    ],
)
def test_others_are_not_refused(settings: RenderSettings, camera: Camera, rate_hz: float | None) -> None:
    assert refused(settings, camera, rate_hz) == ""
