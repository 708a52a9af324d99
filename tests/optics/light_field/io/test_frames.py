"""Frames of cameras, and reading ahead: all of them, in order."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.frames import AHEAD, PATIENCE, CaptureDevice, Frame, Lost, read_ahead
from tests.optics.light_field.io.videos import pictures


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


class Camera:
    """What cv2.VideoCapture is to `CaptureDevice`: pictures in BGR, None for one that it fails to give."""

    def __init__(self, given: list[NDArray[np.uint8] | None], opened: bool = True) -> None:
        self.given, self.opened, self.released = iter(given), opened, False
        self.asked: dict[int, float] = {}

    def __call__(self, number: int) -> Camera:
        return self

    def isOpened(self) -> bool:  # noqa: N802  # OpenCV's name
        return self.opened

    def set(self, what: int, value: float) -> bool:
        self.asked[what] = value
        return True

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        picture = next(self.given, None)
        return picture is not None, picture

    def release(self) -> None:
        self.released = True


def test_a_camera_gives_frames_until_nobody_asks(tmp_path: Path) -> None:
    shown = pictures(3)
    camera = Camera([shown[0][..., ::-1], None, shown[1][..., ::-1], shown[2][..., ::-1]])
    clock = iter(np.arange(100) / 30)
    frames = CaptureDevice(0, 160, 96, capture=camera, clock=lambda: float(next(clock))).frames()
    found = [next(frames) for _ in range(4)]
    assert found[1] == Lost(1, "was not given by the camera")
    for item, number, picture in zip([found[0], found[2], found[3]], [0, 2, 3], shown, strict=True):
        assert isinstance(item, Frame)
        assert item.number == number
        assert item.time_s == pytest.approx((number + 1) / 30)
        assert np.array_equal(item.pixels, picture)
    assert (camera.asked[cv2.CAP_PROP_FRAME_WIDTH], camera.asked[cv2.CAP_PROP_FRAME_HEIGHT]) == (160, 96)
    frames.close()
    assert camera.released


def test_a_camera_that_cannot_be_used_is_refused() -> None:
    with pytest.raises(InputError, match=r"^camera 3 cannot be opened, expected one on this machine \(/dev/video3\)$"):
        CaptureDevice(3, 160, 96, capture=Camera([], opened=False))
    small = Camera([np.zeros((48, 80, 3), np.uint8)])
    with pytest.raises(InputError, match=r"^camera 0 gives 80x48 px, expected 160x96 of the layout's camera$"):
        list(CaptureDevice(0, 160, 96, capture=small).frames())
    assert small.released
    gone = Camera([np.zeros((96, 160, 3), np.uint8)])
    found: list[Frame | Lost] = []
    with pytest.raises(InputError, match=rf"^camera 0 gave no picture {PATIENCE} times in a row"):
        for item in CaptureDevice(0, 160, 96, capture=gone).frames():
            found.append(item)  # noqa: PERF402  # what came before the error
    assert [type(item) for item in found] == [Frame, *[Lost] * PATIENCE]
