"""The index of an AVI file tells which of its frames are no more, and nothing where there is none."""

from __future__ import annotations

from pathlib import Path

import av
import pytest

from mirrorcam.core.video.avi_index import AviIndex
from tests.core.video.videos import cut, pictures, write_mjpeg

COUNT = 12


def packets(path: Path) -> list[tuple[int, int]]:
    """Position and size of each packet that FFmpeg finds in a video."""
    with av.open(str(path)) as container:
        return [(packet.pos or 0, packet.size) for packet in container.demux(video=0) if packet.size]


def found(path: Path) -> list[tuple[int, int]]:
    index = AviIndex(path)
    return [index.find(position, size, 100 + number) for number, (position, size) in enumerate(packets(path))]


@pytest.fixture
def video(tmp_path: Path) -> Path:
    return write_mjpeg(tmp_path / "a.avi", pictures(COUNT))


def test_every_packet_of_a_whole_file_is_in_its_place(video: Path) -> None:
    assert found(video) == [(number, 0) for number in range(COUNT)]


def test_packets_that_are_overwritten_are_skipped(video: Path) -> None:
    raw, places = bytearray(video.read_bytes()), packets(video)
    raw[places[4][0] - 8 : places[6][0]] = bytes(places[6][0] - places[4][0] + 8)
    video.write_bytes(raw)
    assert found(video) == [(number, 0) for number in range(4)] + [(7, 3)] + [(number, 0) for number in range(8, COUNT)]


def test_packets_that_have_moved_are_found_by_their_size(video: Path) -> None:
    raw, places = bytearray(video.read_bytes()), packets(video)
    del raw[places[4][0] - 8 : places[6][0] - 8]
    video.write_bytes(raw)
    assert found(video) == [(number, 0) for number in range(4)] + [(6, 2)] + [(number, 0) for number in range(7, COUNT)]


def test_packets_that_are_there_twice_have_their_old_moment(video: Path) -> None:
    index = AviIndex(video)
    places = packets(video)
    assert [index.find(position, size, 0)[0] for position, size in (*places[:5], places[2], *places[5:])] == [
        *range(5),
        2,
        *range(5, COUNT),
    ]


def test_without_an_index_packets_are_counted(video: Path) -> None:
    cut(video, 0.8)
    assert found(video) == [(100 + number, 0) for number in range(len(packets(video)))]
