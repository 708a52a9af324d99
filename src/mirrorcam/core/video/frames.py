"""Frames one after another, read ahead of what uses them."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

AHEAD = 4
"""Frames that wait between reading and decoding: enough to even out slow ones, 25 MB of 1920 x 1080."""


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
