"""The newest frame, what is dropped, and pacing."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.newest_frame import NewestFrame


class Frames:
    """A source of small frames, which waits where it is told to, and may fail."""

    def __init__(self, count: int, *, hold_at: int = -1, lost: int = -1, fails: bool = False) -> None:
        self.count, self.hold_at, self.lost, self.fails = count, hold_at, lost, fails
        self.go, self.stopped, self.given = threading.Event(), False, 0

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        for number in range(self.count):
            if number == self.hold_at:
                self.go.wait(10.0)
            self.given = number + 1
            yield (
                Lost(number, "is damaged")
                if number == self.lost
                else Frame(number, 0.1 * number, np.zeros((2, 2, 3), np.uint8))
            )
        if self.fails:
            raise InputError("gone")

    def stop(self) -> None:
        self.stopped = True
        self.go.set()


def test_only_the_newest_frame_is_given_and_the_others_are_counted() -> None:
    source = Frames(5, hold_at=4)
    newest = NewestFrame(source)
    while source.given < 4:
        time.sleep(0.001)
    while newest.dropped < 3:
        time.sleep(0.001)
    taken = newest.take()
    assert taken is not None and taken.frame.number == 3 and newest.dropped == 3
    assert newest.take(0.01) is None and not newest.ended
    source.go.set()
    last = newest.take()
    assert last is not None and last.frame.number == 4
    assert newest.take() is None and newest.ended and newest.dropped == 3


def test_every_frame_is_waited_for_where_that_is_asked() -> None:
    newest = NewestFrame(Frames(20, lost=7), keep_all=True)
    numbers = []
    while (taken := newest.take()) is not None:
        numbers.append(taken.frame.number)
    assert numbers == [number for number in range(20) if number != 7]
    assert newest.dropped == 0 and newest.lost == 1


def test_frames_of_a_file_arrive_at_their_times() -> None:
    newest = NewestFrame(Frames(4), paced=True, keep_all=True)
    moments = []
    while (taken := newest.take()) is not None:
        moments.append(taken.arrived_s)
    assert all(step > 0.05 for step in np.diff(moments)) and len(moments) == 4


def test_what_the_source_raises_arrives_after_its_frames() -> None:
    newest = NewestFrame(Frames(1, fails=True), keep_all=True)
    assert newest.take() is not None
    with pytest.raises(InputError, match="gone"):
        newest.take()


def test_stopping_lets_go_of_a_source_that_waits() -> None:
    source = Frames(5, hold_at=2)
    newest = NewestFrame(source, keep_all=True)
    newest.take()
    newest.stop()
    assert (source.stopped and newest.ended) or newest.take(1.0) is not None
    assert not [thread for thread in threading.enumerate() if thread.name == "newest frame"]


def test_a_block_lets_go_of_the_source() -> None:
    source = Frames(5, hold_at=4)
    with NewestFrame(source) as newest:
        assert newest.take() is not None
    assert source.stopped
