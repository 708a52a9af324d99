"""Packets are marked where a file may have lost some, or some of their data."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np

from mirrorcam.core.video.video_packets import Packet, packets_of
from tests.core.video.videos import pictures, write_h264


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
