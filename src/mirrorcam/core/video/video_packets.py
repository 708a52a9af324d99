"""Packets of a video file as they are stored, and where some of them may be missing or damaged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mirrorcam.core.video.avi_index import AviIndex

_LARGEST_GAP = 64
"""Bytes between two packets of a Matroska file with one stream: headers of a block and of a cluster."""


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
        Whether its data may not be whole.
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
            # A transport stream marks the packet before the one that did not arrive whole.
            suspect, corrupt = corrupt or data.is_corrupt, data.is_corrupt
            last = Packet(number, moment, stated, data, suspect, gap or suspect or skipped > 0, skipped)
            number += 1
    except (av.FFmpegError, OSError):
        # What follows cannot be read; the frames before are whole.
        pass
    if last is not None:
        yield last
