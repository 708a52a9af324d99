"""Frames that were recorded are read again, at their times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.core.video.frame_recorder import FrameRecorder
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import Video
from tests.core.video.videos import number_in, pictures


def test_frames_are_the_same_at_their_times(tmp_path: Path) -> None:
    path, shown = tmp_path / "videos" / "a.mkv", pictures(6)
    recorder = FrameRecorder(path, 160, 96)
    for number, picture in enumerate(shown):
        recorder.add(Frame(number, 10.0 + 0.04 * number, picture))
    assert recorder.frames == 6 and not path.exists()
    recorder.close()
    read = [item for item in Video(path).frames() if isinstance(item, Frame)]
    assert [number_in(item.pixels) for item in read] == list(range(6))
    assert [item.time_s for item in read] == pytest.approx([0.04 * number for number in range(6)], abs=1e-3)
    assert np.abs(read[3].pixels.astype(int) - shown[3]).mean() < 2.0


def test_times_increase_even_where_frames_arrive_together(tmp_path: Path) -> None:
    recorder = FrameRecorder(tmp_path / "a.mkv", 160, 96)
    for number, picture in enumerate(pictures(3)):
        recorder.add(Frame(number, 5.0, picture))
    recorder.close()
    assert len([item for item in Video(tmp_path / "a.mkv").frames() if isinstance(item, Frame)]) == 3


def test_no_file_is_replaced_and_no_other_ending_taken(tmp_path: Path) -> None:
    (tmp_path / "a.mkv").write_bytes(b"mine")
    with pytest.raises(InputError, match="is there already"):
        FrameRecorder(tmp_path / "a.mkv", 160, 96)
    with pytest.raises(InputError, match=r"ends in \.mkv"):
        FrameRecorder(tmp_path / "a.mp4", 160, 96)
    assert (tmp_path / "a.mkv").read_bytes() == b"mine"
