"""What is reported of a recording: which frames were lost, why, and whether the file was cut off."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from mirrorcam.core.video.live_camera import CameraPicture, Connection, LiveCamera
from mirrorcam.core.video.stream_losses import losses, spans


@pytest.mark.parametrize(
    ("numbers", "text"), [([], ""), ([3], "3"), ([3, 4, 5, 9, 11, 12], "3 to 5, 9, 11 to 12"), ([0, 1], "0 to 1")]
)
def test_runs_of_numbers_are_joined(numbers: list[int], text: str) -> None:
    assert spans(numbers) == text


def test_losses_are_grouped_by_reason() -> None:
    lost = {5: "is damaged", 7: "depends on a damaged one", 6: "depends on a damaged one"}
    video: Any = SimpleNamespace()
    assert losses(video, 5, lost, 8) == [
        "skipped 1 of 8 frames, each is damaged: 5",
        "skipped 2 of 8 frames, each depends on a damaged one: 6 to 7",
    ]
    assert losses(video, 5, lost, 10)[-1] == "ends after 8 of 10 frames; the file is cut off"
    assert losses(video, 5, lost, None) == losses(video, 5, lost, 8)


def test_frames_that_a_camera_gave_too_fast_are_counted() -> None:
    nothing: list[CameraPicture] = []
    camera = LiveCamera("camera 0", lambda: Connection(seen for seen in nothing), 4, 3)
    assert losses(camera, 5, {}, 10) == []
    camera.dropped, camera.outages = 3, 1
    assert losses(camera, 5, {}, None) == [
        "left out 3 of 8 frames, which came too fast to decode",
        "the camera disconnected 1 time",
    ]
