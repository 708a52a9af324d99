"""Frames of a live session as a video of JPEG pictures, each at its own time."""

from __future__ import annotations

import os
from contextlib import ExitStack, closing
from fractions import Fraction
from pathlib import Path
from typing import Any

import simplejpeg

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import InputError
from mirrorcam.core.video.frames import Frame

QUALITY = 95
BUFFER_BYTES = 4_000_000
"""FFmpeg's buffer: a frame is one write then, which waits for Python's lock once."""
TICKS_HZ = 1000
"""Times in a Matroska file are in milliseconds."""


class _Output:
    """The file that FFmpeg writes to. Once the disk refuses a write, no later one changes the file.

    FFmpeg is not shown the error: it would leave the file open, and a cluster of frames half written.
    """

    def __init__(self, path: Path) -> None:
        self._raw = path.open("wb", buffering=0)
        self._at = self.size = 0
        self.error: OSError | None = None

    def write(self, data: bytes) -> int:
        """Write at the current place."""
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
        """Move the place of the next write."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self.size}[whence]
        return self._at

    def tell(self) -> int:
        """The place of the next write."""
        return self._at

    def cut(self, size: int) -> None:
        """Drop what is beyond a size."""
        self._raw.truncate(size)

    def close(self) -> None:
        """Let go of the file."""
        self._raw.close()


class FrameRecorder:
    """Writes frames into a Matroska file, which gets its name when it is closed.

    Where the disk refuses to take more, the file keeps the frames that were complete by then, and can be played.

    Attributes
    ----------
    frames
        Number of frames in the file, as far as is known before it is closed.

    Raises
    ------
    InputError
        Where a file is in its place, or its name has another ending.
    """

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        import av

        if path.suffix.lower() != ".mkv":
            raise InputError(f"{path}: expected a name that ends in .mkv")
        if path.exists():
            raise InputError(f"{path}: is there already, expected a new name")
        self.path, self.frames = path, 0
        self._stack, self._started, self._last = ExitStack(), 0.0, -1
        temporary = self._stack.enter_context(atomic(path))
        self._output = self._stack.enter_context(closing(_Output(temporary)))
        self._stack.callback(self._keep_complete)
        # Flushed after each packet, a cluster of frames is in the file once the next one begins.
        self._container: Any = av.open(
            self._output, "w", format="matroska", options={"flush_packets": "1"}, buffer_size=BUFFER_BYTES
        )
        self._stream: Any = self._container.add_stream("mjpeg", rate=30)
        self._stream.width, self._stream.height, self._stream.pix_fmt = width_px, height_px, "yuvj420p"
        self._stream.time_base = Fraction(1, TICKS_HZ)
        self._complete_bytes = self._complete_frames = 0

    @property
    def failed(self) -> str | None:
        """Why the disk takes no more, in one line; None where it does."""
        error = self._output.error
        return None if error is None else f"{self.path}: cannot be written: {error.strerror or error}"

    def add(self, frame: Frame) -> None:
        """Add a frame (h, w, 3) in RGB; times must increase. Nothing happens where the disk takes no more."""
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
        """Finish the file, and name it; a file without a frame is removed. Raises InputError where that fails."""
        self._container.close()
        self._stack.close()
        if not self.frames:
            self.path.unlink()

    def _keep_complete(self) -> None:
        """Leave out what the disk has taken in part."""
        if self.failed is not None:
            self.frames = self._complete_frames
            self._output.cut(self._complete_bytes)
