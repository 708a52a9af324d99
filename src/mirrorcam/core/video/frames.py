"""Frames of a source one after another: read ahead of their use, and a few spread evenly over a stream."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
AHEAD = 4
"""Frames that wait between reading and decoding: enough to even out slow ones, 25 MB of 1920 x 1080."""
MOST = 8


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture (h, w, 3) in RGB, its number in the source from 0, and its time in s from the source's start."""

    number: int
    time_s: float
    pixels: NDArray[np.uint8]


@dataclass(frozen=True)
class Lost:
    """A frame that was there, but cannot be used: its number in the source, and why."""

    number: int
    reason: str


class Source(Protocol):
    """Source of frames: `Video`, `LiveCamera`."""

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """The frames after a number, in order."""

    def stop(self) -> None:
        """End `frames`, also where it waits for one."""


@dataclass(frozen=True)
class _Failed:
    error: BaseException


def read_ahead(items: Iterator[T], count: int = AHEAD, stop: Callable[[], None] = lambda: None) -> Generator[T]:
    """The same items, of which a thread gets at most `count` before they are asked for; errors arrive in their place.

    The thread ends with the items, or when the iterator that this returns is closed. `stop` is called then: it must end
    items that wait for what may never come.
    """
    waiting: queue.Queue[Any] = queue.Queue(maxsize=count)
    over, end = threading.Event(), object()

    def put(item: object) -> None:
        while not over.is_set():
            try:
                waiting.put(item, timeout=0.1)
                return
            except queue.Full:
                continue

    def read() -> None:
        try:
            for item in items:
                put(item)
                if over.is_set():
                    return
            put(end)
        except BaseException as error:  # raised again where the items are asked for
            put(_Failed(error))
        finally:
            close = getattr(items, "close", None)
            if close is not None:
                close()

    thread = threading.Thread(target=read, name="read ahead", daemon=True)
    thread.start()
    try:
        while (item := waiting.get()) is not end:
            if isinstance(item, _Failed):
                raise item.error
            yield item
    finally:
        over.set()
        stop()
        thread.join()


class SpreadFrames:
    """Keeps every first, second, fourth, ... frame of those that are added: at most 8, and 5 or more of 9 or more."""

    def __init__(self) -> None:
        self.kept: list[NDArray[np.uint8]] = []
        self._added, self._stride = 0, 1

    def add(self, frame: NDArray[np.uint8]) -> None:
        """Take the next frame, which is not copied."""
        if self._added % self._stride == 0:
            self.kept.append(frame)
            if len(self.kept) > MOST:
                self.kept, self._stride = self.kept[::2], 2 * self._stride
        self._added += 1


@dataclass(frozen=True)
class WatchedSource:
    """A source of frames of which a few, spread evenly, are kept as they pass."""

    source: Source
    seen: SpreadFrames = field(default_factory=SpreadFrames)

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """The frames of the source."""
        for item in self.source.frames(after):
            if isinstance(item, Frame):
                self.seen.add(item.pixels)
            yield item

    def stop(self) -> None:
        """End the frames, also where they wait for one."""
        self.source.stop()
