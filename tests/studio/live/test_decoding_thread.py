"""Frames are decoded as ordered, and what becomes of them goes where it is wanted."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.live.decoding_thread import DecodingThread
from mirrorcam.studio.live.depth_thread import DepthThread
from mirrorcam.studio.live.pictures import LivePictures
from mirrorcam.studio.live.setup_thread import SetupThread
from mirrorcam.studio.live.status import LiveMeters, LiveStatus
from mirrorcam.studio.live.values import LiveRequest
from tests.studio.live.live_sets import repeated, write_live_set

LONG_S = 60.0


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
        return self.meters.status(alignment=None, hint=None, recording=self.decoding.recording, calibration=None)

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
    parts.until(lambda status: not parts.setup.wants_frames)


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
    parts.until(lambda status: status.recording is not None and status.recording[1] >= 2)
    parts.decoding.close()
    assert (tmp_path / "a.mkv").is_file() and parts.status.failed is None


def test_a_file_that_cannot_be_written_ends_what_it_was_for_alone(parts: Parts, tmp_path: Path) -> None:
    (tmp_path / "a.mkv").touch()
    parts.decoding.order(record=tmp_path / "a.mkv")
    status = parts.until(lambda status: bool(status.lines))
    assert "a.mkv" in status.lines[0]
    parts.until(lambda later: later.recording is None and later.frames > status.frames + 3)
    assert parts.status.failed is None and not parts.meters.ended


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
