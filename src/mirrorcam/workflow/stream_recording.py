"""A video or a camera's stream becomes a recording of light fields, which is resumed after an interruption."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Literal

from mirrorcam.console.reporter import Reporter
from mirrorcam.optics.base.figure_texts import count_text
from mirrorcam.optics.base.pictures import write_image
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.hci import write_hci
from mirrorcam.optics.light_field.io.formats.stanford import write_stanford
from mirrorcam.optics.light_field.io.frames import Lost
from mirrorcam.optics.light_field.io.live_camera import LiveCamera
from mirrorcam.optics.light_field.io.recording import Folders, Recording, Sink, about
from mirrorcam.optics.light_field.io.stream import Decoded, record
from mirrorcam.optics.light_field.io.video import Video
from mirrorcam.optics.light_field.io.views_picture import tiles
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.workflow.drift_check import DRIFT, DriftReporter, WatchedSource
from mirrorcam.workflow.output_folder import OutputFolder

StreamFormat = Literal["zarr", "hci", "stanford"]
Stream = Video | LiveCamera
Show = Callable[[float, LightField], None]
"""What else happens to a frame that is decoded: its time in s, and its light field."""


@dataclass(frozen=True)
class StreamRecorder:
    """Decodes streams into recordings of a format in a folder, up to `limit` frames of each, and tells of drift.

    What `show` makes for each stream gets the frames that are decoded, too.
    """

    decoder: Decoder
    output: OutputFolder
    to: StreamFormat
    limit: int | None
    regular_grid_at_mm: float | None
    reporter: Reporter
    teller: DriftReporter | None = None
    show: Callable[[], Show] | None = None

    def record(self, source: Stream, name: str, origin: dict[str, Any]) -> int:
        """Decode a stream, from where an earlier run was cut off; `origin` is what the recording says it is of.

        Returns the number of frames that it states and that could not be used. Raises InputError for a stream without a
        frame that can be used, and where nothing can be written.
        """
        sink, suffix = _sink(self.to)
        path, picture = self.output.path / f"{name}{suffix}", f"{name}_views.png"
        equalisation = self.decoder.equalisation
        refuse_streams([name], self.to, self.output)
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
        if recording.complete:
            self.reporter.note("decode", f"{path} is there already, of the same frames")
            return len(recording.entries.lost)
        if recording.entries.last >= 0:
            self.reporter.note("decode", f"{name}: going on after frame {recording.entries.last}")
        expected = expected_frames(source, self.limit)
        watched = WatchedSource(source)
        try:
            self._decode(watched, name, recording, picture, expected)
        except KeyboardInterrupt:
            if isinstance(source, LiveCamera):
                self._finish(recording, source, watched, name, None)
            else:
                recording.close()
                kept = count_text(len(recording.entries.numbers), "frame")
                self.reporter.note("decode", f"{kept} kept, the same command resumes")
            raise
        self._finish(recording, source, watched, name, expected)
        entries = recording.entries
        return len(entries.lost) + max((expected or 0) - len(entries.numbers) - len(entries.lost), 0)

    def _finish(
        self, recording: Recording, source: Stream, watched: WatchedSource, name: str, expected: int | None
    ) -> None:
        """Tell which frames were lost, give the recording its name, and tell whether mirrors moved."""
        count = len(recording.entries.numbers)
        for line in losses(source, count, recording.entries.lost, expected):
            self.reporter.note("decode", f"{name}: {line}")
        recording.finish()
        first = self.output.path / f"{name}_views.png"
        self.reporter.note("decode", f"{recording.path} written: {count_text(count, 'frame')}; the first in {first}")
        if self.teller is not None:
            self.teller.tell(watched.seen.kept, f"{name}_{DRIFT}", sources_text(source))

    def _decode(
        self, source: WatchedSource, name: str, recording: Recording, picture: str, expected: int | None
    ) -> None:
        shown = bool(recording.entries.numbers)
        show = None if self.show is None else self.show()
        with self.reporter.work("decode", name, "frames") as advance:

            def on_frame(done: int, item: Decoded) -> None:
                nonlocal shown
                if not isinstance(item, Lost) and not shown:
                    with self.output.staged(complete=False) as folder:
                        write_image(folder / picture, tiles(item[1]))
                    shown = True
                if not isinstance(item, Lost) and show is not None:
                    show(item[0].time_s, item[1])
                advance(done, max(done, expected or 0))

            record(self.decoder, source, recording, on_frame=on_frame, limit=self.limit)


def refuse_streams(names: Iterable[str], to: StreamFormat, output: OutputFolder) -> None:
    """Raise InputError where a file of others is in the place of a recording or of the picture of its views."""
    for name in names:
        path = output.path / f"{name}{_sink(to)[1]}"
        for place in (path, path.with_name(path.name + ".partial")):
            if place.is_file():
                raise InputError(f"{place}: is a file, expected a recording of this video, or nothing")
        if not path.exists():
            output.refuse_others(glob.escape(f"{name}_views.png"), glob.escape(f"{name}_{DRIFT}"))


def _sink(to: StreamFormat) -> tuple[Sink, str]:
    """Sink that writes a stream in a format, and the ending of its name."""
    if to == "zarr":
        return ZarrSink(), ".zarr"
    return Folders(write_hci if to == "hci" else write_stanford), ""


def expected_frames(source: Stream, limit: int | None) -> int | None:
    """Number of frames that a stream should give; None where it is not known."""
    count = source.count if isinstance(source, Video) else None
    return limit if count is None or (limit or count) < count else count


def sources_text(source: Stream) -> str:
    """What `mirrorcam drift` would be given of a stream."""
    return str(source.path) if isinstance(source, Video) else "FRAMES"


def losses(source: Stream, kept: int, lost: Mapping[int, str], expected: int | None) -> list[str]:
    """Report frames that could not be used, a line for each reason, and whether the file ends before it should.

    Of a camera, how many frames were left out because they came too fast.
    """
    seen = kept + len(lost)
    lines = []
    for reason in dict.fromkeys(lost.values()):
        numbers = sorted(number for number, why in lost.items() if why == reason)
        lines.append(f"skipped {len(numbers)} of {seen} frames, each {reason}: {spans(numbers)}")
    if isinstance(source, LiveCamera):
        if source.dropped:
            lines.append(f"left out {source.dropped} of {seen + source.dropped} frames, which came faster than decoded")
        if source.outages:
            lines.append(f"the camera was gone {count_text(source.outages, 'time')}")
    elif expected is not None and seen < expected:
        lines.append(f"ends after {seen} of {expected} frames; the file is cut off")
    return lines


def spans(numbers: Sequence[int]) -> str:
    """Ascending numbers as text, with runs of neighbours joined: 3, 7 to 12."""
    runs = [[number for _, number in run] for _, run in groupby(enumerate(numbers), key=lambda each: each[1] - each[0])]
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)
