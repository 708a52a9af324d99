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
from mirrorcam.core.video.frames import READ_AHEAD, Frame, Lost

RETRY_S = 1.0
"""Time between attempts to reopen a camera."""
MAX_AHEAD_S = 1.0
"""Largest advance of a camera's clock over ours between frames; a larger one means that its clock was reset."""
ENDING_S = 1.0
"""Time to wait for a silent camera to close; afterwards it closes in the background."""
MIN_STEP_S = 1e-6
"""Smallest step between times of frames."""


@dataclass(frozen=True, eq=False)
class CameraPicture:
    """A picture (h, w, 3) in RGB, or None if damaged, and its time by the camera's clock, s, if it has one."""

    pixels: NDArray[np.uint8] | None
    time_s: float | None = None


@dataclass(frozen=True)
class Connection:
    """An open camera: its pictures until it disconnects, and whether they are a recording, which ends."""

    pictures: Generator[CameraPicture]
    ends: bool = False


class LiveCamera:
    """A camera: its newest frames, in order.

    If frames arrive faster than they are used, the oldest are dropped. A camera that disconnects is reopened as soon as
    it is back. If a server plays a recording, no frame is dropped.

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
    buffered
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
        buffered: int = READ_AHEAD,
    ) -> None:
        self.name, self._connect, self._size = name, connect, (width_px, height_px)
        self._on_note, self._clock, self._retry_s, self._max_buffered = on_note, clock, retry_s, buffered
        self.dropped, self.outages = 0, 0
        self._changed, self._over = threading.Condition(), threading.Event()
        self._connection = connect()
        self.ends = self._connection.ends
        self.started_ns = 0 if self.ends else time.time_ns()
        self._started, self._times = clock(), _Times(is_live=not self.ends)

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
            for number, picture in enumerate(self._connection.pictures):
                if self._over.is_set():
                    return
                if number > after:
                    yield self._frame(number, picture)
        finally:
            self._connection.pictures.close()

    def _newest(self, after: int) -> Generator[Frame | Lost]:
        queue: deque[Any] = deque()

        def put(item: Frame | Lost | BaseException) -> None:
            with self._changed:
                if len(queue) == self._max_buffered and not isinstance(item, BaseException):
                    queue.popleft()
                    self.dropped += 1
                queue.append(item)
                self._changed.notify_all()

        thread = threading.Thread(target=self._watch, args=(after + 1, put), name="camera", daemon=True)
        thread.start()
        try:
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: queue or self._over.is_set())
                    if not queue:
                        return
                    item = queue.popleft()
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
                for picture in connection.pictures:
                    put(self._frame(number, picture))
                    number += 1
                    if self._over.is_set():
                        return
                if self._over.is_set():
                    return
                self._on_note(f"{self.name} gives no more pictures, waiting for it to come back")
                lost_s = self._clock()
                connection = self._reconnected()
                if self._over.is_set():
                    return
                self.outages += 1
                self._on_note(f"{self.name} is back after {self._clock() - lost_s:.1f} s")
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

    def _frame(self, number: int, picture: CameraPicture) -> Frame | Lost:
        if picture.pixels is None:
            return Lost(number, "is damaged")
        height, width = picture.pixels.shape[:2]
        if (width, height) != self._size:
            expected = f"{self._size[0]}x{self._size[1]} of the layout's camera"
            raise InputError(f"{self.name} gives {width}x{height} px, expected {expected}")
        arrival_s = self._clock() - self._started
        return Frame(number, self._times.time_s(arrival_s, picture.time_s), picture.pixels)


class _Times:
    """Strictly increasing times of frames, with the intervals of the camera's clock.

    A clock that goes back, or jumps ahead of the arrival, was reset: times then continue from the arrival. Frames that
    were delayed in transit and arrive together keep their times. Times of a recording begin at 0.
    """

    def __init__(self, is_live: bool) -> None:
        self._is_live = is_live
        self._previous: tuple[float, float] | None = None
        """Arrival and camera time of the last frame that has one, s."""
        self._offset = 0.0
        self._last = -MIN_STEP_S

    def time_s(self, arrival_s: float, camera_s: float | None) -> float:
        """Return the time of a frame from its arrival and its camera time, if any; all in s."""
        time_s = arrival_s
        if camera_s is not None:
            if self._previous is None or (self._is_live and self._was_reset(arrival_s, camera_s, *self._previous)):
                self._offset = (arrival_s if self._is_live else 0.0) - camera_s
            self._previous = arrival_s, camera_s
            time_s = camera_s + self._offset
        self._last = max(time_s, self._last + MIN_STEP_S)
        return self._last

    @staticmethod
    def _was_reset(arrival_s: float, camera_s: float, arrival_before_s: float, camera_before_s: float) -> bool:
        step = camera_s - camera_before_s
        return step < 0 or step > arrival_s - arrival_before_s + MAX_AHEAD_S
