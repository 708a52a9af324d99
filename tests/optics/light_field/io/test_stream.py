"""From a stream to light fields: frames after a limit, and memory."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.stream import record
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink
from tests.core.video.videos import pictures, write_h264
from tests.optics.light_field.io.conftest import begin


def test_frames_after_the_limit_are_not_read(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, recording, limit=4)
    record(decoder, video, recording, limit=4)
    assert recording.entries.numbers == [0, 1, 2, 3]


class Loop:
    """An endless video that repeats its frames."""

    def __init__(self, video: Video, count: int) -> None:
        self.video, self.count = video, count

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        number = 0
        while True:
            for frame in self.video.frames():
                if number == self.count:
                    return
                assert isinstance(frame, Frame)
                yield replace(frame, number=number, time_s=number / 25)
                number += 1

    def stop(self) -> None:
        pass


def resident_mb() -> float:
    """Return the resident memory of the process."""
    return int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]) * resource.getpagesize() / 1e6


def test_memory_does_not_grow(tmp_path: Path, parabola_layout: Layout) -> None:
    decoder = Decoder(parabola_layout)
    video = Video(write_h264(tmp_path / "a.mp4", pictures(30, 960, 540)))
    held: list[float] = []
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, Loop(video, 100), recording, on_frame=lambda done, _: held.append(resident_mb()))
    recording.finish()
    assert len(held) == 100
    # 50 frames of 1.6 MB, and as many light fields of about that size, would be 150 MB.
    assert max(held[75:]) - min(held[25:50]) < 30.0
