"""Frames of a live session as a video of JPEG pictures, each at its own time."""

from __future__ import annotations

from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import Any

import simplejpeg

from mirrorcam.optics.base.files import atomic
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.frames import Frame
from mirrorcam.optics.light_field.io.media_files import file_address

QUALITY = 95
TICKS_HZ = 1000
"""Times in a Matroska file are in milliseconds."""


class FrameRecorder:
    """Writes frames into a Matroska file, which gets its name when it is closed.

    Raises InputError where a file is in its place, or its name has another ending.
    """

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        import av

        if path.suffix.lower() != ".mkv":
            raise InputError(f"{path}: expected a name that ends in .mkv")
        if path.exists():
            raise InputError(f"{path}: is there already, expected a new name")
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path, self.frames = path, 0
        self._stack, self._started, self._last = ExitStack(), 0.0, -1
        self._container: Any = self._stack.enter_context(
            av.open(file_address(self._stack.enter_context(atomic(path))), "w", format="matroska")
        )
        self._stream: Any = self._container.add_stream("mjpeg", rate=30)
        self._stream.width, self._stream.height, self._stream.pix_fmt = width_px, height_px, "yuvj420p"
        self._stream.time_base = Fraction(1, TICKS_HZ)

    def add(self, frame: Frame) -> None:
        """Add a frame (h, w, 3) in RGB; times must increase."""
        import av

        if not self.frames:
            self._started = frame.time_s
        packet = av.Packet(simplejpeg.encode_jpeg(frame.pixels, QUALITY, colorsubsampling="420"))
        moment = max(round((frame.time_s - self._started) * TICKS_HZ), self._last + 1)
        packet.stream, packet.time_base = self._stream, Fraction(1, TICKS_HZ)
        packet.pts = packet.dts = self._last = moment
        packet.is_keyframe = True
        self._container.mux(packet)
        self.frames += 1

    def close(self) -> None:
        """Finish the file."""
        self._stack.close()
