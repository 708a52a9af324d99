"""The newest frame of a running source, for any number of consumers; frames not taken in time are counted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from mirrorcam.core.video.frames import Frame, Lost, Source

ENDING_S = 2.0


@dataclass(frozen=True)
class ArrivedFrame:
    """A frame, and its time of arrival by the clock of `NewestFrame`, s."""

    frame: Frame
    arrived_s: float


class NewestFrame:
    """Reads a source in its own thread, and keeps its newest frame; stops when a `with` block ends.

    Parameters
    ----------
    source
        Source of frames: a `LiveCamera`, a `Video` or any object with `frames` and `stop`.
    paced
        Whether frames arrive at their stated times, as for a file; otherwise as fast as the source delivers them.
    keep_all
        Whether to wait until each frame is taken, so that none is dropped.
    on_arrival
        Called in the reading thread with each frame and each lost frame on arrival.
    clock
        Time in s.

    Attributes
    ----------
    dropped, lost
        Numbers of frames replaced before they were taken, and of frames that could not be read.
    """

    def __init__(
        self,
        source: Source,
        *,
        paced: bool = False,
        keep_all: bool = False,
        on_arrival: Callable[[Frame | Lost], None] = lambda item: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not all(hasattr(source, name) for name in ("frames", "stop")):
            raise TypeError(f"source: {type(source).__name__}, expected LiveCamera, Video or CameraBag")
        self.dropped = self.lost = 0
        self._source, self._paced, self._keep_all, self._clock = source, paced, keep_all, clock
        self._on_arrival = on_arrival
        self._changed, self._stopping = threading.Condition(), threading.Event()
        self._newest: ArrivedFrame | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._read, name="newest frame", daemon=True)
        self._thread.start()

    def take(self, timeout_s: float | None = None) -> ArrivedFrame | None:
        """Wait for a frame that was not taken yet; None at the end of the source, or after `timeout_s`.

        Reraises an exception of the source.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._ended, timeout_s)
            newest, self._newest = self._newest, None
            self._changed.notify_all()
            if newest is None and self._error is not None:
                raise self._error
            return newest

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stop()

    @property
    def ended(self) -> bool:
        """Whether the source has ended and its last frame was taken."""
        with self._changed:
            return self._ended and self._newest is None

    def stop(self) -> None:
        """Stop reading, and release the source."""
        self._stopping.set()
        with self._changed:
            self._changed.notify_all()
        self._source.stop()
        self._thread.join(ENDING_S)

    def _read(self) -> None:
        try:
            started: float | None = None
            for item in self._source.frames():
                if self._stopping.is_set():
                    return
                if isinstance(item, Lost):
                    self.lost += 1
                    self._on_arrival(item)
                    continue
                if self._paced:
                    started = self._clock() - item.time_s if started is None else started
                    if self._stopping.wait(max(started + item.time_s - self._clock(), 0.0)):
                        return
                self._on_arrival(item)
                self._put(item)
        except BaseException as error:  # reraised by `take`
            self._error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _put(self, frame: Frame) -> None:
        with self._changed:
            if self._keep_all:
                self._changed.wait_for(lambda: self._newest is None or self._stopping.is_set())
            self.dropped += self._newest is not None
            self._newest = ArrivedFrame(frame, self._clock())
            self._changed.notify_all()
