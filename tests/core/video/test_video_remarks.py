"""Videos that are interlaced or turned are remarked on in one line; their frames stay as they lie on the sensor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import Video
from tests.core.video.videos import damage, pictures, write_h264, write_mjpeg

TURNS = {
    "turned by 90°": (0, 1, -1, 0),
    "turned by 180°": (-1, 0, 0, -1),
    "turned by 270°": (0, -1, 1, 0),
    "mirrored": (-1, 0, 0, 1),
    "mirrored ": (1, 0, 0, -1),
}


def remarks(path: Path) -> list[str]:
    lines: list[str] = []
    Video(path, lines.append)
    assert all(len(line) <= 300 and "\n" not in line for line in lines)
    return lines


def frames(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return np.array([item.pixels for item in Video(path).frames() if isinstance(item, Frame)])


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.ts", "a.h264"])
def test_an_interlaced_video_is_remarked_on(tmp_path: Path, name: str) -> None:
    (line,) = remarks(write_h264(tmp_path / name, pictures(5), interlaced=True))
    assert line.startswith(f"{name} is interlaced: ")
    assert "ffmpeg -noautorotate -i VIDEO -vf bwdif=0" in line


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv"])
@pytest.mark.parametrize("turn", TURNS)
def test_a_turned_video_is_remarked_on_and_used_as_it_is(tmp_path: Path, name: str, turn: str) -> None:
    plain = write_h264(tmp_path / "plain.mp4", pictures(3))
    turned = write_h264(tmp_path / name, pictures(3), matrix=TURNS[turn])
    (line,) = remarks(turned)
    assert line.startswith(f"{name} is to be shown {turn.strip()}: ")
    assert "-noautorotate" in line
    np.testing.assert_array_equal(frames(turned), frames(plain))


def test_other_videos_are_not_remarked_on(tmp_path: Path) -> None:
    assert remarks(write_h264(tmp_path / "a.mp4", pictures(5), b_frames=2)) == []
    assert remarks(write_h264(tmp_path / "b.mp4", pictures(5), matrix=(1, 0, 0, 1))) == []
    assert remarks(write_mjpeg(tmp_path / "a.avi", pictures(5))) == []


def test_a_video_that_is_both_has_two_remarks_also_where_its_first_frame_is_damaged(tmp_path: Path) -> None:
    path = write_h264(tmp_path / "a.mp4", pictures(25), interlaced=True, matrix=(0, 1, -1, 0))
    assert len(remarks(path)) == 2
    damage(path, 0)
    assert len(remarks(path)) == 2
