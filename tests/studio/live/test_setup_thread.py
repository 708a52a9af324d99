"""Mirrors are compared while that is on, and calibration pictures go first."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import save_board
from mirrorcam.studio.live.setup_thread import SetupThread
from mirrorcam.studio.live.status import LiveMeters
from tests.small_set import BOARD
from tests.studio.live.live_sets import frame, small

LONG_S = 60.0


def until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + LONG_S
    while not done():
        assert time.monotonic() < end
        time.sleep(0.02)


def lines(meters: LiveMeters) -> tuple[str, ...]:
    return meters.status(alignment=None, hint=None, recording=None, calibration=None).lines


@pytest.fixture
def device(default_layout: Layout) -> Layout:
    return small(default_layout)


@pytest.fixture
def thread(tmp_path: Path, device: Layout) -> Iterator[SetupThread]:
    """One that has not been started."""
    device.save(tmp_path / "layout.json")
    save_board(tmp_path / "board.toml", BOARD)
    thread = SetupThread(tmp_path / "layout.json", tmp_path / "board.toml", LiveMeters())
    yield thread
    thread.close()


def test_frames_are_wanted_while_aligning_is_on_and_none_wait(thread: SetupThread, device: Layout) -> None:
    assert not thread.wants_frames and thread.aligning == "off"
    thread.align(True)
    assert thread.wants_frames and thread.aligning == "waiting"
    thread.give_frames((frame(device)[..., 0],))
    assert not thread.wants_frames
    assert thread.aligning == "measuring"
    thread.align(False)
    assert not thread.wants_frames and thread.aligning == "off"


def test_a_report_and_a_hint_are_made_of_what_is_given(thread: SetupThread, device: Layout, tmp_path: Path) -> None:
    write_image(tmp_path / "a.png", frame(device))
    thread.align(True)
    thread.give_frames(tuple(frame(device, 400.0, shift)[..., 0] for shift in (0.0, 5.0)))
    thread.give_picture(tmp_path / "a.png")
    assert thread.report is None and thread.hint is None
    thread.start()
    until(lambda: thread.report is not None)
    assert thread.hint is not None and thread.hint.picture == "a.png"
    until(lambda: thread.wants_frames)
    thread.align(False)
    assert thread.report is not None
    thread.align(True)
    assert thread.report is None


def test_a_picture_that_cannot_be_read_is_told(thread: SetupThread, tmp_path: Path) -> None:
    meters = LiveMeters()
    other = SetupThread(tmp_path / "layout.json", tmp_path / "board.toml", meters)
    other.give_picture(tmp_path / "none.png")
    other.start()
    until(lambda: bool(lines(meters)))
    other.close()
    assert "none.png" in lines(meters)[0] and not meters.ended
    failed = meters.status(alignment=None, hint=None, recording=None, calibration=None).failed_parts
    assert failed == {"setup": lines(meters)[0]}
