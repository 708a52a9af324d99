"""Cameras that run on: their newest frames, through outages, in constant memory; those left out are counted."""

from __future__ import annotations

import threading
import time
import tracemalloc
from collections.abc import Callable, Generator, Iterable

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.video.frames import READ_AHEAD, Frame, Lost, read_ahead
from mirrorcam.core.video.live_camera import ENDING_S, CameraPicture, Connection, LiveCamera

GREY = np.full((3, 4, 3), 7, np.uint8)


def numbered(number: int) -> CameraPicture:
    return CameraPicture(np.full((3, 4, 3), number, np.uint8))


def shows(*connections: Iterable[CameraPicture] | None) -> Callable[[], Connection]:
    """A camera that is there once for each of some runs of pictures, and not there at each None."""
    left = iter(connections)

    def connect() -> Connection:
        pictures = next(left, None)
        if pictures is None:
            raise InputError("camera 0 cannot be opened")
        return Connection(seen for seen in pictures)

    return connect


def forever(items: Iterable[CameraPicture], over: threading.Event) -> Generator[CameraPicture]:
    """Pictures, slowly enough for all to be used, and then none until the test is over."""
    for item in items:
        yield item
        time.sleep(0.02)
    over.wait(5)


def test_frames_are_numbered_and_timed_by_their_arrival() -> None:
    clock = iter(np.arange(100) / 10)
    over = threading.Event()
    camera = LiveCamera(
        "camera 0", shows(forever(map(numbered, range(3)), over)), 4, 3, clock=lambda: float(next(clock))
    )
    frames = camera.frames(after=6)
    found = [next(frames) for _ in range(3)]
    over.set()
    frames.close()
    assert [frame.number for frame in found] == [7, 8, 9]
    for frame, moment, grey in zip(found, (0.1, 0.2, 0.3), range(3), strict=True):
        assert isinstance(frame, Frame)
        assert frame.time_s == pytest.approx(moment)
        assert (frame.pixels == grey).all()
    assert abs(camera.started_ns - time.time_ns()) < 60e9


def test_times_are_as_far_apart_as_the_cameras_clock_says_and_never_go_back() -> None:
    stated = [5.0, 5.04, 5.08, 5.08, 0.5, 0.54]  # the clock stands still once, and starts anew
    arrived = iter([0.0, 0.01, 0.09, 0.10, 0.15, 9.0, 9.05])
    over = threading.Event()
    seen = [CameraPicture(GREY, each) for each in stated]
    camera = LiveCamera("camera 0", shows(forever(seen, over)), 4, 3, clock=lambda: next(arrived))
    frames = camera.frames()
    times = []
    for _ in stated:
        frame = next(frames)
        assert isinstance(frame, Frame)
        times.append(frame.time_s)
    over.set()
    frames.close()
    assert times[:3] == pytest.approx([0.01, 0.05, 0.09])
    assert times[4:] == pytest.approx([9.0, 9.04])
    assert (np.diff(times) > 0).all()


def times_of(stated: list[float], arrived: list[float]) -> list[float]:
    """The times of frames by the camera's clock and by ours; a camera is opened at 0 s."""
    clock, over = iter([0.0, *arrived]), threading.Event()
    seen = [CameraPicture(GREY, each) for each in stated]
    camera = LiveCamera("camera 0", shows(forever(seen, over)), 4, 3, clock=lambda: next(clock))
    frames = camera.frames()
    found = [next(frames) for _ in stated]
    over.set()
    frames.close()
    return [frame.time_s for frame in found if isinstance(frame, Frame)]


@pytest.mark.slow
def test_frames_that_arrive_at_once_or_late_keep_the_times_between_them() -> None:
    stated = np.arange(100) / 25
    at_once, late = np.full(100, 0.01), 1.5 * stated
    held_up = np.where(stated < 2, stated, np.maximum(stated, 3.5))
    for arrived in (at_once, late, held_up):
        np.testing.assert_allclose(np.diff(times_of(stated.tolist(), arrived.tolist())), 1 / 25, atol=1e-9)


def test_a_clock_that_jumps_is_followed_by_times_of_arrival() -> None:
    assert times_of([5.0, 5.04, 3600.0, 3600.04], [0.1, 0.14, 0.18, 0.22]) == pytest.approx([0.1, 0.14, 0.18, 0.22])
    assert times_of([5.0, 5.04, 0.0, 0.04], [0.1, 0.14, 7.0, 7.1]) == pytest.approx([0.1, 0.14, 7.0, 7.04])


def test_the_oldest_frames_are_left_out_and_counted_where_they_come_too_fast() -> None:
    used, shown = threading.Event(), threading.Event()

    def pictures() -> Generator[CameraPicture]:
        yield numbered(0)
        used.wait(5)
        yield from map(numbered, range(1, 100))
        shown.set()

    camera = LiveCamera("camera 0", shows(pictures()), 4, 3, retry_s=30)
    frames = camera.frames()
    first = next(frames)
    used.set()
    assert shown.wait(10)
    found = [first, *(next(frames) for _ in range(READ_AHEAD))]
    frames.close()
    assert [frame.number for frame in found[1:]] == [96, 97, 98, 99]
    assert camera.dropped == 100 - len(found)


def test_with_one_that_may_wait_the_newest_frame_is_given() -> None:
    used, shown = threading.Event(), threading.Event()

    def pictures() -> Generator[CameraPicture]:
        yield numbered(0)
        used.wait(5)
        yield from map(numbered, range(1, 30))
        shown.set()

    camera = LiveCamera("camera 0", lambda: Connection(pictures()), 4, 3, retry_s=30, buffered=1)
    frames = camera.frames()
    next(frames)
    used.set()
    assert shown.wait(10)
    assert next(frames).number == 29
    frames.close()


def test_a_camera_that_is_unplugged_and_comes_back_continues() -> None:
    over, lines = threading.Event(), list[str]()
    off = threading.Event()
    off.set()
    connect = shows(forever(map(numbered, range(3)), off), None, None, forever(map(numbered, range(3, 6)), over))
    camera = LiveCamera("camera 0", connect, 4, 3, on_note=lines.append, retry_s=0.02)
    frames = camera.frames()
    found = [next(frames) for _ in range(6)]
    over.set()
    frames.close()
    assert [frame.number for frame in found] == list(range(6))
    assert [int(frame.pixels[0, 0, 0]) for frame in found if isinstance(frame, Frame)] == list(range(6))
    assert camera.outages == 1
    assert lines[0] == "camera 0 gives no more pictures, waiting for it to come back"
    assert lines[1].startswith("camera 0 is back after ")


def test_who_stops_listening_ends_the_camera_also_while_it_is_away() -> None:
    closed = []

    def pictures() -> Generator[CameraPicture]:
        try:
            while True:
                yield CameraPicture(GREY)
                time.sleep(0.001)
        finally:
            closed.append(True)

    camera = LiveCamera("camera 0", lambda: Connection(pictures()), 4, 3)
    frames = camera.frames()
    next(frames)
    frames.close()
    assert closed == [True]
    gone = LiveCamera("camera 0", shows([CameraPicture(GREY)]), 4, 3, retry_s=0.01)
    frames = gone.frames()
    next(frames)
    time.sleep(0.1)
    frames.close()
    assert not [thread for thread in threading.enumerate() if thread.name == "camera"]


def test_a_reader_that_waits_for_a_camera_that_is_away_can_be_stopped() -> None:
    """As by Ctrl-C: the main thread closes what another thread waits in."""
    camera = LiveCamera("camera 0", shows([numbered(0)]), 4, 3, retry_s=30)
    ahead = read_ahead(read_ahead(camera.frames(), stop=camera.stop), stop=camera.stop)
    next(ahead)
    time.sleep(0.1)
    began = time.monotonic()
    ahead.close()
    assert time.monotonic() - began < 5
    assert not [thread for thread in threading.enumerate() if thread.name in ("camera", "read ahead")]


def test_a_camera_that_hangs_is_left_alone() -> None:
    over = threading.Event()

    def pictures() -> Generator[CameraPicture]:
        yield numbered(0)
        over.wait(20)

    camera = LiveCamera("camera 0", lambda: Connection(pictures()), 4, 3)
    frames = camera.frames()
    next(frames)
    began = time.monotonic()
    frames.close()
    assert time.monotonic() - began < ENDING_S + 2
    over.set()


def test_memory_does_not_grow_with_time() -> None:
    def pictures() -> Generator[CameraPicture]:
        for _ in range(3000):
            yield CameraPicture(np.zeros((100, 100, 3), np.uint8))

    camera = LiveCamera("camera 0", shows(*(pictures() for _ in range(4))), 100, 100, retry_s=0.001)
    frames = camera.frames()
    next(frames)
    tracemalloc.start()
    seen = 0
    while camera.outages < 3:
        next(frames)
        seen += 1
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    frames.close()
    # 12,000 pictures passed; those that wait, and some in the hands of threads, are all that is there.
    assert peak < (READ_AHEAD + 6) * 30_000 + 200_000


def test_all_frames_of_a_recording_are_given_from_time_0_on() -> None:
    seen = [CameraPicture(GREY, 1.4), CameraPicture(None), CameraPicture(GREY, 1.5)]
    camera = LiveCamera("a server", lambda: Connection((each for each in seen), ends=True), 4, 3)
    first, lost, last = camera.frames()
    assert camera.started_ns == 0
    assert isinstance(first, Frame)
    assert isinstance(last, Frame)
    assert first.time_s == 0.0
    assert last.time_s == pytest.approx(0.1)
    assert lost == Lost(1, "is damaged")


def test_what_is_not_as_expected_is_refused() -> None:
    with pytest.raises(InputError, match=r"^camera 0 cannot be opened$"):
        LiveCamera("camera 0", shows(), 4, 3)
    small = LiveCamera("camera 0", shows([CameraPicture(np.zeros((2, 2, 3), np.uint8))]), 4, 3)
    with pytest.raises(InputError, match=r"^camera 0 gives 2x2 px, expected 4x3 of the layout's camera$"):
        next(small.frames())
