"""Every frame that a source gives is in the video, or counted with the reason."""

from __future__ import annotations

import errno
import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.video import background_recorder
from mirrorcam.core.video.background_recorder import (
    BackgroundRecorder,
    FrameRecorder,
    RecordingCounts,
    new_recording,
)
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.newest_frame import NewestFrame
from mirrorcam.core.video.video import Video
from tests.core.video.videos import number_in, pictures

SIZE = 160, 96
SHOWN = pictures(40, *SIZE)
LONG_S = 30.0


def noisy(number: int) -> Frame:
    """A frame whose JPEG picture is larger than what FFmpeg groups."""
    return Frame(number, 0.02 * number, np.random.default_rng(number).integers(0, 255, (96, 160, 3), np.uint8))


class Camera:
    """A source of pictures that come at their times, whoever takes them."""

    def __init__(self, count: int, rate_hz: float) -> None:
        self.count, self.step_s, self.over = count, 1.0 / rate_hz, threading.Event()

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        began = time.monotonic()
        for number in range(self.count):
            self.over.wait(max(began + number * self.step_s - time.monotonic(), 0.0))
            yield Frame(number, number * self.step_s, SHOWN[number % len(SHOWN)])

    def stop(self) -> None:
        self.over.set()


class SlowRecorder(FrameRecorder):
    """A recorder whose disk takes a frame at a time, each slowly."""

    def add(self, frame: Frame) -> None:
        time.sleep(0.02)
        super().add(frame)


def finished(recorder: BackgroundRecorder) -> RecordingCounts:
    recorder.finish()
    assert recorder.finished(LONG_S)
    counts = recorder.counts
    found = json.loads(recorder.path.with_suffix(".json").read_text(encoding="utf-8"))
    assert found["given"] == counts.given and found["recorded"] == counts.recorded
    assert counts.waiting == 0
    assert counts.given == (counts.recorded + counts.too_slow + counts.not_written + counts.damaged + counts.skipped)
    assert counts.lost == counts.given - counts.recorded
    return counts


def read(path: Path) -> list[Frame]:
    return [item for item in Video(path).frames() if isinstance(item, Frame)]


def test_every_frame_of_a_fast_source_is_recorded_while_its_decoder_is_slow(tmp_path: Path) -> None:
    recorder = BackgroundRecorder(tmp_path / "a.mkv", *SIZE)
    newest = NewestFrame(Camera(40, 60.0), on_arrival=recorder.give)
    decoded = 0
    while newest.take() is not None:
        decoded += 1
        time.sleep(0.1)  # the decoder
    counts = finished(recorder)
    assert decoded < 20 and newest.dropped == 40 - decoded
    assert counts == RecordingCounts(given=40, recorded=40)
    frames = read(tmp_path / "a.mkv")
    assert [number_in(frame.pixels) for frame in frames] == list(range(40))
    assert [frame.time_s for frame in frames] == pytest.approx([number / 60.0 for number in range(40)], abs=1e-3)
    assert "a.mkv written: 40 frames" in str(recorder) and "lost" not in str(recorder)


def test_what_a_slow_disk_does_not_take_is_counted_and_memory_is_bounded(tmp_path: Path) -> None:
    room = 4 * SHOWN[0].nbytes
    recorder = BackgroundRecorder(tmp_path / "a.mkv", *SIZE, waiting_bytes=room, recorder=SlowRecorder)
    most = 0
    for number in range(40):
        recorder.give(Frame(number, number / 200.0, SHOWN[number]))
        most = max(most, recorder.counts.waiting)
        time.sleep(0.005)
    counts = finished(recorder)
    assert counts.given == 40 and 4 <= counts.recorded < 40 and counts.too_slow == 40 - counts.recorded
    assert most <= 4
    frames = read(tmp_path / "a.mkv")
    numbers = [number_in(frame.pixels) for frame in frames]
    assert len(numbers) == counts.recorded and numbers == sorted(set(numbers))
    assert [frame.time_s for frame in frames] == pytest.approx([number / 200.0 for number in numbers], abs=1e-3)
    assert f"{counts.lost} of 40 lost" in str(recorder)


def test_a_disk_that_is_too_slow_at_the_end_is_not_waited_for_without_limit(tmp_path: Path) -> None:
    recorder = BackgroundRecorder(tmp_path / "a.mkv", *SIZE, finishing_s=0.1, recorder=SlowRecorder)
    for number in range(40):
        recorder.give(Frame(number, number / 60.0, SHOWN[number]))
    counts = finished(recorder)
    assert 0 < counts.recorded < 40 and counts.not_written == 40 - counts.recorded
    assert len(read(tmp_path / "a.mkv")) == counts.recorded


def test_frames_that_never_arrived_are_counted(tmp_path: Path) -> None:
    recorder = BackgroundRecorder(tmp_path / "a.mkv", *SIZE)
    for number in (3, 4, 7):
        recorder.give(Frame(number, 0.1 * number, SHOWN[number]))
    recorder.give(Lost(8, "is damaged"))
    counts = finished(recorder)
    assert counts == RecordingCounts(given=6, recorded=3, damaged=1, skipped=2)
    assert str(recorder).endswith("3 frames, 3 of 6 lost: 1 were damaged, 2 were skipped")


class Full:
    """A disk with room for some bytes."""

    def __init__(self, room: int) -> None:
        self.room = room

    def patch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        disk, path_open = self, Path.open

        class Raw:
            def __init__(self, file: Any) -> None:
                self._file = file

            def write(self, data: Any) -> int:
                room = disk.room - self._file.tell()
                if room <= 0 and len(data):
                    raise OSError(errno.ENOSPC, "No space left on device")
                return int(self._file.write(bytes(data)[:room]))

            def __getattr__(self, name: str) -> Any:
                return getattr(self._file, name)

        class Opened(background_recorder._Output):
            def __init__(self, path: Path) -> None:
                super().__init__(path)
                self._raw: Any = Raw(path_open(path, "r+b", buffering=0))

        monkeypatch.setattr(background_recorder, "_Output", Opened)


@pytest.mark.parametrize("room", [100, 600, 20_000, 51_234, 123_456, 200_000])
def test_on_a_disk_that_gets_full_complete_frames_stay_and_can_be_played(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Full(room).patch(monkeypatch)
    path = tmp_path / "a.mkv"
    recorder = BackgroundRecorder(path, *SIZE)
    for number in range(20):
        recorder.give(noisy(number))
    deadline = time.monotonic() + LONG_S
    while recorder.failed is None and time.monotonic() < deadline:
        time.sleep(0.01)
    for number in range(20, 25):
        recorder.give(noisy(number))
    counts = finished(recorder)
    assert counts.given == 25 and counts.recorded < 20 and counts.not_written == 25 - counts.recorded
    assert "a.mkv: cannot be written: No space left on device" in str(recorder)
    assert path.exists() == (counts.recorded > 0) == (room >= 20_000)
    if path.exists():
        frames = list(Video(path).frames())
        assert len(frames) == counts.recorded and all(isinstance(item, Frame) for item in frames)
        assert [item.number for item in frames] == list(range(counts.recorded))
        assert path.stat().st_size <= room
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.json", "a.mkv"][: 1 + path.exists()]


def test_a_video_that_cannot_be_started_is_reported(tmp_path: Path) -> None:
    (tmp_path / "a.mkv").write_bytes(b"mine")
    recorder = BackgroundRecorder(tmp_path / "a.mkv", *SIZE)
    recorder.give(noisy(0))
    assert finished(recorder) == RecordingCounts(given=1, not_written=1)
    assert recorder.failed is not None and "exists" in recorder.failed
    assert (tmp_path / "a.mkv").read_bytes() == b"mine"


def test_new_names_are_reserved_and_nothing_is_replaced(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    first = new_recording(folder)
    assert first.name == "recording_0001.mkv" and not first.exists()
    (folder / "recording_0002.mkv").write_bytes(b"mine")
    (folder / "recording_0003.json").write_text("mine", encoding="utf-8")
    assert new_recording(folder).name == "recording_0004.mkv"
    assert (folder / "recording_0003.json").read_text(encoding="utf-8") == "mine"
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="file"):
        new_recording(tmp_path / "file")


def test_frames_are_the_same_at_their_times(tmp_path: Path) -> None:
    path, shown = tmp_path / "videos" / "a.mkv", pictures(6)
    recorder = FrameRecorder(path, 160, 96)
    for number, picture in enumerate(shown):
        recorder.add(Frame(number, 10.0 + 0.04 * number, picture))
    assert recorder.frames == 6 and not path.exists()
    recorder.close()
    read = [item for item in Video(path).frames() if isinstance(item, Frame)]
    assert [number_in(item.pixels) for item in read] == list(range(6))
    assert [item.time_s for item in read] == pytest.approx([0.04 * number for number in range(6)], abs=1e-3)
    assert np.abs(read[3].pixels.astype(int) - shown[3]).mean() < 2.0


def test_times_increase_even_where_frames_arrive_together(tmp_path: Path) -> None:
    recorder = FrameRecorder(tmp_path / "a.mkv", 160, 96)
    for number, picture in enumerate(pictures(3)):
        recorder.add(Frame(number, 5.0, picture))
    recorder.close()
    assert len([item for item in Video(tmp_path / "a.mkv").frames() if isinstance(item, Frame)]) == 3


def test_no_file_is_replaced_and_no_other_ending_taken(tmp_path: Path) -> None:
    (tmp_path / "a.mkv").write_bytes(b"mine")
    with pytest.raises(InputError, match="exists"):
        FrameRecorder(tmp_path / "a.mkv", 160, 96)
    with pytest.raises(InputError, match=r"ends in \.mkv"):
        FrameRecorder(tmp_path / "a.mp4", 160, 96)
    assert (tmp_path / "a.mkv").read_bytes() == b"mine"
