"""The engine: pictures of all kinds, orders, recordings, calibration pictures, and memory."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import simplejpeg

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.live.engine import LiveEngine
from mirrorcam.studio.live.status import LiveStatus
from mirrorcam.studio.live.values import LiveRequest
from tests.small_set import BOARD
from tests.studio.live.live_sets import frame, repeated, small, write_live_set

FLAT_MB = 30.0
LONG_S = 60.0


@pytest.fixture(scope="module")
def live_set(tmp_path_factory: pytest.TempPathFactory, default_layout: Layout) -> tuple[Path, Path]:
    """layout.json, and a video of 45 s: longer than numba may take to compile."""
    folder = tmp_path_factory.mktemp("live")
    layout, video = write_live_set(folder, default_layout, frames=25)
    repeated(video, folder / "long.mkv", 45)
    return layout, folder / "long.mkv"


@pytest.fixture
def engine(live_set: tuple[Path, Path], tmp_path: Path) -> Iterator[LiveEngine]:
    save_board(tmp_path / "board.toml", BOARD)
    layout, video = live_set
    request = LiveRequest(layout, str(video), frame_width_px=240, view_width_px=100, depth_width_px=80)
    with LiveEngine(request, out=tmp_path / "out", board=tmp_path / "board.toml") as engine:
        yield engine


def until(engine: LiveEngine, done: Callable[[LiveStatus], bool]) -> LiveStatus:
    """The status once it is so."""
    end = time.monotonic() + LONG_S
    while not done(status := engine.status()):
        assert status.failed is None and time.monotonic() < end, status
        time.sleep(0.02)
    return status


def four_more(engine: LiveEngine) -> None:
    """Wait for four frames, and all that was ordered before."""
    already = engine.status().frames
    until(engine, lambda status: status.frames > already + 4)


@pytest.mark.slow
def test_pictures_of_all_kinds_arrive_and_go_on(engine: LiveEngine) -> None:
    for kind in ("frame", "views", "refocus", "depth"):
        picture = engine.wait_for(kind, 0, LONG_S)
        assert picture is not None
        height, width = simplejpeg.decode_jpeg(picture.jpeg).shape[:2]
        assert (width, height) == engine.about.sizes_px[kind]
        following = engine.wait_for(kind, picture.serial, LONG_S)
        assert following is not None and following.serial > picture.serial and following.frame > picture.frame
        assert (following.depth_mm is not None) == (kind == "depth")
    status = until(engine, lambda status: status.depth_hz > 0.0 and status.rate_hz > 0.0)
    assert status.latency_ms is not None and status.latency_p95_ms is not None and status.exposure is not None
    assert 0.0 < status.latency_ms <= status.latency_p95_ms and len(status.sharpness) == 9
    assert status.memory_mb > 10.0 and status.outages == 0


def test_focus_changes_at_any_time_and_bad_ones_are_refused(engine: LiveEngine) -> None:
    first = engine.wait_for("refocus", 0, LONG_S)
    engine.focus(250.0)
    assert first is not None and engine.wait_for("refocus", first.serial + 1, LONG_S) is not None
    with pytest.raises(InputError, match="expected a depth beyond the views"):
        engine.focus(-500.0)
    with pytest.raises(InputError, match="focus at nan mm"):
        engine.focus(float("nan"))


@pytest.mark.slow
def test_pictures_that_nobody_waits_for_are_no_longer_made(live_set: tuple[Path, Path], tmp_path: Path) -> None:
    request = LiveRequest(live_set[0], str(live_set[1]), frame_width_px=240, view_width_px=100, depth_width_px=80)
    with LiveEngine(request, out=tmp_path, idle_s=0.5) as engine:
        four_more(engine)
        assert engine.latest("views") is None
        assert engine.wait_for("views", 0, LONG_S) is not None and engine.latest("frame") is None
        time.sleep(0.6)
        four_more(engine)
        last = engine.latest("views")
        four_more(engine)
        assert last is not None and engine.latest("views") is last
        assert engine.wait_for("views", last.serial, LONG_S) is not None


@pytest.mark.slow
def test_recording_and_pictures_are_files_of_new_names(engine: LiveEngine) -> None:
    path = engine.record()
    until(engine, lambda status: status.recorded >= 5)
    engine.stop_recording()
    until(engine, lambda status: bool(status.lines))
    assert path.name == "recording_0001.mkv" and len(list(Video(path).frames())) >= 5
    assert json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))["recorded"] >= 5
    assert engine.record().name == "recording_0002.mkv"
    taken = engine.take_picture()
    status = until(engine, lambda status: status.pictures == 1 and status.hint is not None)
    assert read_image(taken).shape == (270, 480, 3) and taken.name == "picture_0001.png"
    assert status.hint is not None and status.hint.picture == taken.name and status.hint.sentence.startswith("next: ")


@pytest.mark.slow
def test_the_mirrors_are_compared_with_the_layout_while_that_is_on(engine: LiveEngine) -> None:
    assert engine.status().alignment is None
    engine.align(True)
    report = until(engine, lambda status: status.alignment is not None).alignment
    assert report is not None and len(report.edges) == 9
    engine.align(False)
    outlines = engine.outlines_px()
    assert list(outlines) == list(report.names)
    assert all(len(outline) > 8 for outline in outlines.values())


@pytest.mark.slow
def test_a_video_waits_for_its_beginning_and_plays_again_once_it_has_ended(
    default_layout: Layout, tmp_path: Path
) -> None:
    layout, video = write_live_set(tmp_path, default_layout)
    request = LiveRequest(
        layout, str(video), frame_width_px=240, view_width_px=100, depth_width_px=80, every_frame=True
    )
    with LiveEngine(request, out=tmp_path / "out", hold=True) as engine:
        assert engine.wait_for("frame", 0, 2.0) is None and engine.status().frames == 0
        with pytest.raises(InputError, match="expected a source that has ended"):
            engine.play_again()
        engine.begin()
        engine.begin()
        assert until(engine, lambda status: status.over).frames == 12
        last = engine.wait_for("frame", 0, LONG_S)
        with pytest.raises(InputError, match="has ended"):
            engine.record()
        engine.play_again()
        assert until(engine, lambda status: status.over and status.frames > 12).frames == 24
        again = engine.wait_for("frame", 0, LONG_S)
        assert last is not None and again is not None
        assert again.frame == last.frame == 11 and again.jpeg == last.jpeg and again.serial == 2 * last.serial


def test_what_cannot_be_opened_is_refused_and_leaves_no_process(live_set: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        LiveEngine(LiveRequest(live_set[0], "nowhere.mp4"), out=tmp_path)
    engine = LiveEngine(LiveRequest(live_set[0], str(live_set[1])), out=tmp_path)
    with engine, pytest.raises(InputError, match="no board is stated"):
        engine.take_picture()
    engine.close()


def test_a_failing_source_is_reported(default_layout: Layout, tmp_path: Path) -> None:
    layout = small(default_layout)
    layout.save(tmp_path / "layout.json")
    (tmp_path / "frames").mkdir()
    write_image(tmp_path / "frames" / "0.png", frame(layout))
    write_image(tmp_path / "frames" / "1.png", np.zeros((20, 30, 3), np.uint8))
    with LiveEngine(LiveRequest(tmp_path / "layout.json", str(tmp_path / "frames")), out=tmp_path) as engine:
        end = time.monotonic() + LONG_S
        while engine.status().failed is None and time.monotonic() < end:
            time.sleep(0.02)
        assert "30x20 px, expected 480x270" in (engine.status().failed or "")


@pytest.mark.slow
def test_memory_stays_flat_over_ten_thousand_frames(live_set: tuple[Path, Path], tmp_path: Path) -> None:
    repeated(live_set[1], tmp_path / "hour.mkv", 9)
    request = LiveRequest(
        live_set[0],
        str(tmp_path / "hour.mkv"),
        frame_width_px=160,
        view_width_px=60,
        depth_width_px=60,
        every_frame=True,
    )
    held: list[float] = []
    with LiveEngine(request, out=tmp_path) as engine:
        while not (status := engine.status()).over:
            assert status.failed is None
            if status.frames > 1000:
                held.append(status.memory_mb)
            time.sleep(0.1)
    assert status.frames >= 10_000 and status.dropped == 0
    quarter = len(held) // 4
    assert np.median(held[-quarter:]) < np.median(held[:quarter]) + FLAT_MB
