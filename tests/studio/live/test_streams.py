"""The streams of a live session: sources that frames come from, and recordings that they go to."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.studio.live.streams import LiveRecording, PictureFolder, open_source
from tests.core.video.videos import pictures, write_h264, write_mjpeg

CAMERA = Camera(width_px=160, height_px=96, fx_px=100.0, fy_px=100.0, cx_px=80.0, cy_px=48.0)


def test_a_video_and_a_folder_are_distinguished(tmp_path: Path) -> None:
    shown = pictures(3)
    video = write_mjpeg(tmp_path / "a.avi", shown)
    (tmp_path / "frames").mkdir()
    for number, picture in enumerate(shown):
        write_image(tmp_path / "frames" / f"{number}.png", picture)
    opened = open_source(str(video), CAMERA)
    assert opened.kind == "video" and opened.name == "a.avi" and opened.ends and isinstance(opened.source, Video)
    opened = open_source(str(tmp_path / "frames"), CAMERA)
    assert opened.kind == "folder" and opened.ends
    read = [item for item in opened.source.frames() if isinstance(item, Frame)]
    assert all(np.array_equal(item.pixels, picture) for item, picture in zip(read, shown, strict=True))
    assert [item.time_s for item in read] == pytest.approx([0.0, 0.2, 0.4])


@pytest.mark.skipif(os.name == "nt", reason="such names are none of a file on Windows")
@pytest.mark.parametrize("name", ["2026-11-26T10:30:05.mkv", "concat:a.mkv", "rtsp:a.mkv", "file:a.mkv"])
def test_a_name_that_looks_like_an_address_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write_mjpeg(tmp_path / "b.mkv", pictures(3)).rename(name)
    opened = open_source(name, CAMERA)
    assert (opened.kind, opened.name) == ("video", name)
    assert len(list(opened.source.frames())) == 3
    Path(name).rename("c.mkv")
    Path(name).mkdir()
    write_image(Path(name) / "0.png", pictures(1)[0])
    assert open_source(name, CAMERA).kind == "folder"


def test_remarks_on_a_video_are_reported(tmp_path: Path) -> None:
    lines: list[str] = []
    open_source(str(write_h264(tmp_path / "a.mp4", pictures(3), matrix=(0, 1, -1, 0))), CAMERA, lines.append)
    assert [line.startswith("a.mp4 is displayed rotated by 90° by players: ") for line in lines] == [True]


def test_a_damaged_picture_is_lost_and_one_of_another_size_refused(tmp_path: Path) -> None:
    write_image(tmp_path / "0.png", pictures(1)[0])
    (tmp_path / "1.png").write_bytes(b"not a picture")
    write_image(tmp_path / "2.png", pictures(1, 80, 48)[0])
    source = PictureFolder(tmp_path, (160, 96)).frames()
    assert isinstance(next(source), Frame) and isinstance(next(source), Lost)
    with pytest.raises(InputError, match="80x48 px, expected 160x96"):
        next(source)


def test_a_folder_that_is_stopped_ends(tmp_path: Path) -> None:
    for number, picture in enumerate(pictures(3)):
        write_image(tmp_path / f"{number}.png", picture)
    folder = PictureFolder(tmp_path, (160, 96))
    found = folder.frames(after=0)
    assert next(found).number == 1
    folder.stop()
    assert list(found) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nowhere.mp4", "no such file"),
        ("98", "camera 98 cannot be opened"),
        ("concat:other.mkv", "no such file"),
        ("x" * 5000, "no such file"),
        ("rtsp://127.0.0.1:1/" + "x" * 300, "cannot be opened: Connection refused"),
    ],
)
def test_what_is_not_there_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        open_source(text, CAMERA)
    assert "\n" not in str(raised.value)


def test_a_video_of_another_size_is_refused(tmp_path: Path) -> None:
    video = write_mjpeg(tmp_path / "a.avi", pictures(2, 80, 48))
    with pytest.raises(InputError, match="80x48 px, expected 160x96 of the layout's camera"):
        open_source(str(video), CAMERA)


SMALL = Camera(name="small", width_px=64, height_px=48, fx_px=60.0, fy_px=60.0, cx_px=31.5, cy_px=23.5)
LONG_S = 30.0


def frame(number: int) -> Frame:
    return Frame(number, 0.02 * number, np.full((48, 64, 3), number % 256, np.uint8))


def test_a_recording_that_follows_another_at_once_is_another_file(tmp_path: Path) -> None:
    lines = list[str]()
    recording = LiveRecording(SMALL, lines.append)
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
    recording = LiveRecording(SMALL, lambda line: None)
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
