"""Frames of a source in order: read ahead of their use, and a few spread evenly over a stream."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
READ_AHEAD = 4
"""Frames buffered between reading and decoding, which bridges slow ones: 25 MB at 1920 x 1080."""
MAX_KEPT = 8


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture (h, w, 3) in RGB, its number in the source from 0, and its time since the source's start, s."""

    number: int
    time_s: float
    pixels: NDArray[np.uint8]


@dataclass(frozen=True)
class Lost:
    """A frame that cannot be used: its number in the source, and the reason."""

    number: int
    reason: str


class Source(Protocol):
    """Source of frames: `Video`, `CameraBag`, `LiveCamera`."""

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """Yield the frames after a number, in order."""

    def stop(self) -> None:
        """End `frames`, even while it waits for a frame."""


@dataclass(frozen=True)
class _Failed:
    error: BaseException


def read_ahead(items: Iterator[T], count: int = READ_AHEAD, stop: Callable[[], None] = lambda: None) -> Generator[T]:
    """Yield the same items, which a thread reads ahead by at most `count`; an error is raised in order.

    The thread ends with the items, or when the returned iterator is closed. Then `stop` is called, which must end items
    that would wait forever.
    """
    buffer: queue.Queue[Any] = queue.Queue(maxsize=count)
    stopped, end = threading.Event(), object()

    def put(item: object) -> None:
        while not stopped.is_set():
            try:
                buffer.put(item, timeout=0.1)
                return
            except queue.Full:
                continue

    def read() -> None:
        try:
            for item in items:
                put(item)
                if stopped.is_set():
                    return
            put(end)
        except BaseException as error:  # raised again in the consumer
            put(_Failed(error))
        finally:
            close = getattr(items, "close", None)
            if close is not None:
                close()

    thread = threading.Thread(target=read, name="read ahead", daemon=True)
    thread.start()
    try:
        while (item := buffer.get()) is not end:
            if isinstance(item, _Failed):
                raise item.error
            yield item
    finally:
        stopped.set()
        stop()
        thread.join()


class SpreadFrames:
    """Keeps evenly spread frames: each one, then every 2nd, 4th, ...; at most 8, and 5 or more after 9."""

    def __init__(self) -> None:
        self.frames: list[NDArray[np.uint8]] = []
        self._added, self._stride = 0, 1

    def add(self, frame: NDArray[np.uint8]) -> None:
        """Add the next frame, without a copy."""
        if self._added % self._stride == 0:
            self.frames.append(frame)
            if len(self.frames) > MAX_KEPT:
                self.frames, self._stride = self.frames[::2], 2 * self._stride
        self._added += 1


@dataclass(frozen=True)
class WatchedSource:
    """A source of frames that keeps a few evenly spread ones."""

    source: Source
    sample: SpreadFrames = field(default_factory=SpreadFrames)

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """Yield the frames of the source."""
        for item in self.source.frames(after):
            if isinstance(item, Frame):
                self.sample.add(item.pixels)
            yield item

    def stop(self) -> None:
        """End the frames, even while the source waits for one."""
        self.source.stop()
