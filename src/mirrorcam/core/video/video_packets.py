"""Packets of a video file in stored order, and which of them may be missing or damaged."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

_MAX_GAP_BYTES = 64
"""Maximum number of bytes between two packets of a Matroska file with one stream: headers of a block and a cluster."""
_INDEX_NAME = b"idx1"
_ENTRY = struct.Struct("<4s4xII")
# Chunk names of frames, after the number of the stream.
_FRAME_CHUNKS = (b"dc", b"db")
_TAIL_BYTES = 4 << 20
"""Bytes at the end of a file in which its index is searched: enough for 250,000 frames."""


@dataclass(frozen=True, eq=False)
class Packet:
    """A packet of a video.

    Attributes
    ----------
    number
        Index in the file, from 0.
    timestamp
        Presentation timestamp (PTS) in the stream's time base; the decoding timestamp if the packet has none.
    has_pts
        Whether `timestamp` is a PTS.
    data
        FFmpeg's packet.
    suspect
        Whether its data may be incomplete.
    gap
        Whether packets before it may be missing.
    skipped
        Number of packets missing before it according to the file's index.
    """

    number: int
    timestamp: int
    has_pts: bool
    data: Any
    suspect: bool = False
    gap: bool = False
    skipped: int = 0


def packets_of(container: Any, stream: Any) -> Iterator[Packet]:
    """Yield the packets of a stream, also if the file is cut off within one."""
    import av

    # AVI has no timestamps: its index numbers all frames, but FFmpeg numbers only those that it finds.
    index = AviIndex(Path(container.name)) if container.format.name == "avi" else None
    is_only_stream = "matroska" in container.format.name and len(container.streams) == 1
    number, last, corrupt = 0, None, False
    try:
        for data in container.demux(stream):
            if not data.size:
                continue
            times = (data.dts, number) if index else (data.pts, data.dts, number)
            timestamp, skipped = int(next(time for time in times if time is not None)), 0
            if index:
                timestamp, skipped = index.find(data.pos, data.size, timestamp)
            gap = False
            if last is not None:
                gap = is_only_stream and not 0 <= data.pos - last.data.pos - last.data.size <= _MAX_GAP_BYTES
                # Unreadable data before this packet may include the end of the last one.
                yield replace(last, suspect=last.suspect or gap)
            has_pts = not index and data.pts is not None
            # In a transport stream, the mark refers to the next packet.
            suspect, corrupt = corrupt or data.is_corrupt, data.is_corrupt
            last = Packet(number, timestamp, has_pts, data, suspect, gap or suspect or skipped > 0, skipped)
            number += 1
    except (av.FFmpegError, OSError):
        # The rest cannot be read; the frames before are complete.
        pass
    if last is not None:
        yield last


class AviIndex:
    """Numbers packets by the index of an AVI file with one stream; without an index, counts them.

    Parameters
    ----------
    path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        entries = _entries(path)
        stored = [(timestamp, offset, size) for timestamp, (offset, size) in enumerate(entries) if size]
        self._timestamps = [timestamp for timestamp, _, _ in stored]
        self._offsets = {offset: number for number, (_, offset, _) in enumerate(stored)}
        self._sizes = [size for _, _, size in stored]
        self._base: int | None = None
        self._next = 0

    def find(self, position: int | None, size: int, timestamp: int) -> tuple[int, int]:
        """Find the next packet of a file.

        Parameters
        ----------
        position, size
            Offset of its data in the file, and their length.
        timestamp
            Its number for a packet that is not in the index.

        Returns
        -------
        tuple of int
            Number of its frame, which does not increase for a repeated packet, and number of packets in the index
            between the last one and this.
        """
        number = self._number(position, size)
        if number < self._next:
            return self._timestamps[number], 0
        skipped, self._next = number - self._next, number + 1
        return self._timestamps[number] if number < len(self._timestamps) else timestamp, skipped

    def _number(self, position: int | None, size: int) -> int:
        count, expected = len(self._sizes), self._next
        if not count or position is None:
            return expected
        if self._base is None and self._sizes[0] == size:
            # Offsets count from the start of the file or of its list of frames.
            self._base = position - next(iter(self._offsets))
        number = self._offsets.get(position - (self._base or 0))
        if number is not None and self._sizes[number] == size:
            return number
        order = (*range(expected, count), *range(min(expected, count)))
        candidates = [number for number in order if self._sizes[number] == size]
        next_sizes = (size, self._size_after(position + size)) if len(candidates) > 1 else ()
        matching = (number for number in candidates if (*self._sizes[number : number + 2],) == next_sizes)
        return next(matching, next(iter(candidates), expected))

    def _size_after(self, end: int) -> int:
        """Return the size of the next chunk, from its header at the end of a chunk."""
        with self._path.open("rb") as file:
            file.seek(end + end % 2)
            return int.from_bytes(file.read(8)[4:], "little")


def _entries(path: Path) -> list[tuple[int, int]]:
    """Return offset and size of each frame by the index at the end of a file; empty without an index of one stream."""
    with path.open("rb") as file:
        file.seek(max(os.fstat(file.fileno()).st_size - _TAIL_BYTES, 0))
        tail = file.read()
    at = tail.rfind(_INDEX_NAME)
    content = tail[at + 8 :] if at >= 0 else b""
    length = int.from_bytes(tail[at + 4 : at + 8], "little") if at >= 0 else 0
    if not length or length % _ENTRY.size or length > len(content):
        return []
    entries = list(_ENTRY.iter_unpack(content[:length]))
    if len({name for name, _, _ in entries}) > 1 or entries[0][0][2:] not in _FRAME_CHUNKS:
        return []
    return [(offset, size) for _, offset, size in entries]
