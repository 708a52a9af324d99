"""Reading ahead: all items, in order."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.core.video.frames import AHEAD, read_ahead


def test_reading_ahead_is_bounded_and_keeps_the_order() -> None:
    made: list[int] = []

    def numbers() -> Iterator[int]:
        for number in range(30):
            made.append(number)
            yield number

    ahead = read_ahead(numbers())
    assert next(ahead) == 0
    deadline = time.monotonic() + 5
    while len(made) < AHEAD + 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.1)
    assert len(made) == AHEAD + 2  # one given, AHEAD in the queue, one in the thread's hand
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
