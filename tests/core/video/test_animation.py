"""Loops of pictures as files."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.video.animation import require_x264, write_loop
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import Video
from mirrorcam.render_scenes.sets.video import as_key_frame, write_h264
from tests.core.disk.test_files import refusal

GREY = np.zeros((16, 16), np.uint8)


def pictures(height: int = 40, width: int = 64) -> list[NDArray[np.uint8]]:
    """A bright square that moves right on blue."""
    every = []
    for step in range(5):
        picture = np.full((height, width, 3), (20, 40, 160), np.uint8)
        picture[10:25, 5 + 8 * step : 20 + 8 * step] = (240, 220, 40)
        every.append(picture)
    return every


def test_a_gif_holds_all_pictures_and_repeats(tmp_path: Path) -> None:
    write_loop(tmp_path / "a.gif", pictures(), 20.0)
    read, animation = cv2.imreadanimation(str(tmp_path / "a.gif"))
    assert read
    assert len(animation.frames) == 5
    assert animation.loop_count == 0
    assert list(animation.durations) == [50] * 5
    for shown, wanted in zip(animation.frames, pictures(), strict=True):
        assert np.abs(np.asarray(shown)[..., 2::-1].astype(int) - wanted).mean() < 8.0


def test_an_mp4_holds_all_pictures(tmp_path: Path) -> None:
    write_loop(tmp_path / "a.mp4", pictures(41, 65), 12.0)
    frames = [item for item in Video(tmp_path / "a.mp4").frames() if isinstance(item, Frame)]
    assert len(frames) == 5
    assert frames[0].pixels.shape == (40, 64, 3)
    assert frames[4].time_s == pytest.approx(4 / 12.0, abs=1e-3)
    for frame, wanted in zip(frames, pictures(41, 65), strict=True):
        assert np.abs(frame.pixels.astype(int) - wanted[:40, :64]).mean() < 8.0


@pytest.mark.parametrize("name", ["a.gif", "a.mp4"])
def test_the_same_pictures_give_the_same_bytes(tmp_path: Path, name: str) -> None:
    write_loop(tmp_path / name, pictures(), 20.0)
    write_loop(tmp_path / "again" / name, pictures(), 20.0)
    assert (tmp_path / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected \.gif or \.mp4"):
        write_loop(tmp_path / "a.avi", pictures(), 20.0)
    assert list(tmp_path.iterdir()) == []


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
