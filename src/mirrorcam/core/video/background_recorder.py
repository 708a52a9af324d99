"""Record every frame of a source in the background; lost frames are counted."""

from __future__ import annotations

import json
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import simplejpeg

from mirrorcam.core.disk.files import atomic, write_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.video.frames import Frame, Lost

SCHEMA = "mirrorcam.live_recording/1"
WAITING_BYTES = 256_000_000
"""Bytes of frames that may wait to be written."""
FINISHING_S = 3.0
"""Time at the end to write waiting frames."""
QUALITY = 95
BUFFER_BYTES = 4_000_000
"""FFmpeg's buffer: large enough for one write per frame, which waits for the GIL only once."""
TICKS_HZ = 1000
"""Matroska timestamps are in milliseconds."""


class _Output:
    """The file that FFmpeg writes to. After the first error, writes have no effect.

    The error is hidden from FFmpeg, which would otherwise not close the file.
    """

    def __init__(self, path: Path) -> None:
        self._raw = path.open("wb", buffering=0)
        self._at = self.size = 0
        self.error: OSError | None = None

    def write(self, data: bytes) -> int:
        """Write at the current position."""
        rest = memoryview(data)
        try:
            if self.error is None:
                self._raw.seek(self._at)
            while rest and self.error is None:
                rest = rest[self._raw.write(rest) :]
        except OSError as error:
            self.error = error
        self._at += len(data)
        self.size = max(self.size, self._at)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move the position of the next write."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self.size}[whence]
        return self._at

    def tell(self) -> int:
        """Return the position of the next write."""
        return self._at

    def truncate(self, size: int) -> None:
        """Truncate the file."""
        self._raw.truncate(size)

    def close(self) -> None:
        """Close the file."""
        self._raw.close()


class FrameRecorder:
    """Writes frames to a Matroska file, which gets its name when it is closed.

    If the disk fails or is full, the file keeps the complete frames and remains playable.

    Attributes
    ----------
    frames
        Number of frames in the file; final when it is closed.

    Raises
    ------
    InputError
        If the file exists, or its suffix is not .mkv.
    """

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        import av

        if path.suffix.lower() != ".mkv":
            raise InputError(f"{path}: expected a name that ends in .mkv")
        if path.exists():
            raise InputError(f"{path}: exists, expected a new name")
        self.path, self.frames = path, 0
        self._stack, self._started, self._last = ExitStack(), 0.0, -1
        temporary = self._stack.enter_context(atomic(path))
        self._output = self._stack.enter_context(closing(_Output(temporary)))
        self._stack.callback(self._keep_complete)
        # With a flush after each packet, a cluster is complete in the file when the next begins.
        self._container: Any = av.open(
            self._output, "w", format="matroska", options={"flush_packets": "1"}, buffer_size=BUFFER_BYTES
        )
        self._stream: Any = self._container.add_stream("mjpeg", rate=30)
        self._stream.width, self._stream.height, self._stream.pix_fmt = width_px, height_px, "yuvj420p"
        self._stream.time_base = Fraction(1, TICKS_HZ)
        self._complete_bytes = self._complete_frames = 0

    @property
    def failed(self) -> str | None:
        """Error of the disk in one line, or None."""
        error = self._output.error
        return None if error is None else f"{self.path}: cannot be written: {error.strerror or error}"

    def add(self, frame: Frame) -> None:
        """Add a frame (h, w, 3) in RGB; times must increase. After an error of the disk, do nothing."""
        import av

        if self.failed is not None:
            return
        if not self.frames:
            self._started = frame.time_s
        packet = av.Packet(simplejpeg.encode_jpeg(frame.pixels, QUALITY, colorsubsampling="420"))
        moment = max(round((frame.time_s - self._started) * TICKS_HZ), self._last + 1)
        packet.stream, packet.time_base = self._stream, Fraction(1, TICKS_HZ)
        packet.pts = packet.dts = self._last = moment
        packet.is_keyframe = True
        self._container.mux(packet)
        if self.failed is not None:
            self.frames = self._complete_frames
            return
        if self._output.size > self._complete_bytes:
            self._complete_bytes, self._complete_frames = self._output.size, self.frames
        self.frames += 1

    def close(self) -> None:
        """Finish and rename the file, or remove it if it has no frame; raises InputError if that fails."""
        self._container.close()
        self._stack.close()
        if not self.frames:
            self.path.unlink()

    def _keep_complete(self) -> None:
        """Remove incompletely written frames."""
        if self.failed is not None:
            self.frames = self._complete_frames
            self._output.truncate(self._complete_bytes)


@dataclass(frozen=True)
class RecordingCounts:
    """Counts of the frames that a source delivered while it was recorded; the other counts add up to `given`.

    Attributes
    ----------
    given
        Frames that the source delivered.
    recorded
        Frames in the video.
    waiting
        Frames that wait to be written; 0 at the end.
    too_slow
        Frames for which there was no room: they came faster than they could be written.
    not_written
        Frames that the disk did not store: it was full, or too slow at the end.
    damaged
        Frames that could not be read.
    skipped
        Frames that newer ones replaced before they reached the recorder.
    """

    given: int = 0
    recorded: int = 0
    waiting: int = 0
    too_slow: int = 0
    not_written: int = 0
    damaged: int = 0
    skipped: int = 0

    @property
    def lost(self) -> int:
        """Number of frames that are not in the video, and will not be."""
        return self.given - self.recorded - self.waiting

    @property
    def reasons(self) -> str:
        """Reasons for losses, with the number of frames."""
        losses = {
            "came faster than they could be written": self.too_slow,
            "were not stored by the disk": self.not_written,
            "were damaged": self.damaged,
            "were skipped": self.skipped,
        }
        return ", ".join(f"{count} {reason}" for reason, count in losses.items() if count)


class BackgroundRecorder:
    """Encodes and writes frames in a thread of its own; `give` never waits for it.

    At the end, PATH.json in the video's folder states its counts.

    Parameters
    ----------
    path
        The video, a new name that ends in .mkv.
    width_px, height_px
        Size of the frames.
    waiting_bytes
        Bytes of the frames that may wait; those that arrive while there is no room are lost.
    finishing_s
        Time at the end to write waiting frames.
    recorder
        Writer of the video.
    """

    def __init__(
        self,
        path: Path,
        width_px: int,
        height_px: int,
        *,
        waiting_bytes: int = WAITING_BYTES,
        finishing_s: float = FINISHING_S,
        recorder: Callable[[Path, int, int], FrameRecorder] = FrameRecorder,
    ) -> None:
        self.path = path
        self._open: Callable[[], FrameRecorder] = lambda: recorder(path, width_px, height_px)
        self._max_bytes, self._finishing_s = waiting_bytes, finishing_s
        self._changed = threading.Condition()
        self._waiting: deque[Frame] = deque()
        self._bytes = 0
        self._given = self._recorded = self._taken = self._too_slow = self._damaged = self._skipped = 0
        self._last: int | None = None
        self._ends_s: float | None = None
        self._failed: str | None = None
        self._over = False
        self._thread = threading.Thread(target=self._write, name="recording", daemon=True)
        self._thread.start()

    def give(self, item: Frame | Lost) -> None:
        """Record the next frame of the source; ignored after `finish`."""
        with self._changed:
            if self._ends_s is not None:
                return
            skipped = 0 if self._last is None else max(item.number - self._last - 1, 0)
            self._given, self._skipped, self._last = self._given + 1 + skipped, self._skipped + skipped, item.number
            if isinstance(item, Lost):
                self._damaged += 1
            elif self._bytes and self._bytes + item.pixels.nbytes > self._max_bytes:
                self._too_slow += 1
            else:
                self._taken += 1
                if self._failed is None:
                    self._bytes += item.pixels.nbytes
                    self._waiting.append(item)
                    self._changed.notify_all()

    def finish(self) -> None:
        """Accept no more frames; write the waiting ones and finish the files in the background."""
        with self._changed:
            if self._ends_s is None:
                self._ends_s = time.monotonic() + self._finishing_s
            self._changed.notify_all()

    def finished(self, timeout_s: float = 0.0) -> bool:
        """Wait up to `timeout_s` after `finish`, and return whether everything is written."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    @property
    def failed(self) -> str | None:
        """Error that prevents further writing, in one line, or None."""
        with self._changed:
            return self._failed

    @property
    def counts(self) -> RecordingCounts:
        """Counts of the frames so far."""
        with self._changed:
            pending = self._taken - self._recorded
            waiting = 0 if self._failed is not None or self._over else pending
            return RecordingCounts(
                given=self._given,
                recorded=self._recorded,
                waiting=waiting,
                too_slow=self._too_slow,
                not_written=pending - waiting,
                damaged=self._damaged,
                skipped=self._skipped,
            )

    def __str__(self) -> str:
        counts = self.counts
        lost = f", {counts.lost} of {counts.given} lost: {counts.reasons}" if counts.lost else ""
        return f"{self.failed or f'{self.path} written'}: {counts.recorded} frames{lost}"

    def _write(self) -> None:
        recorder: FrameRecorder | None = None
        try:
            while (frame := self._next()) is not None:
                recorder = recorder or self._open()
                recorder.add(frame)
                self._note(recorder, frame)
            if recorder is not None:
                recorder.close()
                self._note(recorder)
        except InputError as error:  # there is no video
            self._fail(str(error))
            with self._changed:
                self._recorded = 0
        with self._changed:
            self._changed.wait_for(lambda: self._ends_s is not None)
            self._over = True
        try:
            write_json(self.path.with_suffix(".json"), counts_record(self.path, self.counts, self.failed))
        except InputError as error:
            self._fail(str(error))

    def _next(self) -> Frame | None:
        """Return the next frame to write; None at the end, after an error, or when time is over."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._waiting) or self._ends_s is not None)
            late = self._ends_s is not None and time.monotonic() > self._ends_s
            if self._failed is not None or late:
                self._waiting.clear()
            return self._waiting.popleft() if self._waiting else None

    def _note(self, recorder: FrameRecorder, frame: Frame | None = None) -> None:
        with self._changed:
            self._recorded = recorder.frames
            self._bytes -= 0 if frame is None else frame.pixels.nbytes
            self._failed = self._failed or recorder.failed

    def _fail(self, reason: str) -> None:
        with self._changed:
            self._failed = self._failed or reason


def counts_record(path: Path, counts: RecordingCounts, failed: str | None) -> dict[str, object]:
    """Return the content of a video's JSON file."""
    return {"schema": SCHEMA, "video": path.name, "failed": failed} | asdict(counts)


def new_recording(folder: Path) -> Path:
    """Return a new path recording_NNNN.mkv in a folder, reserved by its JSON file.

    Raises InputError if the folder cannot be written.
    """
    number = 1
    while True:
        path = folder / f"recording_{number:04d}.mkv"
        side = path.with_suffix(".json")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                with side.open("x", encoding="utf-8") as file:
                    file.write(json.dumps(counts_record(path, RecordingCounts(), None), indent=1) + "\n")
                return path
        except FileExistsError:
            if not side.exists():
                raise InputError(f"{folder}: is not a folder, expected one to record into") from None
        except OSError as error:
            raise InputError(f"{side}: cannot be written: {error.strerror}") from None
        number += 1
