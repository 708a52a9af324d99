"""Videos and cameras become ROS 2 bags: each frame at its own time, whole or not at all."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.calibration.drift_check import drift_check
from mirrorcam.core.console.reporter import TERMINAL
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.live_camera import CameraPicture, Connection, LiveCamera
from mirrorcam.core.video.video import Video
from mirrorcam.lightfield import decoding
from mirrorcam.lightfield.decoding import decode_files
from mirrorcam.lightfield.requests import DecodeRequest
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, VideoDepth
from mirrorcam.optics.light_field.io.formats.mcap import StoredBag
from mirrorcam.optics.light_field.light_field import LightField
from tests.command_line import results
from tests.core.video.videos import RATE, damage, pictures, write_h264, write_mjpeg
from tests.optics.layouts import faceted_parabola
from tests.optics.light_field.io.bags import needs_rosbags

pytestmark = needs_rosbags
COUNT = 6


@pytest.fixture(scope="module")
def layout() -> Layout:
    camera = Camera(width_px=320, height_px=192, fx_px=230.0, fy_px=230.0, cx_px=159.5, cy_px=95.5)
    return faceted_parabola(camera, DesignSpec(camera=camera), fill=0.9).replaced(kind="calibrated")


@pytest.fixture
def here(tmp_path: Path, layout: Layout, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with layout.json and video.avi, in which commands run."""
    layout.save(tmp_path / "layout.json")
    write_mjpeg(tmp_path / "video.avi", pictures(COUNT, 320, 192))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def decoded(*frames: str, **settings: Any) -> int:
    """Decode into a bag of the folder."""
    request, paths = DecodeRequest(to="mcap", **settings), tuple(map(Path, frames))
    return decode_files(paths, Path(), request, TERMINAL, layout=Path("layout.json"), make_check=drift_check)


def topics(path: Path) -> dict[str, int]:
    """Number of messages on each topic."""
    from rosbags.rosbag2 import Reader

    with Reader(path) as reader:
        return {each.topic: each.msgcount for each in reader.connections}


def test_a_video_becomes_a_bag_with_the_times_of_its_frames(here: Path, layout: Layout) -> None:
    assert decoded("video.avi") == 0
    assert results(here) == ["layout.json", "video.avi", "video.mcap", "video_drift.json"]
    counts = topics(here / "video.mcap")
    assert {counts.pop(name) for name in ("/tf_static", "/mirrorcam/views", "/mirrorcam/weights")} == {1}
    assert len(counts) == 21
    assert set(counts.values()) == {COUNT}
    stored, decoder = StoredBag(here / "video.mcap"), Decoder(layout)
    assert stored.stamps_ns == tuple(round(number * 1e9 / RATE) for number in range(COUNT))
    for found, frame in zip(stored, Video(here / "video.avi").frames(), strict=True):
        assert isinstance(frame, Frame)
        assert np.array_equal(found.samples, decoder.decode(frame.pixels).samples)
        assert found.layout_identity == layout.identity


def test_depth_of_a_bag_is_that_of_a_video(here: Path, layout: Layout, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[DepthMap] = []

    class Kept(VideoDepth):
        def estimate(self, light_field: LightField) -> DepthMap:
            found.append(super().estimate(light_field))
            return found[-1]

    monkeypatch.setattr("mirrorcam.robot.bag_recording.VideoDepth", Kept)
    assert decoded("video.avi", limit=3) == 0
    decoder = Decoder(layout)
    read = islice(Video(here / "video.avi").frames(), 3)
    frames = [decoder.decode(each.pixels) for each in read if isinstance(each, Frame)]
    expected = VideoDepth(DepthEstimator(frames[0], quality="fast"))
    for depth, frame in zip(found, frames, strict=True):
        assert np.array_equal(depth.depth_mm, expected.estimate(frame).depth_mm, equal_nan=True)


def test_without_depth_a_bag_holds_views_only(here: Path) -> None:
    assert decoded("video.avi", no_depth=True, limit=2) == 0
    counts = topics(here / "video.mcap")
    assert "/mirrorcam/points" not in counts
    assert counts["/mirrorcam/view_0_0/image_rect"] == 2


def test_lost_frames_leave_a_gap_in_time_and_are_counted(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damage(here / "video.avi", 2)
    assert decoded("video.avi", no_depth=True) == 1
    assert StoredBag(here / "video.mcap").stamps_ns == tuple(n * 40_000_000 for n in (0, 1, 3, 4, 5))
    printed = capsys.readouterr().out
    assert "video: skipped 1 of 6 frames, each is damaged: 2" in printed
    assert "video.mcap written: 5 frames" in printed


def test_what_cannot_become_a_bag_is_refused_before_anything_is_written(here: Path) -> None:
    write_image(here / "a.png", pictures(1, 320, 192)[0])
    write_h264(here / "other.mp4", pictures(2, 320, 192))
    (here / "video.mcap").write_text("mine", encoding="utf-8")
    before = sorted(here.rglob("*"))
    for frames, message in (
        (("video.avi",), r"video\.mcap: exists, and recordings are never replaced; expected another --out"),
        (("a.png",), r"expected one video or --live, because pictures have no times"),
        (("video.avi", "other.mp4"), r"expected one video or --live"),
    ):
        with pytest.raises(InputError, match=message):
            decoded(*frames)
        assert sorted(here.rglob("*")) == before


def test_a_video_without_a_good_frame_leaves_no_bag(here: Path) -> None:
    write_mjpeg(here / "bad.avi", pictures(1, 320, 192))
    damage(here / "bad.avi", 0)
    with pytest.raises(InputError, match="bad: no frame could be decoded, expected at least one"):
        decoded("bad.avi")
    assert results(here) == ["bad.avi", "layout.json", "video.avi"]


def interrupted_after(count: int) -> Generator[CameraPicture]:
    """Pictures of a camera, 25 a second; then Ctrl-C is pressed."""
    for number, picture in enumerate(pictures(count, 320, 192)):
        yield CameraPicture(picture, number / RATE)
        threading.Event().wait(0.05)
    raise KeyboardInterrupt


def test_a_camera_is_recorded_until_ctrl_c_in_a_complete_bag(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = LiveCamera("camera 0", lambda: Connection(interrupted_after(4)), 320, 192)
    monkeypatch.setattr(decoding, "open_camera", lambda *_, **__: device)
    with pytest.raises(KeyboardInterrupt):
        decoded(live="0", no_depth=True)
    stored = StoredBag(here / "device0.mcap")
    assert len(stored) == 4
    assert np.array_equal(np.diff(stored.stamps_ns), [40_000_000] * 3)
    assert abs(stored.stamps_ns[0] - device.started_ns) < 10 * 10**9


def test_a_video_that_is_interrupted_leaves_no_bag(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Decoder.decode
    done = iter(range(COUNT))

    def decode(self: Decoder, frame: Any) -> Any:
        if next(done) == 3:
            raise KeyboardInterrupt
        return whole(self, frame)

    monkeypatch.setattr(Decoder, "decode", decode)
    with pytest.raises(KeyboardInterrupt):
        decoded("video.avi", no_depth=True)
    assert results(here) == ["layout.json", "video.avi"]


@pytest.mark.slow
def test_ctrl_c_keeps_the_bag_of_a_camera_that_is_away(here: Path) -> None:
    write_mjpeg(here / "a.mjpeg", pictures(8, 320, 192))
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        arguments = f"decode --live {address} --layout layout.json --to mcap --no-depth --out .".split()
        process = subprocess.Popen(
            [sys.executable, "-m", "mirrorcam", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        server.settimeout(60)
        connection, _ = server.accept()
        with connection:
            connection.sendall((here / "a.mjpeg").read_bytes())
    assert process.stdout is not None
    said = ""
    while "gives no more pictures, waiting" not in said:
        line = process.stdout.readline()
        assert line, said
        said += line
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    more, complaint = process.communicate(timeout=20)
    assert process.returncode == 130, complaint
    assert "stream.mcap written: " in more
    assert len(StoredBag(here / "stream.mcap")) >= 4


@pytest.mark.slow
def test_ctrl_c_leaves_no_bag_of_a_video_and_no_other_file(here: Path) -> None:
    write_mjpeg(here / "long.avi", pictures(40, 320, 192) * 40)
    arguments = ["-m", "mirrorcam", "decode", "long.avi", "--layout", "layout.json", "--to", "mcap", "--out", "."]
    process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not any(path.stat().st_size > 100_000 for path in here.rglob("long.mcap")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.005)
    assert not (here / "long.mcap").exists()
    process.send_signal(signal.SIGINT)
    _, complaint = process.communicate(timeout=60)
    assert process.returncode == 130
    assert complaint == "mirrorcam: interrupted; finished files are complete\n"
    assert sorted(path.name for path in here.rglob("*")) == ["layout.json", "long.avi", "video.avi"]
