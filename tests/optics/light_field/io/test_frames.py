"""Frames of videos and cameras: all of them, in order, in their colours; and nothing that was not filmed."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.frames import AHEAD, PATIENCE, CaptureDevice, Frame, Lost, Video, read_ahead
from tests.optics.light_field.io.videos import RATE, cut, damage, number_in, pictures, write_h264, write_mjpeg


def split(items: list[Frame | Lost]) -> tuple[list[Frame], list[Lost]]:
    return [item for item in items if isinstance(item, Frame)], [item for item in items if isinstance(item, Lost)]


def write(path: Path, count: int) -> Path:
    return write_mjpeg(path, pictures(count)) if path.suffix == ".avi" else write_h264(path, pictures(count))


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.ts", "a.avi", "a.h264"])
def test_every_frame_comes_once_in_order(tmp_path: Path, name: str) -> None:
    video = Video(write(tmp_path / name, 23))
    assert (video.width_px, video.height_px) == (160, 96)
    frames, lost = split(list(video.frames()))
    assert lost == []
    assert [frame.number for frame in frames] == list(range(23))
    assert [number_in(frame.pixels) for frame in frames] == list(range(23))
    if name != "a.h264":  # which has no times
        assert [frame.time_s for frame in frames] == pytest.approx([number / RATE for number in range(23)], abs=2e-3)
    if name in ("a.mp4", "a.avi"):
        assert video.count == 23
        assert video.rate_hz == RATE


def test_frames_that_lean_on_later_ones_come_in_order_of_time(tmp_path: Path) -> None:
    frames, lost = split(list(Video(write_h264(tmp_path / "b.mp4", pictures(23), b_frames=2)).frames()))
    assert lost == []
    assert [frame.number for frame in frames] == list(range(23))
    assert [number_in(frame.pixels) for frame in frames] == list(range(23))


@pytest.mark.parametrize("after", [0, 9, 21, 22, 40])
def test_reading_goes_on_after_a_frame(tmp_path: Path, after: int) -> None:
    video = Video(write_h264(tmp_path / "a.mp4", pictures(23)))
    every, _ = split(list(video.frames()))
    rest, _ = split(list(video.frames(after=after)))
    assert [frame.number for frame in rest] == list(range(after + 1, 23))
    for frame in rest:
        assert np.array_equal(frame.pixels, every[frame.number].pixels)
        assert frame.time_s == every[frame.number].time_s


@pytest.mark.parametrize(("pixels", "full"), [("yuv420p", False), ("yuv420p", True), ("yuvj420p", True)])
def test_colours_are_those_that_were_filmed(tmp_path: Path, pixels: str, full: bool) -> None:
    colours = [(200, 40, 90), (245, 245, 245), (16, 128, 200), (8, 8, 8)]
    with av.open(str(tmp_path / "c.mkv"), "w") as container:
        stream: Any = container.add_stream("libx264", rate=RATE, options={"crf": "0"})
        stream.height, stream.width, stream.pix_fmt = 64, 64, pixels
        stream.codec_context.color_range = 2 if full else 1
        for colour in colours:
            picture = av.VideoFrame.from_ndarray(np.full((64, 64, 3), colour, np.uint8), format="rgb24")
            container.mux(stream.encode(picture.reformat(format=pixels, dst_color_range=2 if full else 1)))
        container.mux(stream.encode(None))
    frames, _ = split(list(Video(tmp_path / "c.mkv").frames()))
    for frame, colour in zip(frames, colours, strict=True):
        assert np.abs(frame.pixels.astype(int) - colour).max() <= 3


def test_a_damaged_picture_of_a_webcam_is_lost_alone(tmp_path: Path) -> None:
    path = write_mjpeg(tmp_path / "a.avi", pictures(20))
    whole, _ = split(list(Video(path).frames()))
    damage(path, 7)
    frames, lost = split(list(Video(path).frames()))
    assert lost == [Lost(7, "is damaged")]
    assert [frame.number for frame in frames] == [*range(7), *range(8, 20)]
    assert all(np.array_equal(frame.pixels, whole[frame.number].pixels) for frame in frames)
    assert split(list(Video(path).frames(after=7)))[1] == []


def test_what_leans_on_a_damaged_frame_is_lost_up_to_the_next_key_frame(tmp_path: Path) -> None:
    path = write_h264(tmp_path / "a.mp4", pictures(40), key_every=10)
    whole, _ = split(list(Video(path).frames()))
    damage(path, 13)
    frames, lost = split(list(Video(path).frames()))
    assert [each.number for each in lost] == list(range(13, 20))
    assert lost[0].reason == "is damaged"
    assert lost[-1].reason == "leans on a damaged one"
    assert [frame.number for frame in frames] == [*range(13), *range(20, 40)]
    assert all(np.array_equal(frame.pixels, whole[frame.number].pixels) for frame in frames)


def test_a_damaged_key_frame_takes_its_followers_along(tmp_path: Path) -> None:
    path = write_h264(tmp_path / "a.mp4", pictures(40), key_every=10)
    whole, _ = split(list(Video(path).frames()))
    damage(path, 20)
    frames, lost = split(list(Video(path).frames()))
    assert [each.number for each in lost] == list(range(20, 30))
    assert all(np.array_equal(frame.pixels, whole[frame.number].pixels) for frame in frames)


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.avi", "a.ts"])
def test_a_file_that_breaks_off_gives_the_frames_before(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / name, 40)
    whole, _ = split(list(Video(path).frames()))
    cut(path, 0.6)
    video = Video(path)
    frames, lost = split(list(video.frames()))
    assert 10 < len(frames) < 35
    assert [frame.number for frame in frames] == list(range(len(frames)))
    assert all(np.array_equal(frame.pixels, whole[frame.number].pixels) for frame in frames)
    # At most the frame at the break, and what MP4's index in front still promises is not reported frame by frame.
    assert len(lost) <= 1
    if name == "a.mp4":
        assert video.count == 40


def test_what_is_no_video_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "empty.mp4").write_bytes(b"")
    (tmp_path / "words.mp4").write_text("not a video\n" * 100, encoding="utf-8")
    with av.open(str(tmp_path / "sound.wav"), "w") as container:
        stream: Any = container.add_stream("pcm_s16le", rate=8000)
        stream.layout = "mono"
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        sound.sample_rate = 8000
        container.mux(stream.encode(sound))
    for name, reason in {
        "nowhere.mp4": "no such file",
        "": "is a folder, expected a video",
        "empty.mp4": "not a video that can be opened, or cut off before its index",
        "words.mp4": "not a video that can be opened",
        "sound.wav": "has no pictures, expected a video",
    }.items():
        with pytest.raises(InputError, match=reason) as caught:
            list(Video(tmp_path / name).frames())
        assert str(caught.value).startswith(str(tmp_path / name))
        assert "\n" not in str(caught.value)


def test_names_that_are_no_text_do_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        container.metadata["title"] = "the title"
        stream: Any = container.add_stream("mjpeg", rate=RATE)
        stream.height, stream.width, stream.pix_fmt = 96, 160, "yuvj420p"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(pictures(1)[0], format="rgb24")))
        container.mux(stream.encode(None))
    path.write_bytes(path.read_bytes().replace(b"the title", b"\xff\xfe title"))
    assert len(list(Video(path).frames())) == 1


def test_a_video_without_its_index_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=RATE)
        stream.height, stream.width, stream.pix_fmt = 96, 160, "yuv420p"
        for picture in pictures(20):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode(None))
    cut(path, 0.7)
    with pytest.raises(InputError, match=r"a.mp4: not a video that can be opened, or cut off before its index: "):
        Video(path)


def test_reading_ahead_is_bounded_and_keeps_the_order() -> None:
    made: list[int] = []

    def numbers() -> Iterator[int]:
        for number in range(30):
            made.append(number)
            yield number

    ahead = read_ahead(numbers())
    assert next(ahead) == 0
    deadline = time.monotonic() + 5
    while len(made) < AHEAD + 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.1)
    assert len(made) == AHEAD + 2  # one given, AHEAD in the queue, one in the thread's hand
    assert list(ahead) == list(range(1, 30))


def test_an_error_while_reading_ahead_arrives_after_what_was_read() -> None:
    def numbers() -> Iterator[int]:
        yield 1
        raise InputError("the camera burns")

    ahead = read_ahead(numbers())
    assert next(ahead) == 1
    with pytest.raises(InputError, match="the camera burns"):
        next(ahead)


def test_who_stops_listening_ends_the_thread_and_closes_the_source() -> None:
    closed: list[bool] = []

    def numbers() -> Iterator[int]:
        try:
            yield from range(1000)
        finally:
            closed.append(True)

    ahead = read_ahead(numbers())
    next(ahead)
    ahead.close()
    assert closed == [True]
    assert not [thread for thread in threading.enumerate() if thread.name == "read ahead"]


class Camera:
    """What cv2.VideoCapture is to `CaptureDevice`: pictures in BGR, None for one that it fails to give."""

    def __init__(self, given: list[NDArray[np.uint8] | None], opened: bool = True) -> None:
        self.given, self.opened, self.released = iter(given), opened, False
        self.asked: dict[int, float] = {}

    def __call__(self, number: int) -> Camera:
        return self

    def isOpened(self) -> bool:  # noqa: N802  # OpenCV's name
        return self.opened

    def set(self, what: int, value: float) -> bool:
        self.asked[what] = value
        return True

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        picture = next(self.given, None)
        return picture is not None, picture

    def release(self) -> None:
        self.released = True


def test_a_camera_gives_frames_until_nobody_asks(tmp_path: Path) -> None:
    shown = pictures(3)
    camera = Camera([shown[0][..., ::-1], None, shown[1][..., ::-1], shown[2][..., ::-1]])
    clock = iter(np.arange(100) / 30)
    frames = CaptureDevice(0, 160, 96, capture=camera, clock=lambda: float(next(clock))).frames()
    found = [next(frames) for _ in range(4)]
    assert found[1] == Lost(1, "was not given by the camera")
    for item, number, picture in zip([found[0], found[2], found[3]], [0, 2, 3], shown, strict=True):
        assert isinstance(item, Frame)
        assert item.number == number
        assert item.time_s == pytest.approx((number + 1) / 30)
        assert np.array_equal(item.pixels, picture)
    assert (camera.asked[cv2.CAP_PROP_FRAME_WIDTH], camera.asked[cv2.CAP_PROP_FRAME_HEIGHT]) == (160, 96)
    frames.close()
    assert camera.released


def test_a_camera_that_cannot_be_used_is_refused() -> None:
    with pytest.raises(InputError, match=r"^camera 3 cannot be opened, expected one on this machine \(/dev/video3\)$"):
        CaptureDevice(3, 160, 96, capture=Camera([], opened=False))
    small = Camera([np.zeros((48, 80, 3), np.uint8)])
    with pytest.raises(InputError, match=r"^camera 0 gives 80x48 px, expected 160x96 of the layout's camera$"):
        list(CaptureDevice(0, 160, 96, capture=small).frames())
    assert small.released
    gone = Camera([np.zeros((96, 160, 3), np.uint8)])
    found: list[Frame | Lost] = []
    with pytest.raises(InputError, match=rf"^camera 0 gave no picture {PATIENCE} times in a row"):
        for item in CaptureDevice(0, 160, 96, capture=gone).frames():
            found.append(item)  # noqa: PERF402  # what came before the error
    assert [type(item) for item in found] == [Frame, *[Lost] * PATIENCE]


def test_frames_that_change_their_size_are_lost(tmp_path: Path) -> None:
    path = tmp_path / "a.avi"
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("mjpeg", rate=RATE)
        stream.height, stream.width, stream.pix_fmt = 96, 160, "yuvj420p"
        for number, (width, height) in enumerate([(160, 96), (80, 48), (160, 96)]):
            _, encoded = cv2.imencode(".jpg", np.zeros((height, width, 3), np.uint8))
            packet: Any = av.Packet(encoded.tobytes())
            packet.stream, packet.time_base = stream, Fraction(1, RATE)
            packet.pts = packet.dts = number
            container.mux(packet)
    frames, lost = split(list(Video(path).frames()))
    assert lost == [Lost(1, "is 80x48 px, others 160x96")]
    assert [frame.number for frame in frames] == [0, 2]
