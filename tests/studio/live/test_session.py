"""Frames become pictures, meters and files."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import simplejpeg

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.live_camera import CameraPicture, Connection, LiveCamera
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.live import session as live_session
from mirrorcam.studio.live.session import LiveSession
from mirrorcam.studio.live.streams import LiveSource
from mirrorcam.studio.live.values import LiveRequest, Orders
from tests.studio.live.live_sets import HEIGHT_PX, WIDTH_PX, write_live_set


@pytest.fixture(scope="module")
def request_(tmp_path_factory: pytest.TempPathFactory, default_layout: Layout) -> LiveRequest:
    layout, video = write_live_set(tmp_path_factory.mktemp("live"), default_layout)
    return LiveRequest(layout, str(video), frame_width_px=240, view_width_px=100, depth_width_px=80, every_frame=True)


@pytest.fixture
def session(request_: LiveRequest) -> Iterator[LiveSession]:
    session = LiveSession(request_)
    yield session
    session.close()


def test_pictures_have_the_sizes_that_the_session_states(session: LiveSession) -> None:
    about, shown = session.about(), session.next(Orders(depth=True)).results
    assert about.kind == "video" and about.grid == (3, 3) and about.camera_px == (WIDTH_PX, HEIGHT_PX)
    assert shown is not None and set(shown.jpegs) == {"frame", "views", "refocus"}
    for kind, jpeg in shown.jpegs.items():
        height, width = simplejpeg.decode_jpeg(jpeg).shape[:2]
        assert (width, height) == about.sizes_px[kind]
    assert shown.samples is not None and shown.samples.shape[2:4] == about.sizes_px["depth"][::-1]
    assert about.near_mm < about.reference_mm < about.far_mm
    assert shown.done_s >= shown.arrived_s


def test_the_source_ends_after_every_frame(session: LiveSession) -> None:
    numbers = []
    while not (answer := session.next(Orders(kinds=()))).ended or answer.results is not None:
        assert answer.results is not None and answer.results.jpegs == {}
        numbers.append(answer.results.number)
        if answer.ended:
            break
    assert numbers == list(range(12)) and answer.dropped == 0 and answer.lost == 0


def test_a_video_waits_for_its_orders_and_plays_as_often_as_they_say(session: LiveSession) -> None:
    waiting = session.next(Orders(plays=0))
    assert waiting.results is None and not waiting.ended
    numbers = []
    for plays in (1, 2):
        over = False
        while not over:
            answer = session.next(Orders(kinds=(), plays=plays))
            over = answer.ended
            numbers += [] if answer.results is None else [answer.results.number]
    assert numbers == 2 * list(range(12))


def test_an_order_to_play_again_before_the_end_changes_nothing(session: LiveSession) -> None:
    numbers = []
    for plays in (1, 1, 2, 3):
        shown = session.next(Orders(kinds=(), plays=plays)).results
        assert shown is not None
        numbers.append(shown.number)
    assert numbers == [0, 1, 2, 3]


def test_the_last_frame_becomes_what_is_ordered_after_the_end_once(session: LiveSession) -> None:
    while not session.next(Orders(kinds=("frame",))).ended:
        pass
    orders = Orders(kinds=("frame", "views", "refocus"), depth=True)
    shown = session.next(orders).results
    assert shown is not None and shown.repeated and shown.number == 11
    assert set(shown.jpegs) == {"views", "refocus"} and shown.samples is not None
    assert session.next(orders).results is None
    focused = session.next(replace(orders, focus_mm=230.0)).results
    assert focused is not None and set(focused.jpegs) == {"refocus"} and focused.samples is None
    assert focused.jpegs["refocus"] != shown.jpegs["refocus"]


def test_the_focus_changes_the_refocused_picture_alone(request_: LiveRequest) -> None:
    found = []
    for focus in (None, 400.0, 230.0):
        session = LiveSession(request_)
        shown = session.next(Orders(focus_mm=focus)).results
        session.close()
        assert shown is not None
        found.append(shown.jpegs)
    assert found[0]["views"] == found[1]["views"] == found[2]["views"]
    # The texture is at 400 mm: there it has most detail.
    detail = [float(np.std(simplejpeg.decode_jpeg(each["refocus"]).astype(float))) for each in found]
    assert detail[1] > detail[2]


def test_meters_and_frames_for_the_alignment(session: LiveSession) -> None:
    shown = session.next(Orders(frames=True)).results
    assert shown is not None and shown.sharpness is not None and shown.exposure is not None
    assert len(shown.sharpness) == 9
    assert [each.shape for each in shown.frames] == [(HEIGHT_PX, WIDTH_PX)]
    following = session.next(Orders()).results
    assert following is not None and following.frames == ()


def test_a_calibration_picture_is_the_frame_itself(session: LiveSession, tmp_path: Path, request_: LiveRequest) -> None:
    path = tmp_path / "pictures" / "a.png"
    shown = session.next(Orders(take=path)).results
    assert shown is not None and shown.taken == path
    first = next(iter(Video(Path(request_.source)).frames()))
    assert isinstance(first, Frame) and np.array_equal(read_image(path), first.pixels)
    with pytest.raises(InputError, match="exists"):
        session.next(Orders(take=path))


def test_a_recording_has_the_frames_that_arrive_while_it_is_on(session: LiveSession, tmp_path: Path) -> None:
    path, orders = tmp_path / "a.mkv", Orders(kinds=())
    session.next(orders)
    for _ in range(5):
        answer = session.next(replace(orders, record=path))
    assert answer.not_recorded == 0 and not path.exists()
    lines: tuple[str, ...] = ()
    while not lines:
        lines = session.next(replace(orders, timeout_s=0.01)).lines
    assert path.is_file() and f"{path} written" in lines[0]
    # A frame is ready, and the next one waits, when the first of five is taken and the last.
    assert 3 <= len(list(Video(path).frames())) <= 6


@pytest.mark.slow
def test_a_camera_is_recorded_at_its_rate_however_slow_pictures_are(
    request_: LiveRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shown = [each.pixels for each in Video(Path(request_.source)).frames() if isinstance(each, Frame)]

    def pictures() -> Generator[CameraPicture]:
        began = time.monotonic()
        for number in range(90):
            time.sleep(max(began + number / 60.0 - time.monotonic(), 0.0))
            yield CameraPicture(shown[number % len(shown)], number / 60.0)
        time.sleep(60.0)

    def opened(text: str, wanted: Camera, on_note: Callable[[str], None]) -> LiveSource:
        camera = LiveCamera("camera 0", lambda: Connection(pictures()), WIDTH_PX, HEIGHT_PX, on_note=on_note)
        return LiveSource(camera, "camera 0", "camera")

    monkeypatch.setattr(live_session, "open_source", opened)
    session = LiveSession(replace(request_, source="0", every_frame=False))
    path, decoded = tmp_path / "a.mkv", 0
    while (answer := session.next(Orders(kinds=("frame",), record=path, timeout_s=0.5))).results is not None:
        decoded += 1
        time.sleep(0.15)
    lines = session.close()
    recorded = [item for item in Video(path).frames() if isinstance(item, Frame)]
    # Those before the first order are not recorded; all others are.
    assert decoded < 20 and len(recorded) >= 85 and answer.not_recorded == 0
    assert any(line.endswith(f"a.mkv written: {len(recorded)} frames") for line in lines)
    assert [item.time_s for item in recorded] == pytest.approx([k / 60.0 for k in range(len(recorded))], abs=0.002)


def test_closing_finishes_the_recording(request_: LiveRequest, tmp_path: Path) -> None:
    session = LiveSession(request_)
    session.next(Orders(kinds=(), record=tmp_path / "a.mkv"))
    session.close()
    assert (tmp_path / "a.mkv").is_file()


def test_a_camera_that_goes_is_waited_for_and_counted(request_: LiveRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera that gives two frames, is gone, and comes back."""
    shown = [each.pixels for each in Video(Path(request_.source)).frames() if isinstance(each, Frame)]
    attempts = 0

    def connect() -> Connection:
        nonlocal attempts
        attempts += 1
        if attempts == 2:
            raise InputError("not there")

        def pictures() -> Generator[CameraPicture]:
            for pixels in shown[:2]:
                yield CameraPicture(pixels)

        return Connection(pictures())

    def opened(text: str, wanted: Camera, on_note: Callable[[str], None]) -> LiveSource:
        camera = LiveCamera("camera 0", connect, WIDTH_PX, HEIGHT_PX, on_note=on_note, retry_s=0.02, buffered=1)
        return LiveSource(camera, "camera 0", "camera")

    monkeypatch.setattr(live_session, "open_source", opened)
    session, lines = LiveSession(replace(request_, source="0")), list[str]()
    end, answer = time.monotonic() + 30.0, session.next(Orders(kinds=()))
    while answer.outages < 2 and time.monotonic() < end:
        lines += answer.lines
        answer = session.next(Orders(kinds=(), timeout_s=0.2))
    session.close()
    assert answer.outages >= 2 and not answer.ended
    assert any("gives no more pictures" in line for line in lines) and any("is back" in line for line in lines)


def test_memory_is_that_of_the_process() -> None:
    assert 10.0 < live_session.resident_mb() < 10_000.0
