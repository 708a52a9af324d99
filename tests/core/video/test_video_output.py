"""A PyAV without x264 is told in one line where H.264 is to be written."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from mirrorcam.core.video.animation import write_loop
from mirrorcam.core.video.video_output import require_x264
from mirrorcam.render_scenes.sets.video import as_key_frame, write_h264
from tests.core.disk.test_files import refusal

GREY = np.zeros((16, 16), np.uint8)


def test_what_writes_h264_needs_x264_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    require_x264()
    monkeypatch.setattr(av, "codecs_available", {"mjpeg"})
    for refused in (
        refusal(require_x264),
        refusal(as_key_frame, GREY, 23),
        refusal(write_loop, tmp_path / "a.mp4", [np.dstack([GREY] * 3)], 5.0),
        refusal(write_h264, tmp_path / "a.mp4", [], 30.0, 23, lambda done: None),
    ):
        assert refused.startswith("this PyAV (av) is built without x264")
    assert not (tmp_path / "a.mp4").exists()
