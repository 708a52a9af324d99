"""Decode a video or the stream of a camera into a recording of light fields, resumed after an interruption."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

from mirrorcam.core.console.reporter import Reporter
from mirrorcam.core.disk.output_folder import OutputFolder
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.video.frames import Lost, WatchedSource
from mirrorcam.core.video.live_camera import LiveCamera
from mirrorcam.core.video.stream_losses import Stream, expected_frames, losses, sources_text
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.hci import write_hci
from mirrorcam.optics.light_field.io.formats.stanford import write_stanford
from mirrorcam.optics.light_field.io.recording import Folders, Recording, Sink, about
from mirrorcam.optics.light_field.io.stream import Decoded, RecordingCheck, record
from mirrorcam.optics.light_field.io.view_images import tiled_views
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink
from mirrorcam.optics.light_field.light_field import LightField

StreamFormat = Literal["zarr", "hci", "stanford"]
Show = Callable[[float, LightField], None]
"""Function that shows a decoded frame, given its time in s and its light field."""


@dataclass(frozen=True)
class StreamRecorder:
    """Decodes up to `limit` frames of each stream into a recording in a folder, and checks the recording.

    `show` returns a function for each stream, which is called with every decoded frame.
    """

    decoder: Decoder
    output: OutputFolder
    to: StreamFormat
    limit: int | None
    regular_grid_at_mm: float | None
    reporter: Reporter
    check: RecordingCheck | None = None
    show: Callable[[], Show] | None = None

    def record(self, source: Stream, name: str, origin: dict[str, Any]) -> int:
        """Decode a stream, or resume an interrupted run; `origin` describes the source in the recording.

        Returns the number of lost frames. Raises InputError if the stream has no usable frame, or the recording
        cannot be written.
        """
        sink, suffix = _sink(self.to)
        path, picture = self.output.path / f"{name}{suffix}", f"{name}_views.png"
        equalisation = self.decoder.equalisation
        check_outputs([name], self.to, self.output, self.check)
        recording = Recording(
            path,
            about(
                self.decoder.views,
                origin,
                regular_grid_at_mm=self.regular_grid_at_mm,
                limit=self.limit,
                equalisation=None if equalisation is None else equalisation.gain.tolist(),
            ),
            sink,
        )
        if recording.is_complete:
            self.reporter.note("decode", f"{path} exists already, from the same frames")
            return len(recording.entries.lost)
        if recording.entries.last >= 0:
            self.reporter.note("decode", f"{name}: resuming after frame {recording.entries.last}")
        expected = expected_frames(source, self.limit)
        watched = WatchedSource(source)
        try:
            self._decode(watched, name, recording, picture, expected)
        except KeyboardInterrupt:
            if isinstance(source, LiveCamera):
                self._finish(recording, source, watched, name, None)
            else:
                recording.close()
                frames_text = count_text(len(recording.entries.numbers), "frame")
                self.reporter.note("decode", f"{frames_text} stored; the same command resumes")
            raise
        self._finish(recording, source, watched, name, expected)
        entries = recording.entries
        return len(entries.lost) + max((expected or 0) - len(entries.numbers) - len(entries.lost), 0)

    def _finish(
        self, recording: Recording, source: Stream, watched: WatchedSource, name: str, expected: int | None
    ) -> None:
        """Report lost frames, rename the recording to its final name, and check it."""
        count = len(recording.entries.numbers)
        for line in losses(source, count, recording.entries.lost, expected):
            self.reporter.note("decode", f"{name}: {line}")
        recording.finish()
        first = self.output.path / f"{name}_views.png"
        self.reporter.note("decode", f"{recording.path} written: {count_text(count, 'frame')}; the first in {first}")
        if self.check is not None:
            self.check.report(watched.sample.frames, f"{name}_{self.check.file}", sources_text(source))

    def _decode(
        self, source: WatchedSource, name: str, recording: Recording, picture: str, expected: int | None
    ) -> None:
        has_picture = bool(recording.entries.numbers)
        show = None if self.show is None else self.show()
        with self.reporter.work("decode", name, "frames") as advance:

            def on_frame(done: int, item: Decoded) -> None:
                nonlocal has_picture
                if not isinstance(item, Lost) and not has_picture:
                    with self.output.staged(complete=False) as folder:
                        write_image(folder / picture, tiled_views(item[1]))
                    has_picture = True
                if not isinstance(item, Lost) and show is not None:
                    show(item[0].time_s, item[1])
                advance(done, max(done, expected or 0))

            record(self.decoder, source, recording, on_frame=on_frame, limit=self.limit)


def check_outputs(names: Iterable[str], to: StreamFormat, output: OutputFolder, check: RecordingCheck | None) -> None:
    """Raise InputError if a recording, its picture or its check would replace a file that `decode` did not write."""
    for name in names:
        path = output.path / f"{name}{_sink(to)[1]}"
        for file in (path, path.with_name(path.name + ".partial")):
            if file.is_file():
                raise InputError(f"{file}: is a file, but a recording of this video would have this name")
        if not path.exists():
            files = ["views.png", *([] if check is None else [check.file])]
            output.refuse_others(*(glob.escape(f"{name}_{file}") for file in files))


def _sink(to: StreamFormat) -> tuple[Sink, str]:
    """Return the sink that writes a stream in a format, and the suffix of its name."""
    if to == "zarr":
        return ZarrSink(), ".zarr"
    return Folders(write_hci if to == "hci" else write_stanford), ""
