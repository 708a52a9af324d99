"""What is asked for by default."""

from __future__ import annotations

import pickle
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.studio.live.values import DECODED, FrameResults, LivePictures, LiveRequest, Orders


def test_orders_and_requests_pass_between_processes() -> None:
    orders = Orders(focus_mm=300.0, take=Path("a.png"))
    request = LiveRequest(Path("layout.json"), "0")
    assert pickle.loads(pickle.dumps((orders, request))) == (orders, request)


def test_by_default_all_pictures_of_a_frame_are_made_and_nothing_is_written() -> None:
    orders = Orders()
    assert orders.kinds == DECODED and "depth" not in DECODED
    assert orders.record is None and orders.take is None and not orders.frames


LONG_S = 60.0


def shown(number: int) -> FrameResults:
    return FrameResults(number=number, time_s=0.1 * number, arrived_s=0.0, done_s=0.0, jpegs={})


def test_pictures_are_counted_in_their_kind_and_the_newest_is_kept() -> None:
    pictures, depth_mm = LivePictures(None), np.ones((2, 3), np.uint16)
    assert pictures.latest("views") is None and pictures.wait_for("views", 0, 0.01) is None
    for number in (4, 7):
        pictures.put("views", shown(number), b"views %d" % number)
    pictures.put("depth", shown(5), b"depth", depth_mm)
    views, depth = pictures.latest("views"), pictures.wait_for("depth", 0, LONG_S)
    assert views is not None and (views.serial, views.frame, views.jpeg, views.depth_mm) == (2, 7, b"views 7", None)
    assert depth is not None and (depth.serial, depth.frame, depth.time_s) == (1, 5, 0.5) and depth.depth_mm is depth_mm
    assert pictures.wait_for("views", 1, LONG_S) is views and pictures.wait_for("views", 2, 0.01) is None


@pytest.mark.parametrize("comes", [True, False])
def test_waiting_ends_with_the_next_picture_or_at_the_end(comes: bool) -> None:
    pictures = LivePictures(None)
    pictures.put("frame", shown(0), b"0")
    found: list[int | None] = []

    def wait() -> None:
        picture = pictures.wait_for("frame", 1, LONG_S)
        found.append(None if picture is None else picture.serial)

    waiting = threading.Thread(target=wait)
    waiting.start()
    if comes:
        pictures.put("frame", shown(1), b"1")
    else:
        pictures.end()
    waiting.join(LONG_S / 2)
    assert not waiting.is_alive() and found == [2 if comes else None]


def test_a_kind_is_wanted_while_someone_waits_and_for_a_time_after(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    always, pictures = LivePictures(None), LivePictures(2.0)
    pictures.put("views", shown(0), b"0")
    assert always.wanted("views") and not pictures.wanted("views")
    pictures.wait_for("views", 0, 0.5)
    assert pictures.wanted("views") and not pictures.wanted("frame")
    now += 1.9
    assert pictures.wanted("views")
    now += 0.2
    assert not pictures.wanted("views") and always.wanted("views")


def test_a_kind_is_wanted_as_long_as_someone_waits() -> None:
    pictures = LivePictures(0.001)
    waiting = threading.Thread(target=pictures.wait_for, args=("views", 0, LONG_S))
    waiting.start()
    end = time.monotonic() + LONG_S / 2
    while not pictures.wanted("views"):
        assert time.monotonic() < end
        time.sleep(0.01)
    time.sleep(0.05)
    assert pictures.wanted("views")
    pictures.end()
    waiting.join()
