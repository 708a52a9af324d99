"""Frames of videos: all of them, in order, in their colours; and nothing that was not filmed."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.video import Video, with_missing
from mirrorcam.core.video.video_pictures import Picture
from tests.core.video.videos import (
    RATE,
    cut,
    damage,
    number_in,
    pictures,
    write_h264,
    write_mjpeg,
    write_ramps,
)

TURNS = {
    "rotated by 90°": (0, 1, -1, 0),
    "rotated by 180°": (-1, 0, 0, -1),
    "rotated by 270°": (0, -1, 1, 0),
    "mirrored": (-1, 0, 0, 1),
    "mirrored ": (1, 0, 0, -1),
}


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


def test_what_depends_on_a_damaged_frame_is_lost_up_to_the_next_key_frame(tmp_path: Path) -> None:
    path = write_h264(tmp_path / "a.mp4", pictures(40), key_every=10)
    whole, _ = split(list(Video(path).frames()))
    damage(path, 13)
    frames, lost = split(list(Video(path).frames()))
    assert [each.number for each in lost] == list(range(13, 20))
    assert lost[0].reason == "is damaged"
    assert lost[-1].reason == "depends on a damaged one"
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


def test_files_that_are_not_videos_are_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "empty.mp4").write_bytes(b"")
    (tmp_path / "words.mp4").write_text("not a video\n" * 100, encoding="utf-8")
    with av.open(str(tmp_path / "sound.wav"), "w") as container:
        stream: Any = container.add_stream("pcm_s16le", rate=8000)
        stream.layout = "mono"
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        sound.sample_rate = 8000
        container.mux(stream.encode(sound))
    with av.open(str(tmp_path / "music.mp3"), "w") as container:
        stream = container.add_stream("libmp3lame", rate=8000)
        stream.layout = "mono"
        cover: Any = container.add_stream("mjpeg")
        cover.width, cover.height, cover.pix_fmt, cover.disposition = 160, 96, "yuvj420p", 0x400
        frame = av.VideoFrame.from_ndarray(pictures(1)[0], format="rgb24")
        container.mux([*cover.encode(frame), *cover.encode(None)])
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 8000), np.int16), format="s16p", layout="mono")
        sound.sample_rate = 8000
        container.mux([*stream.encode(sound), *stream.encode(None)])
    for name, reason in {
        "music.mp3": "has no pictures, expected a video",
        "nowhere.mp4": "no such file",
        "": "is a folder, expected a video or pictures by their names",
        "empty.mp4": "not a video that can be opened, or cut off before its index",
        "words.mp4": "not a video that can be opened",
        "sound.wav": "has no pictures, expected a video",
    }.items():
        with pytest.raises(InputError, match=reason) as caught:
            list(Video(tmp_path / name).frames())
        assert str(caught.value).startswith(str(tmp_path / name))
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("stored", "bits"), [("gray16le", 12), ("gray16le", 16), ("rgb48le", 10), ("gray12le", 12)])
def test_frames_of_many_bits_are_scaled_equally_by_the_used_bits(stored: str, bits: int, tmp_path: Path) -> None:
    write_ramps(tmp_path / "a.mkv", stored, bits, (100, 255))
    video = Video(tmp_path / "a.mkv")
    frames, lost = split(list(video.frames()))
    assert lost == []
    assert [int(frame.pixels.max()) for frame in frames] == pytest.approx([100, 255], abs=1)
    is_guessed = "16" in stored or "48" in stored
    assert (video.sample_bits.largest > 0) == is_guessed
    assert not is_guessed or video.sample_bits.used == bits


def test_a_git_lfs_pointer_is_not_a_video(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_text(
        f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 1000000\n"
    )
    with pytest.raises(InputError, match="is a Git LFS pointer"):
        Video(tmp_path / "a.mp4")


def test_names_that_are_no_text_do_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        container.metadata["title"] = "the title"
        stream: Any = container.add_stream("mjpeg", rate=RATE)
        stream.height, stream.width, stream.pix_fmt = 96, 160, "yuvj420p"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(pictures(1)[0], format="rgb24")))
        container.mux(stream.encode(None))
    path.write_bytes(path.read_bytes().replace(b"the title", b"\xff\xfe  title"))
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


def test_jpegs_in_a_video_are_read_as_picture_files(tmp_path: Path) -> None:
    path = write_mjpeg(tmp_path / "a.avi", pictures(3))
    with av.open(str(path)) as container:
        data = [bytes(packet) for packet in container.demux(video=0) if packet.size]
    for frame, raw in zip(Video(path).frames(), data, strict=True):
        assert isinstance(frame, Frame)
        (tmp_path / "a.jpg").write_bytes(raw)
        assert np.array_equal(frame.pixels, read_image(tmp_path / "a.jpg"))


def test_a_jpeg_in_a_video_whose_decoder_only_warns_is_lost(tmp_path: Path) -> None:
    """FFmpeg decodes it to a picture whose lower half is a smear."""
    path = write_mjpeg(tmp_path / "a.avi", pictures(20))
    with av.open(str(path)) as container:
        packet = [packet for packet in container.demux(video=0) if packet.size][7]
        assert packet.pos is not None
        begin, end = packet.pos + packet.size // 2, packet.pos + packet.size - 4
    raw = bytearray(path.read_bytes())
    raw[begin:end] = raw[begin + 90 : end] + raw[begin : begin + 90]
    path.write_bytes(raw)
    assert split(list(Video(path).frames()))[1] == [Lost(7, "is damaged")]


def test_frames_of_which_only_the_index_knows_keep_their_numbers(tmp_path: Path) -> None:
    path = write_mjpeg(tmp_path / "a.avi", pictures(20))
    with av.open(str(path)) as container:
        places = [packet.pos or 0 for packet in container.demux(video=0) if packet.size]
    raw = bytearray(path.read_bytes())
    raw[places[6] - 8 : places[9] - 8] = bytes(places[9] - places[6])
    path.write_bytes(raw)
    frames, lost = split(list(Video(path).frames()))
    assert lost == [Lost(number, "is missing") for number in (6, 7, 8)]
    assert [number_in(frame.pixels) for frame in frames] == [frame.number for frame in frames]
    assert [frame.time_s for frame in frames] == pytest.approx([frame.number / RATE for frame in frames])


@pytest.mark.parametrize("name", ["a.mkv", "a.ts"])
def test_frames_identified_by_time_alone_keep_their_numbers(name: str, tmp_path: Path) -> None:
    path = write_h264(tmp_path / name, pictures(40), key_every=10)
    with av.open(str(path)) as container:
        places = [packet.pos or 0 for packet in container.demux(video=0) if packet.size]
    raw = bytearray(path.read_bytes())
    begin = places[13] // 188 * 188 if name == "a.ts" else places[13] - 8
    raw[begin : places[16]] = b"\xff" * (places[16] - begin)
    path.write_bytes(raw)
    frames, lost = split(list(Video(path).frames()))
    assert [frame.number for frame in frames][-20:] == [*range(20, 40)]
    assert [number_in(frame.pixels) for frame in frames] == [frame.number for frame in frames]
    assert sorted([*(frame.number for frame in frames), *(each.number for each in lost)]) == list(range(40))


def test_uneven_times_are_no_loss(tmp_path: Path) -> None:
    """Also AVI, which counts the times at which no frame was taken."""
    for name, codec in (("a.mkv", "libx264"), ("a.avi", "mjpeg"), ("a.mp4", "libx264")):
        times = [number + number // 3 for number in range(20)]
        with av.open(str(tmp_path / name), "w") as container:
            stream: Any = container.add_stream(codec, rate=RATE)
            stream.height, stream.width, stream.pix_fmt = 96, 160, "yuvj420p" if codec == "mjpeg" else "yuv420p"
            for picture, moment in zip(pictures(20), times, strict=True):
                frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                frame.pts, frame.time_base = moment, Fraction(1, RATE)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
        video = Video(tmp_path / name)
        frames, lost = split(list(video.frames()))
        assert lost == []
        assert video.count in (None, 20)
        assert [frame.number for frame in frames] == list(range(20))
        assert [frame.time_s for frame in frames] == pytest.approx([moment / RATE for moment in times], abs=2e-3)


@pytest.mark.parametrize("name", ["late.mkv", "late.ts"])
def test_times_begin_at_zero_wherever_those_of_the_file_do(tmp_path: Path, name: str) -> None:
    with av.open(str(tmp_path / name), "w") as container:
        stream: Any = container.add_stream("libx264", rate=RATE)
        stream.height, stream.width, stream.pix_fmt = 96, 160, "yuv420p"
        for moment, picture in enumerate(pictures(5), start=50):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = moment, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    frames, _ = split(list(Video(tmp_path / name).frames()))
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(5) / RATE, abs=2e-3)


def at(*moments: int) -> list[Picture]:
    return [Picture(moment, lambda: np.zeros((1, 1, 3), np.uint8), broken=moment == 500) for moment in moments]


@pytest.mark.parametrize(
    ("moments", "reasons"),
    [
        ((0, 100, 200, 300), ["", "", "", ""]),
        ((0, 100, 400, 500), ["", "", "is missing", "is missing", "", ""]),
        ((0, 100, 400, 600), ["", "", "", ""]),
        ((0, 150, 400, 500), ["", "", "", ""]),
        ((0, 100, 9900, 300), ["", "", "has a wrong time", ""]),
        ((0, 100, 50, 300), ["", "", "has a wrong time", ""]),
        ((0, 100, 400, 500, 100, 400, 600), ["", "", "is missing", "is missing", "", "", ""]),
        ((0, 100, 200, 300, 150, 500), ["", "", "", "", "has a wrong time", ""]),
        ((0, 100, 99_000, 99_100), ["", "", "", ""]),
    ],
)
def test_times_show_missing_frames_near_damage(moments: tuple[int, ...], reasons: list[str]) -> None:
    found = list(with_missing(at(*moments), period=100.0, max_gap=50))
    assert [each.reason for each in found] == reasons
    assert [each.pixels is None for each in found] == [bool(reason) for reason in reasons]


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
    assert line.startswith(f"{name} is displayed {turn.strip()} by players: ")
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
