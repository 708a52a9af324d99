"""Frames of a camera that runs on, faster than they are used perhaps, and that may be unplugged and come back."""

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
"""Time between two attempts to open a camera that has gone."""
MOST_AHEAD_S = 1.0
"""A camera's clock may gain this much on ours from one frame to the next; one that gains more has started anew."""
ENDING_S = 1.0
"""Time that a silent camera has to close; afterwards it closes in the background."""
LEAST_STEP_S = 1e-6
"""Times of frames increase by this much at least."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A picture (h, w, 3) in RGB, None where it is damaged, and its time in s by the camera's clock, if it has one."""

    pixels: NDArray[np.uint8] | None
    time_s: float | None = None


@dataclass(frozen=True)
class Connection:
    """A camera that was opened: its pictures until it goes, and whether they are a recording, which ends."""

    pictures: Generator[Seen]
    ends: bool = False


class LiveCamera:
    """A camera: its newest frames, in order.

    Where frames arrive faster than they are used, the oldest are left out. A camera that goes is looked for until it is
    back. Memory does not grow with time. Of a recording that a server plays, all frames are returned.

    Parameters
    ----------
    name
        What messages call the camera.
    connect
        Opens the camera, or raises InputError where it is not there.
    width_px, height_px
        Size that its pictures must have.
    on_note
        Takes a line when the camera goes and when it is back.
    clock
        Time in s.
    retry_s
        Time between two attempts to open a camera that has gone.
    waiting
        Number of frames that may wait to be used: with 1, the newest frame is always the next.

    Attributes
    ----------
    started_ns
        Time of the start, since 1970; frames' times count from there. 0 for a recording.
    dropped
        Number of frames that were left out so far; the numbers of frames skip them.
    outages
        How often the camera went and came back.

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
        """Frames from now on, numbered from `after` on: until `stop`, or the end of a recording."""
        if self.ends:
            return self._recorded(after)
        return self._newest(after)

    def stop(self) -> None:
        """End `frames`, also while it waits for one; the camera is let go of."""
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
        """Pass on what the camera shows, for as long as it is wanted, and connect again where it goes."""
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
        except BaseException as error:  # raised again where the frames are asked for
            put(error)
        finally:
            connection.pictures.close()

    def _reconnected(self) -> Connection:
        """The camera opened again, as soon as that works; the old connection once no one waits for it."""
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
        return Frame(number, self._times.moment(arrived, seen.time_s), seen.pixels)


class _Times:
    """Times of frames, which increase always: as far apart as the camera's clock says.

    A camera's clock starts anew where it goes back, or jumps ahead of the times of arrival: these are followed there.
    Frames delayed in transit arrive late and many at once; their times stay. Times of a recording begin
    at 0.
    """

    def __init__(self, follows: bool) -> None:
        self._follows = follows
        self._before: tuple[float, float] | None = None
        """When the last frame with a time arrived, and that time."""
        self._offset = 0.0
        self._last = -LEAST_STEP_S

    def moment(self, arrived: float, stated: float | None) -> float:
        """The time of a frame that arrived at a time, and is of another by the camera's clock, if that has one."""
        moment = arrived
        if stated is not None:
            if self._before is None or (self._follows and self._is_anew(arrived, stated, *self._before)):
                self._offset = (arrived if self._follows else 0.0) - stated
            self._before = arrived, stated
            moment = stated + self._offset
        self._last = max(moment, self._last + LEAST_STEP_S)
        return self._last

    @staticmethod
    def _is_anew(arrived: float, stated: float, arrived_before: float, stated_before: float) -> bool:
        step = stated - stated_before
        return step < 0 or step > arrived - arrived_before + MOST_AHEAD_S
