"""Recordings one after another, as ordered, and what is told of them."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.studio.live.recording import LiveRecording

CAMERA = Camera(name="small", width_px=64, height_px=48, fx_px=60.0, fy_px=60.0, cx_px=31.5, cy_px=23.5)
LONG_S = 30.0


def frame(number: int) -> Frame:
    return Frame(number, 0.02 * number, np.full((48, 64, 3), number % 256, np.uint8))


def test_a_recording_that_follows_another_at_once_is_another_file(tmp_path: Path) -> None:
    lines = list[str]()
    recording = LiveRecording(CAMERA, lines.append)
    recording.give(frame(0))
    recording.order(tmp_path / "a.mkv")
    for number in (1, 2, 3):
        recording.give(frame(number))
    recording.order(tmp_path / "b.mkv")
    recording.give(frame(4))
    recording.give(Lost(5, "is damaged"))
    assert recording.counts.given == 2
    recording.close()
    recording.give(frame(6))
    assert len(list(Video(tmp_path / "a.mkv").frames())) == 3
    assert len(list(Video(tmp_path / "b.mkv").frames())) == 1
    assert sorted(line.removeprefix(f"{tmp_path}/") for line in lines) == [
        "a.mkv written: 3 frames",
        "b.mkv written: 1 frames, 1 of 2 lost: 1 were damaged",
    ]


def test_a_recording_that_cannot_be_written_is_refused_once(tmp_path: Path) -> None:
    (tmp_path / "a.mkv").write_bytes(b"mine")
    recording = LiveRecording(CAMERA, lambda line: None)
    recording.order(tmp_path / "a.mkv")
    recording.give(frame(0))
    end = time.monotonic() + LONG_S
    with pytest.raises(InputError, match=r"a\.mkv.*: 0 frames, 1 of 1 lost"):
        while time.monotonic() < end:
            recording.order(tmp_path / "a.mkv")
            time.sleep(0.01)
    assert recording.counts.given == 0
    recording.order(None)
    recording.close()
