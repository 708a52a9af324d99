"""Frames one after another, as those of a camera of this machine; read ahead of what uses them."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import InputError

T = TypeVar("T")

AHEAD = 4
"""Frames that wait between reading and decoding: enough to even out slow ones, 25 MB of 1920 x 1080."""

PATIENCE = 30
"""Pictures in a row that a camera may fail to give before it counts as disconnected."""


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


class CaptureDevice:
    """A camera on this machine, asked for pictures of a size.

    Raises InputError for a camera that cannot be opened or gives pictures of another size.
    """

    def __init__(
        self,
        number: int,
        width_px: int,
        height_px: int,
        capture: Callable[[int], Any] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.number, self.width_px, self.height_px = number, width_px, height_px
        # OpenCV would print its attempts on standard error; the failure is reported here.
        level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            self._capture, self._clock = (capture or cv2.VideoCapture)(number), clock
        finally:
            cv2.utils.logging.setLogLevel(level)
        if not self._capture.isOpened():
            raise InputError(f"camera {number} cannot be opened, expected one on this machine (/dev/video{number})")
        # Uncompressed pictures of this size do not fit through USB 2 at a camera's rate.
        self._capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, width_px)
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height_px)

    def frames(self, after: int = -1) -> Generator[Frame | Lost]:
        """Pictures from now on, numbered from `after` on; without an end, unless the camera goes."""
        started, number, missed = self._clock(), after + 1, 0
        try:
            while missed < PATIENCE:
                given, bgr = self._capture.read()
                moment = self._clock() - started
                if not given:
                    missed += 1
                    yield Lost(number, "was not given by the camera")
                elif bgr.shape[:2] != (self.height_px, self.width_px):
                    raise InputError(
                        f"camera {self.number} gives {bgr.shape[1]}x{bgr.shape[0]} px, expected "
                        f"{self.width_px}x{self.height_px} of the layout's camera"
                    )
                else:
                    missed = 0
                    yield Frame(number, moment, np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8))
                number += 1
            raise InputError(f"camera {self.number} gave no picture {PATIENCE} times in a row, is it connected?")
        finally:
            self._capture.release()


@dataclass(frozen=True)
class _Failed:
    error: BaseException


def read_ahead(items: Iterator[T], count: int = AHEAD) -> Generator[T]:
    """The same items, of which a thread gets at most `count` before they are asked for; errors arrive in their place.

    The thread ends with the items, or when the iterator that this returns is closed.
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
        thread.join()
