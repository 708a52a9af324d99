"""Packets become pictures in the order of time: whole, or lost with all that depend on them."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.video.video_packets import Packet, packets_of
from mirrorcam.core.video.video_pictures import (
    DAMAGED,
    DEPENDS,
    Picture,
    are_plain_jpegs,
    decoded_pictures,
    have_ends,
    jpeg_pictures,
)
from tests.core.video.test_video_packets import noisy, packets
from tests.core.video.videos import number_in, pictures, write_h264, write_mjpeg

SIZE = (160, 96)


def decoded(path: Path) -> list[Picture]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.codec_context.thread_count = 3
        return list(decoded_pictures(stream.codec_context, packets_of(container, stream), SIZE))


def shown(found: list[Picture]) -> list[int | None]:
    """The number in each picture, None where it is lost."""
    return [number_in(each.pixels()) if each.pixels else None for each in found]


def test_frames_before_a_damaged_one_that_need_it_are_lost_with_it(tmp_path: Path) -> None:
    """A frame between two others in time comes after both in the file."""
    path = write_h264(tmp_path / "a.mp4", noisy(30), b_frames=2)
    order = packets(path)
    at = next(
        number
        for number, (packet, following) in enumerate(pairwise(order))
        if number > 12 and following.timestamp < packet.timestamp
    )
    raw, data = bytearray(path.read_bytes()), order[at].data
    raw[data.pos + data.size // 2 : data.pos + data.size] = bytes(data.size - data.size // 2)
    path.write_bytes(raw)
    found = decoded(path)
    times = sorted(packet.timestamp for packet in order)
    key = next(number for number, packet in enumerate(order) if number > at and packet.data.is_keyframe)
    first = min(times.index(packet.timestamp) for packet in order[at:key])
    assert first < times.index(order[at].timestamp)
    assert shown(found)[first:20] == [None] * (20 - first)
    assert shown(found)[20:] == [*range(20, 30)]
    assert {each.reason for each in found if each.pixels is None} == {DAMAGED, DEPENDS}
    assert [each.timestamp for each in found] == times


def test_every_key_frame_is_a_new_start(tmp_path: Path) -> None:
    """Threads of the decoder that have met damaged data would fail at whole ones too."""
    path = write_h264(tmp_path / "a.ts", noisy(40) * 5, key_every=20, b_frames=2)
    random, raw = np.random.default_rng(6), bytearray(path.read_bytes())
    for begin in random.integers(10_000, len(raw) // 2, 3):
        raw[begin : begin + 40] = random.bytes(40)
    path.write_bytes(raw)
    found = shown(decoded(path))
    assert found[-80:] == [*range(40)] * 2
    assert found.count(None) <= 3 * 20


@pytest.mark.parametrize("name", ["a.avi", "a.h264"])
def test_without_times_frames_come_as_the_decoder_orders_them(name: str, tmp_path: Path) -> None:
    found = decoded(write_h264(tmp_path / name, pictures(23), b_frames=2))
    assert shown(found) == list(range(23))
    assert [each.timestamp for each in found] == list(range(23))


def test_jpegs_of_a_camera_are_read_as_picture_files_unless_it_writes_its_own_way(tmp_path: Path) -> None:
    whole = packets(write_mjpeg(tmp_path / "a.avi", noisy(9)))
    assert are_plain_jpegs(whole, SIZE[1])
    assert not are_plain_jpegs(whole, 2 * SIZE[1])
    raw = [bytes(packet.data) for packet in whole]
    own = [changed(packet, data[:-2] + b"\x12\x34" * 40 + data[-2:]) for packet, data in zip(whole, raw, strict=True)]
    assert not are_plain_jpegs(own, SIZE[1])
    assert are_plain_jpegs([*own[:-1], whole[-1]], SIZE[1])
    damaged = [changed(packet, data[:-200]) for packet, data in zip(whole, raw, strict=True)]
    assert are_plain_jpegs(damaged, SIZE[1])
    remark = b"\xff\xfe\x00\x0bCS=ITU601"
    limited = [changed(packet, data[:2] + remark + data[2:]) for packet, data in zip(whole, raw, strict=True)]
    assert not are_plain_jpegs(limited, SIZE[1])


def changed(packet: Packet, data: bytes) -> Packet:
    return Packet(packet.number, packet.timestamp, packet.has_pts, av.Packet(data), packet.suspect)


def test_a_jpeg_without_its_end_is_read_where_all_are_so_and_one_without_its_data_is_not(tmp_path: Path) -> None:
    whole = packets(write_mjpeg(tmp_path / "a.avi", noisy(1)))[0]
    raw = bytes(whole.data)
    cases = [whole, *(changed(whole, data) for data in (raw[:-2], raw[:-200], b"no JPEG"))]
    assert [each.reason for each in jpeg_pictures(cases, SIZE)] == ["", DAMAGED, DAMAGED, DAMAGED]
    assert have_ends(cases)
    assert not have_ends(cases[1:])
    complete, without_end, without_data, none = jpeg_pictures(cases, SIZE, with_ends=False)
    assert complete.pixels is not None
    assert without_end.pixels is not None
    assert np.array_equal(without_end.pixels(), complete.pixels())
    assert without_data.pixels is not None
    with pytest.raises(DamagedPicture, match="premature end"):
        without_data.pixels()
    assert (none.pixels, none.reason) == (None, DAMAGED)
