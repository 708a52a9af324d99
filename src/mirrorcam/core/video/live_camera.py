"""Frames of a live camera, which may be faster than their consumer, and may be unplugged and reconnected."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.video.frames import AHEAD, Frame, Lost

RETRY_S = 1.0
"""Time between attempts to reopen a camera."""
MOST_AHEAD_S = 1.0
"""Largest advance of a camera's clock over ours between frames; a larger one means that its clock was reset."""
ENDING_S = 1.0
"""Time to wait for a silent camera to close; afterwards it closes in the background."""
LEAST_STEP_S = 1e-6
"""Smallest step between times of frames."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A picture (h, w, 3) in RGB, or None if damaged, and its time by the camera's clock, s, if it has one."""

    pixels: NDArray[np.uint8] | None
    time_s: float | None = None


@dataclass(frozen=True)
class Connection:
    """An open camera: its pictures until it disconnects, and whether they are a recording, which ends."""

    pictures: Generator[Seen]
    ends: bool = False


class LiveCamera:
    """A camera: its newest frames, in order.

    If frames arrive faster than they are used, the oldest are dropped. A camera that disconnects is reopened as soon as
    it is back. Of a recording that a server plays, no frame is dropped.

    Parameters
    ----------
    name
        Name of the camera in messages.
    connect
        Opens the camera; raises InputError if that fails.
    width_px, height_px
        Size that its pictures must have.
    on_note
        Called with a line when the camera disconnects and when it is back.
    clock
        Time in s.
    retry_s
        Time between attempts to reopen the camera.
    waiting
        Number of buffered frames; with 1, the next frame is always the newest.

    Attributes
    ----------
    started_ns
        Start of the frames' times, ns since 1970; 0 for a recording.
    dropped
        Number of dropped frames so far; frame numbers skip them.
    outages
        Number of disconnections.

    Raises
    ------
    InputError
        If the camera cannot be opened; by `frames`, if its pictures have another size.
    """

    def __init__(
        self,
        name: str,
        connect: Callable[[], Connection],
        width_px: int,
        height_px: int,
        *,
        on_note: Callable[[str], None] = lambda line: None,
        clock: Callable[[], float] = time.monotonic,
        retry_s: float = RETRY_S,
        waiting: int = AHEAD,
    ) -> None:
        self.name, self._connect, self._size = name, connect, (width_px, height_px)
        self._on_note, self._clock, self._retry_s, self._most = on_note, clock, retry_s, waiting
        self.dropped, self.outages = 0, 0
        self._changed, self._over = threading.Condition(), threading.Event()
        self._connection = connect()
        self.ends = self._connection.ends
        self.started_ns = 0 if self.ends else time.time_ns()
        self._started, self._times = clock(), _Times(follows=not self.ends)

    def frames(self, after: int = -1) -> Generator[Frame | Lost]:
        """Yield frames from now on, numbered from `after` + 1, until `stop` or the end of a recording."""
        if self.ends:
            return self._recorded(after)
        return self._newest(after)

    def stop(self) -> None:
        """End `frames`, even while it waits for a frame, and release the camera."""
        with self._changed:
            self._over.set()
            self._changed.notify_all()

    def _recorded(self, after: int) -> Generator[Frame | Lost]:
        try:
            for number, seen in enumerate(self._connection.pictures):
                if self._over.is_set():
                    return
                if number > after:
                    yield self._frame(number, seen)
        finally:
            self._connection.pictures.close()

    def _newest(self, after: int) -> Generator[Frame | Lost]:
        waiting: deque[Any] = deque()

        def put(item: Frame | Lost | BaseException) -> None:
            with self._changed:
                if len(waiting) == self._most and not isinstance(item, BaseException):
                    waiting.popleft()
                    self.dropped += 1
                waiting.append(item)
                self._changed.notify_all()

        thread = threading.Thread(target=self._watch, args=(after + 1, put), name="camera", daemon=True)
        thread.start()
        try:
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: waiting or self._over.is_set())
                    if not waiting:
                        return
                    item = waiting.popleft()
                if isinstance(item, BaseException):
                    raise item
                yield item
        finally:
            self._over.set()
            thread.join(ENDING_S)

    def _watch(self, number: int, put: Callable[[Frame | Lost | BaseException], None]) -> None:
        """Pass on the frames of the camera until `stop`, and reconnect after an outage."""
        connection = self._connection
        try:
            while True:
                for seen in connection.pictures:
                    put(self._frame(number, seen))
                    number += 1
                    if self._over.is_set():
                        return
                if self._over.is_set():
                    return
                self._on_note(f"{self.name} gives no more pictures, waiting for it to come back")
                gone = self._clock()
                connection = self._reconnected()
                if self._over.is_set():
                    return
                self.outages += 1
                self._on_note(f"{self.name} is back after {self._clock() - gone:.1f} s")
        except BaseException as error:  # raised again in the consumer
            put(error)
        finally:
            connection.pictures.close()

    def _reconnected(self) -> Connection:
        """Reopen the camera as soon as possible; return the old connection after `stop`."""
        while not self._over.wait(self._retry_s):
            try:
                return self._connect()
            except InputError:
                continue
        return self._connection

    def _frame(self, number: int, seen: Seen) -> Frame | Lost:
        if seen.pixels is None:
            return Lost(number, "is damaged")
        height, width = seen.pixels.shape[:2]
        if (width, height) != self._size:
            expected = f"{self._size[0]}x{self._size[1]} of the layout's camera"
            raise InputError(f"{self.name} gives {width}x{height} px, expected {expected}")
        arrived = self._clock() - self._started
        return Frame(number, self._times.time_s(arrived, seen.time_s), seen.pixels)


class _Times:
    """Strictly increasing times of frames, with the intervals of the camera's clock.

    A clock that goes back, or jumps ahead of the arrival, was reset: times then continue from the arrival. Frames that
    were delayed in transit and arrive together keep their times. Times of a recording begin at 0.
    """

    def __init__(self, follows: bool) -> None:
        self._follows = follows
        self._before: tuple[float, float] | None = None
        """Arrival and camera time of the last frame that has one, s."""
        self._offset = 0.0
        self._last = -LEAST_STEP_S

    def time_s(self, arrived: float, stated: float | None) -> float:
        """Return the time of a frame from its arrival and its camera time, if any; all in s."""
        found = arrived
        if stated is not None:
            if self._before is None or (self._follows and self._was_reset(arrived, stated, *self._before)):
                self._offset = (arrived if self._follows else 0.0) - stated
            self._before = arrived, stated
            found = stated + self._offset
        self._last = max(found, self._last + LEAST_STEP_S)
        return self._last

    @staticmethod
    def _was_reset(arrived: float, stated: float, arrived_before: float, stated_before: float) -> bool:
        step = stated - stated_before
        return step < 0 or step > arrived - arrived_before + MOST_AHEAD_S
