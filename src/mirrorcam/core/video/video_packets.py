"""Packets of a video file as they are stored, and which of them may be missing or damaged."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

_LARGEST_GAP = 64
"""Bytes between two packets of a Matroska file with one stream: headers of a block and of a cluster."""
_NAME = b"idx1"
_ENTRY = struct.Struct("<4s4xII")
# What the names of chunks with a frame end in, after the number of the stream.
_FRAMES = (b"dc", b"db")
_LONGEST_BYTES = 4 << 20
"""Bytes at the end of a file searched for its index: enough for 250,000 frames."""


@dataclass(frozen=True, eq=False)
class Packet:
    """A packet of a video.

    Attributes
    ----------
    number
        Its number in the file, from 0.
    moment
        When its frame is shown, in the stream's own time; where that is not stated, when it is decoded.
    stated
        Whether the moment is that at which it is shown.
    data
        The packet.
    suspect
        Whether its data may be incomplete.
    gap
        Whether packets before it may be missing.
    skipped
        Number of packets between the last one and this that the file's index knows, and that are not there.
    """

    number: int
    moment: int
    stated: bool
    data: Any
    suspect: bool = False
    gap: bool = False
    skipped: int = 0


def packets_of(container: Any, stream: Any) -> Iterator[Packet]:
    """The packets of a stream, also where the file breaks off in the middle of one."""
    import av

    # AVI has no times, but counts what it stores, and its reader counts only what it finds.
    index = AviIndex(Path(container.name)) if container.format.name == "avi" else None
    alone = "matroska" in container.format.name and len(container.streams) == 1
    number, last, corrupt = 0, None, False
    try:
        for data in container.demux(stream):
            if not data.size:
                continue
            times = (data.dts, number) if index else (data.pts, data.dts, number)
            moment, skipped = int(next(each for each in times if each is not None)), 0
            if index:
                moment, skipped = index.find(data.pos, data.size, moment)
            gap = False
            if last is not None:
                gap = alone and not 0 <= data.pos - last.data.pos - last.data.size <= _LARGEST_GAP
                # What cannot be read begins where the last packet ends, or before.
                yield replace(last, suspect=last.suspect or gap)
            stated = not index and data.pts is not None
            # A transport stream marks the packet before the one that arrived incomplete.
            suspect, corrupt = corrupt or data.is_corrupt, data.is_corrupt
            last = Packet(number, moment, stated, data, suspect, gap or suspect or skipped > 0, skipped)
            number += 1
    except (av.FFmpegError, OSError):
        # The rest cannot be read; the frames before are complete.
        pass
    if last is not None:
        yield last


class AviIndex:
    """Finds packets in the index of an AVI file with one stream; without an index, they are counted.

    Parameters
    ----------
    path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        entries = _entries(path)
        stored = [(moment, offset, size) for moment, (offset, size) in enumerate(entries) if size]
        self._moments = [moment for moment, _, _ in stored]
        self._offsets = {offset: number for number, (_, offset, _) in enumerate(stored)}
        self._sizes = [size for _, _, size in stored]
        self._base: int | None = None
        self._next = 0

    def find(self, position: int | None, size: int, moment: int) -> tuple[int, int]:
        """Find the next packet of a file.

        Parameters
        ----------
        position, size
            Where its data start in the file, and their length.
        moment
            When it is shown, for a packet that the index does not know.

        Returns
        -------
        tuple of int
            When it is shown, in frames. A packet repeated from before is not after the last one.
            And the number of packets of the index between the last one and this.
        """
        number = self._number(position, size)
        if number < self._next:
            return self._moments[number], 0
        skipped, self._next = number - self._next, number + 1
        return self._moments[number] if number < len(self._moments) else moment, skipped

    def _number(self, position: int | None, size: int) -> int:
        count, following = len(self._sizes), self._next
        if not count or position is None:
            return following
        if self._base is None and self._sizes[0] == size:
            # Offsets count from the start of the file or of its list of frames.
            self._base = position - next(iter(self._offsets))
        known = self._offsets.get(position - (self._base or 0))
        if known is not None and self._sizes[known] == size:
            return known
        order = (*range(following, count), *range(min(following, count)))
        same = [number for number in order if self._sizes[number] == size]
        after = (size, self._size_after(position + size)) if len(same) > 1 else ()
        sure = (number for number in same if (*self._sizes[number : number + 2],) == after)
        return next(sure, next(iter(same), following))

    def _size_after(self, end: int) -> int:
        """Size of the data after those that end at a position, by their header there."""
        with self._path.open("rb") as file:
            file.seek(end + end % 2)
            return int.from_bytes(file.read(8)[4:], "little")


def _entries(path: Path) -> list[tuple[int, int]]:
    """Offset and size of each frame by the index at the end of a file; none where there is no index of one stream."""
    with path.open("rb") as file:
        file.seek(max(os.fstat(file.fileno()).st_size - _LONGEST_BYTES, 0))
        tail = file.read()
    at = tail.rfind(_NAME)
    content = tail[at + 8 :] if at >= 0 else b""
    length = int.from_bytes(tail[at + 4 : at + 8], "little") if at >= 0 else 0
    if not length or length % _ENTRY.size or length > len(content):
        return []
    entries = list(_ENTRY.iter_unpack(content[:length]))
    if len({name for name, _, _ in entries}) > 1 or entries[0][0][2:] not in _FRAMES:
        return []
    return [(offset, size) for _, offset, size in entries]
