"""Reading ahead: all items, in order."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.video.frames import MAX_KEPT, READ_AHEAD, Frame, Lost, SpreadFrames, WatchedSource, read_ahead


def test_reading_ahead_is_bounded_and_keeps_the_order() -> None:
    made: list[int] = []

    def numbers() -> Iterator[int]:
        for number in range(30):
            made.append(number)
            yield number

    ahead = read_ahead(numbers())
    assert next(ahead) == 0
    deadline = time.monotonic() + 5
    while len(made) < READ_AHEAD + 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.1)
    assert len(made) == READ_AHEAD + 2  # one given, READ_AHEAD in the queue, one in the thread's hand
    assert list(ahead) == list(range(1, 30))


def test_an_error_while_reading_ahead_arrives_after_what_was_read() -> None:
    def numbers() -> Iterator[int]:
        yield 1
        raise InputError("the camera burns")

    ahead = read_ahead(numbers())
    assert next(ahead) == 1
    with pytest.raises(InputError, match="the camera burns"):
        next(ahead)


def test_who_stops_listening_ends_the_thread_and_closes_the_source() -> None:
    closed: list[bool] = []

    def numbers() -> Iterator[int]:
        try:
            yield from range(1000)
        finally:
            closed.append(True)

    ahead = read_ahead(numbers())
    next(ahead)
    ahead.close()
    assert closed == [True]
    assert not [thread for thread in threading.enumerate() if thread.name == "read ahead"]


@pytest.mark.parametrize("count", [1, 5, 8, 9, 16, 17, 100, 1000])
def test_frames_are_spread_evenly(count: int) -> None:
    spread = SpreadFrames()
    for number in range(count):
        spread.add(np.full(1, number, np.int64).astype(np.uint8) if count < 256 else np.array([number]))
    kept = [int(frame[0]) for frame in spread.frames]
    assert min(count, 5) <= len(kept) <= MAX_KEPT
    steps = np.diff(kept)
    assert kept[0] == 0
    assert (steps == steps[:1]).all()
    assert count - kept[-1] <= 2 * (steps[0] if len(steps) else 1)


def test_a_watched_source_gives_the_same_frames_and_keeps_a_few() -> None:
    class Source:
        stopped = False

        def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
            for number in range(after + 1, 40):
                yield Frame(number, number / 30.0, np.full((2, 2, 3), number, np.uint8))
            yield Lost(40, "is damaged")

        def stop(self) -> None:
            self.stopped = True

    source = Source()
    watched = WatchedSource(source)
    assert [item.number for item in watched.frames(9)] == list(range(10, 41))
    assert [int(frame[0, 0, 0]) for frame in watched.sample.frames] == [10, 14, 18, 22, 26, 30, 34, 38]
    watched.stop()
    assert source.stopped
