"""Which videos the frames of a set can make."""

from __future__ import annotations

import pytest

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.set_video import check_video
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorModel

EVEN = Camera.c920()
ODD = EVEN.replaced(width_px=1919)


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
    with pytest.raises(InputError) as error:
        check_video(settings, camera, rate_hz)
    assert str(error.value).startswith(complaint)


def test_others_pass() -> None:
    check_video(RenderSettings(), ODD, None)
    check_video(RenderSettings(video="avi"), ODD, 30.0)
    check_video(RenderSettings(video="mp4"), EVEN, 30.0)
