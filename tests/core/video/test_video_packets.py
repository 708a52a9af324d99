"""Packets are marked where a file may have lost some, or some of their data."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from mirrorcam.core.video.video_packets import AviIndex, Packet, packets_of
from tests.core.video.videos import cut, pictures, write_h264, write_mjpeg

COUNT = 12


def noisy(count: int) -> list[np.ndarray]:
    """Pictures of which a video has data enough to be damaged in many places."""
    random = np.random.default_rng(0)
    return [np.clip(each + random.integers(-9, 10, each.shape), 0, 255).astype(np.uint8) for each in pictures(count)]


def packets(path: Path) -> list[Packet]:
    with av.open(str(path)) as container:
        return list(packets_of(container, container.streams.video[0]))


def test_packets_around_what_cannot_be_read_are_suspect(tmp_path: Path) -> None:
    path = write_h264(tmp_path / "a.mkv", noisy(20))
    places = [(packet.data.pos, packet.data.size) for packet in packets(path)]
    raw = bytearray(path.read_bytes())
    begin, end = places[6][0] - 8, places[8][0] + 20
    raw[begin:end] = bytes(np.random.default_rng(1).integers(0, 256, end - begin, dtype=np.uint8))
    path.write_bytes(raw)
    found = packets(path)
    assert len(found) < 20
    assert [packet.number for packet in found if packet.suspect] == [5]
    assert [packet.number for packet in found if packet.gap] == [6]
    assert not any(packet.suspect or packet.gap for packet in packets(write_h264(tmp_path / "b.mkv", noisy(20))))


def test_packets_of_a_transport_stream_that_did_not_arrive_are_suspect(tmp_path: Path) -> None:
    path = write_h264(tmp_path / "a.ts", noisy(20))
    assert not any(packet.suspect for packet in packets(path))
    raw = bytearray(path.read_bytes())
    del raw[188 * (len(raw) // 376) : 188 * (len(raw) // 376 + 3)]
    path.write_bytes(raw)
    assert any(packet.suspect for packet in packets(path))


def indexed_packets(path: Path) -> list[tuple[int, int]]:
    """Position and size of each packet that FFmpeg finds in a video."""
    with av.open(str(path)) as container:
        return [(packet.pos or 0, packet.size) for packet in container.demux(video=0) if packet.size]


def found(path: Path) -> list[tuple[int, int]]:
    index = AviIndex(path)
    return [index.find(position, size, 100 + number) for number, (position, size) in enumerate(indexed_packets(path))]


@pytest.fixture
def video(tmp_path: Path) -> Path:
    return write_mjpeg(tmp_path / "a.avi", pictures(COUNT))


def test_every_packet_of_a_complete_file_is_numbered(video: Path) -> None:
    assert found(video) == [(number, 0) for number in range(COUNT)]


def test_packets_that_are_overwritten_are_skipped(video: Path) -> None:
    raw, places = bytearray(video.read_bytes()), indexed_packets(video)
    raw[places[4][0] - 8 : places[6][0]] = bytes(places[6][0] - places[4][0] + 8)
    video.write_bytes(raw)
    assert found(video) == [(number, 0) for number in range(4)] + [(7, 3)] + [(number, 0) for number in range(8, COUNT)]


def test_packets_that_have_moved_are_found_by_their_size(video: Path) -> None:
    raw, places = bytearray(video.read_bytes()), indexed_packets(video)
    del raw[places[4][0] - 8 : places[6][0] - 8]
    video.write_bytes(raw)
    assert found(video) == [(number, 0) for number in range(4)] + [(6, 2)] + [(number, 0) for number in range(7, COUNT)]


def test_packets_that_are_there_twice_have_their_old_moment(video: Path) -> None:
    index = AviIndex(video)
    places = indexed_packets(video)
    assert [index.find(position, size, 0)[0] for position, size in (*places[:5], places[2], *places[5:])] == [
        *range(5),
        2,
        *range(5, COUNT),
    ]


def test_without_an_index_packets_are_counted(video: Path) -> None:
    cut(video, 0.8)
    assert found(video) == [(100 + number, 0) for number in range(len(indexed_packets(video)))]
