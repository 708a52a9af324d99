"""The threads of a live session: they give work to processes, pass on the results, and end in time."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.studio.live import threads as live_threads
from mirrorcam.studio.live.status import LiveMeters, LiveStatus
from mirrorcam.studio.live.threads import DecodingThread, DepthThread, LiveWorker, SetupThread
from mirrorcam.studio.live.values import FrameResults, LivePictures, LiveRequest
from tests.core.processes.processes import ended
from tests.small_set import BOARD
from tests.studio.live.live_sets import frame, repeated, small, write_live_set

LONG_S = 60.0


def refuse(text: str) -> None:
    raise InputError(text)


class Worker(LiveWorker):
    """One whose work is a function of it."""

    def __init__(
        self, work: Callable[[Worker], object], fail: Callable[[str], None] = lambda line: None, *, at_once: bool = True
    ) -> None:
        super().__init__("tests", fail, at_once=at_once)
        self._function = work

    def _work(self) -> None:
        self._function(self)


def failing(function: Callable[..., object], *arguments: object) -> str:
    """What is said of work that makes one call which fails."""
    said: list[str] = []
    told = threading.Event()

    def on_note(line: str) -> None:
        said.append(line)
        told.set()

    worker = Worker(lambda worker: worker._process.call(function, *arguments), on_note)
    worker.start()
    assert told.wait(LONG_S)
    worker.close()
    (line,) = said
    return line


def test_work_that_fails_says_why_in_one_line() -> None:
    assert failing(refuse, "no such layer") == "no such layer"
    assert failing(os._exit, 3) == "the process for tests has ended with exit code 3"


@pytest.mark.parametrize("at_once", [True, False])
def test_closing_ends_work_that_waits_and_the_process(at_once: bool) -> None:
    said: list[str] = []
    pids: list[int] = []
    begun = threading.Event()

    def work(worker: Worker) -> None:
        pids.append(worker._process.call(os.getpid))
        begun.set()
        with worker._changed:
            worker._changed.wait_for(worker._ending.is_set)
        pids.append(-1)

    worker = Worker(work, said.append, at_once=at_once)
    worker.start()
    assert begun.wait(LONG_S)
    worker.close()
    assert ended(pids[0]) and pids[1:] == [-1] and said == []


@pytest.mark.parametrize("at_once", [True, False])
def test_closing_ends_a_call_at_once_or_after_a_time(monkeypatch: pytest.MonkeyPatch, at_once: bool) -> None:
    monkeypatch.setattr(live_threads, "ENDING_S", LONG_S if at_once else 0.2)
    said: list[str] = []
    pids: list[int] = []
    begun = threading.Event()

    def work(worker: Worker) -> None:
        pids.append(worker._process.call(os.getpid))
        begun.set()
        worker._process.call(time.sleep, 300.0)

    worker = Worker(work, said.append, at_once=at_once)
    worker.start()
    assert begun.wait(LONG_S)
    worker.close()
    assert ended(pids[0]) and said == []


def test_one_that_has_not_been_started_can_be_closed() -> None:
    worker = Worker(lambda worker: None)
    pid = worker._process.call(os.getpid)
    worker.close()
    assert ended(pid)


LONG_S, WIDTH_PX = 60.0, 80
FRAME = FrameResults(number=3, time_s=0.5, arrived_s=0.0, done_s=0.0, jpegs={})


@pytest.fixture
def layout(tmp_path: Path, default_layout: Layout) -> Path:
    small(default_layout).save(tmp_path / "layout.json")
    return tmp_path / "layout.json"


@pytest.fixture
def samples(layout: Path) -> NDArray[np.uint8]:
    device = Layout.load(layout)
    return np.asarray(Decoder(device, width_px=WIDTH_PX).decode(frame(device, 420.0)).samples, np.uint8)


@pytest.fixture
def idle(layout: Path) -> Iterator[DepthThread]:
    """One that has not been started."""
    thread = DepthThread(layout, WIDTH_PX, LivePictures(None), LiveMeters())
    yield thread
    thread.close()


def test_depth_is_put_as_a_picture_and_counted(layout: Path, samples: NDArray[np.uint8]) -> None:
    pictures, meters = LivePictures(None), LiveMeters()
    thread = DepthThread(layout, WIDTH_PX, pictures, meters)
    thread.start()
    try:
        thread.give(replace(FRAME, arrived_s=time.monotonic()), samples)
        found = pictures.wait_for("depth", 0, LONG_S)
    finally:
        thread.close()
    assert found is not None and found.depth_mm is not None and (found.frame, found.time_s) == (3, 0.5)
    assert meters.status.depth_median_mm == pytest.approx(420.0, rel=0.02) and meters.status.lines == ()


def test_samples_are_wanted_unless_some_wait(idle: DepthThread, samples: NDArray[np.uint8]) -> None:
    assert idle.wants_samples
    idle.give(FRAME, samples)
    assert not idle.wants_samples


def test_samples_that_nobody_looks_at_are_not_wanted(layout: Path) -> None:
    thread = DepthThread(layout, WIDTH_PX, LivePictures(0.1), LiveMeters())
    assert not thread.wants_samples
    thread.close()


def test_a_failure_is_reported_and_does_not_end_the_session(tmp_path: Path) -> None:
    meters = LiveMeters()
    thread = DepthThread(tmp_path / "none.json", WIDTH_PX, LivePictures(None), meters)
    thread.start()
    end = time.monotonic() + LONG_S
    while not meters.status.lines:
        assert time.monotonic() < end
        time.sleep(0.01)
    thread.close()
    assert "none.json" in meters.status.lines[0] and not meters.status.ended


def until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + LONG_S
    while not done():
        assert time.monotonic() < end
        time.sleep(0.02)


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


def test_frames_are_waited_for_while_aligning_is_on(thread: SetupThread, device: Layout) -> None:
    assert thread.aligning == "off"
    thread.align(True)
    waiting = thread.aligning
    thread.give_frames((frame(device)[..., 0],))
    measuring = thread.aligning
    thread.align(False)
    assert [waiting, measuring, thread.aligning] == ["waiting", "measuring", "off"]


@pytest.mark.slow
def test_a_report_and_a_hint_are_made_of_what_is_given(thread: SetupThread, device: Layout, tmp_path: Path) -> None:
    write_image(tmp_path / "a.png", frame(device))
    thread.align(True)
    thread.give_frames(tuple(frame(device, 400.0, shift)[..., 0] for shift in (0.0, 5.0)))
    thread.give_picture(tmp_path / "a.png")
    assert thread.report is None and thread.hint is None
    thread.start()
    until(lambda: thread.report is not None)
    assert thread.hint is not None and thread.hint.picture == "a.png"
    until(lambda: thread.aligning == "waiting")
    thread.align(False)
    assert thread.report is not None
    thread.align(True)
    assert thread.report is None


def test_a_picture_that_cannot_be_read_is_reported(thread: SetupThread, tmp_path: Path) -> None:
    meters = LiveMeters()
    other = SetupThread(tmp_path / "layout.json", tmp_path / "board.toml", meters)
    other.give_picture(tmp_path / "none.png")
    other.start()
    until(lambda: bool(meters.status.lines))
    other.close()
    assert "none.png" in meters.status.lines[0] and not meters.status.ended
    assert meters.status.failed_parts == {"setup": meters.status.lines[0]}


class Parts:
    """A decoding thread, and what it feeds, of which nothing else is started."""

    def __init__(self, layout: Path, source: Path, *, hold: bool = False) -> None:
        request = LiveRequest(layout, str(source), frame_width_px=160, view_width_px=60, depth_width_px=60)
        self.pictures, self.meters = LivePictures(None), LiveMeters()
        self.depth = DepthThread(layout, 60, self.pictures, self.meters)
        self.setup = SetupThread(layout, None, self.meters)
        self.decoding = DecodingThread(
            request, pictures=self.pictures, meters=self.meters, depth=self.depth, setup=self.setup, hold=hold
        )

    @property
    def status(self) -> LiveStatus:
        return replace(self.meters.status, recording=self.decoding.recording)

    def until(self, done: Callable[[LiveStatus], bool]) -> LiveStatus:
        end = time.monotonic() + LONG_S
        while not done(status := self.status):
            assert time.monotonic() < end, status
            time.sleep(0.01)
        return status


@pytest.fixture(scope="module")
def live_set(tmp_path_factory: pytest.TempPathFactory, default_layout: Layout) -> tuple[Path, Path]:
    """layout.json, and a video of half a minute."""
    folder = tmp_path_factory.mktemp("decoding")
    layout, video = write_live_set(folder, default_layout, frames=5)
    repeated(video, folder / "long.mkv", 150)
    return layout, folder / "long.mkv"


@pytest.fixture
def parts(live_set: tuple[Path, Path]) -> Iterator[Parts]:
    parts = Parts(*live_set)
    parts.decoding.open()
    parts.decoding.start()
    yield parts
    parts.decoding.close()


def test_frames_become_pictures_and_samples_for_depth_which_take_one_at_a_time(parts: Parts) -> None:
    assert parts.pictures.wait_for("refocus", 0, LONG_S) is not None
    parts.until(lambda status: status.frames > 3)
    assert parts.pictures.latest("views") is not None and not parts.depth.wants_samples
    parts.setup.align(True)
    parts.until(lambda status: parts.setup.aligning == "measuring")


def test_an_order_holds_from_the_next_frame_on(parts: Parts) -> None:
    parts.pictures.wait_for("views", 0, LONG_S)
    parts.decoding.order(kinds=("frame",))
    seen = parts.status.frames
    parts.until(lambda status: status.frames > seen + 3)
    views, frames = parts.pictures.latest("views"), parts.pictures.latest("frame")
    parts.until(lambda status: status.frames > seen + 6)
    assert parts.pictures.latest("views") is views and parts.pictures.latest("frame") is not frames


def test_pictures_taken_have_new_names_and_closing_finishes_the_recording(parts: Parts, tmp_path: Path) -> None:
    first = parts.decoding.take(tmp_path)
    parts.until(lambda status: status.pictures == 1)
    second = parts.decoding.take(tmp_path)
    parts.until(lambda status: status.pictures == 2)
    assert (first.name, second.name) == ("picture_0001.png", "picture_0002.png")
    assert read_image(second).shape == (270, 480, 3)
    parts.decoding.order(record=tmp_path / "a.mkv")
    parts.until(lambda status: status.recorded >= 2)
    parts.decoding.close()
    assert (tmp_path / "a.mkv").is_file() and parts.status.failed is None


def test_a_file_that_cannot_be_written_ends_what_it_was_for_alone(parts: Parts, tmp_path: Path) -> None:
    (tmp_path / "a.mkv").touch()
    parts.decoding.order(record=tmp_path / "a.mkv")
    status = parts.until(lambda status: bool(status.lines))
    assert "a.mkv" in status.lines[0]
    parts.until(lambda later: later.recording is None and later.frames > status.frames + 3)
    assert parts.status.failed is None and not parts.status.ended


@pytest.mark.slow
def test_a_recording_ends_with_its_source_and_so_does_what_was_not_taken_in_time(
    tmp_path: Path, default_layout: Layout
) -> None:
    layout, video = write_live_set(tmp_path, default_layout, frames=25)
    parts = Parts(layout, video, hold=True)
    parts.decoding.open()
    parts.decoding.order(record=tmp_path / "a.mkv")
    parts.decoding.start()
    parts.decoding.play(again=False)
    parts.until(lambda status: status.over and status.recording is None)
    parts.until(lambda status: any("a.mkv written" in line for line in status.lines))
    parts.decoding.take(tmp_path)
    parts.until(lambda status: any("before the calibration picture" in line for line in status.lines))
    shown = parts.status.frames
    parts.decoding.play(again=False)
    parts.decoding.play(again=True)
    parts.until(lambda status: status.over and status.frames > shown)
    assert parts.status.pictures == 0 and parts.status.failed is None
    parts.decoding.close()


def test_a_source_that_is_not_there_is_refused(live_set: tuple[Path, Path], tmp_path: Path) -> None:
    parts = Parts(live_set[0], tmp_path / "none.mkv")
    with pytest.raises(InputError, match=r"none\.mkv"):
        parts.decoding.open()
    parts.decoding.close()
