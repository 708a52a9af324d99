"""Detection of opened files, also by libraries in other languages such as FFmpeg.

It uses inotify of Linux; `AUDITED` is False on other systems, where nothing is detected.
"""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

AUDITED = sys.platform == "linux"
_IN_OPEN = 0x20
_EVENT = struct.Struct("iIII")


@contextmanager
def watched_opens(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """List those of the given files that are opened within the block; the list is filled when the block ends."""
    opened: list[Path] = []
    if not AUDITED:
        yield opened
        return
    system = ctypes.CDLL(None, use_errno=True)
    queue = system.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
    if queue < 0:
        raise OSError(ctypes.get_errno(), "inotify_init1")
    try:
        by_watch: dict[int, Path] = {}
        for path in paths:
            watch = system.inotify_add_watch(queue, os.fsencode(path), _IN_OPEN)
            if watch < 0:
                raise OSError(ctypes.get_errno(), "inotify_add_watch", str(path))
            by_watch[watch] = path
        yield opened
        opened += (by_watch[watch] for watch in _watches(queue))
    finally:
        os.close(queue)


def _watches(queue: int) -> Iterator[int]:
    """Yield the watches of the pending events in a queue."""
    with suppress(BlockingIOError):
        while events := os.read(queue, 1 << 16):
            offset = 0
            while offset < len(events):
                watch, _, _, length = _EVENT.unpack_from(events, offset)
                yield watch
                offset += _EVENT.size + length
