"""Decode JPEG data of a picture file or of a video frame; incomplete data is refused."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import simplejpeg
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError

JPEG_BEGIN, JPEG_END = b"\xff\xd8", b"\xff\xd9"
# Marker of a segment with a length; padding, escaped bytes and restarts within a scan have no length.
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_RESTART = re.compile(rb"\xff[\xd0-\xd7]")
# Bytes of zeros, or of ones (0xff, followed by 0x00 in a scan), and any marker that follows: before it, they are
# padding. Possessive, to match in linear time.
_PADDING = re.compile(rb"(?:\xff?+\x00)++(\xff++[\xd0-\xd7\xd9])?+")
_FRAME_HEADERS = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_TABLES, _SCAN, _END, _RESTARTS = 0xC4, 0xDA, 0xD9, 0xDD
_END_OF_BLOCK = 0x00
# A run that occurs in a lost block of a disk, but in no compressed picture.
_ZEROS = bytes(256)
_MAX_SEGMENTS, _MAX_SCANS = 10_000, 100
"""Limits per picture: a decoder visits all blocks for each scan, and encoders write about ten scans at most."""
EXTRANEOUS = "extraneous bytes before marker 0xd"
"""libjpeg's warning about bytes between the end of the data and the next marker."""


class DamagedPicture(InputError):
    """A picture file is damaged: the message names the file and the damage."""


@dataclass(frozen=True)
class Jpeg:
    """Marker of each segment of a JPEG, with start and end of its content, and offset of the end marker, if any.

    The end marker of a thumbnail, which is inside a segment, does not count. Appended data is ignored.
    """

    segments: tuple[tuple[int, int, int], ...]
    end: int | None

    @classmethod
    def of(cls, raw: bytes) -> Jpeg:
        """Find the segments of JPEG data."""
        segments: list[tuple[int, int, int]] = []
        at = 2
        while len(segments) < _MAX_SEGMENTS and (marker := _MARKER.search(raw, at)):
            kind, begin = raw[marker.end() - 1], marker.end() + 2
            if kind == _END:
                return cls(tuple(segments), marker.start())
            at = marker.end() + int.from_bytes(raw[marker.end() : begin])
            segments.append((kind, begin, at))
        return cls(tuple(segments), None)

    def size(self, raw: bytes) -> tuple[int, int]:
        """Return width and height in px; zeros if no header states them."""
        for kind, begin, end in self.segments:
            if kind in _FRAME_HEADERS and end - begin >= 5 and len(raw) >= end:
                height, width = struct.unpack(">HH", raw[begin + 1 : begin + 5])
                return width, height
        return 0, 0

    @property
    def is_overlong(self) -> bool:
        """Whether there are more segments or scans than any encoder writes."""
        scans = sum(kind == _SCAN for kind, _, _ in self.segments)
        return len(self.segments) >= _MAX_SEGMENTS or scans > _MAX_SCANS

    def scan(self, raw: bytes) -> int:
        """Return the offset of the first compressed data; the length of the data without any."""
        return next((end for kind, _, end in self.segments if kind == _SCAN), len(raw))

    def is_partly_zero(self, raw: bytes) -> bool:
        """Return whether the compressed data contains a long run of zeros that no encoder can have written.

        Zeros repeat the first code of a Huffman table. Unless that code ends a block of uniform colour, they represent
        blocks of only the highest frequencies.
        """
        if raw.find(_ZEROS, self.scan(raw), self.end) < 0:
            return False
        return _END_OF_BLOCK not in {symbol for segment in self.segments for symbol in _first_symbols(raw, *segment)}

    def is_padded(self, raw: bytes) -> bool:
        """Return whether there is padding before the first restart marker, as some webcams write it."""
        if not any(kind == _RESTARTS for kind, _, _ in self.segments):
            return False
        restart = _RESTART.search(raw, self.scan(raw), len(raw) if self.end is None else self.end)
        return restart is not None and raw[restart.start() - 1] == 0


def _first_symbols(raw: bytes, kind: int, at: int, end: int) -> list[int]:
    """Return the symbols that zeros encode in the AC Huffman tables of a segment."""
    symbols = []
    while kind == _TABLES and at + 17 < min(end, len(raw)):
        if raw[at] >> 4 == 1:
            symbols.append(raw[at + 17])
        at += 17 + sum(raw[at + 1 : at + 17])
    return symbols


def decode_jpeg(raw: bytes, jpeg: Jpeg, name: str, *, grey: bool = False) -> NDArray[np.uint8]:
    """Decode JPEG data (h, w, 3) in RGB, or (h, w) in grey.

    Padding before a restart or the end, as webcams write it, is not damage if the data is complete without it.

    Parameters
    ----------
    raw
        The data.
    jpeg
        Its segments.
    name
        Name of the file in error messages.
    grey
        Convert to grey.

    Raises
    ------
    DamagedPicture
        For a warning of libjpeg, a block of zeros, or more parts than any encoder writes.
    """
    if jpeg.is_overlong:
        raise DamagedPicture(overlong(name))
    if jpeg.is_partly_zero(raw):
        raise DamagedPicture(f"{name}: damaged, a block of zeros is where compressed data should be")
    padded = jpeg.is_padded(raw)
    try:
        image = _decoded(_without_padding(raw, jpeg) if padded else raw, grey)
    except ValueError as error:
        if EXTRANEOUS not in str(error) and not padded:
            raise DamagedPicture(_reason(name, error)) from None
        try:
            image = _decoded(raw if padded else _without_padding(raw, jpeg), grey)
        except ValueError:
            raise DamagedPicture(_reason(name, error)) from None
    return np.asarray(image[..., 0] if grey else image, dtype=np.uint8)


def overlong(name: str) -> str:
    """Return the message for a picture that `Jpeg.is_overlong`."""
    return f"{name}: damaged, has more parts than any JPEG: over {_MAX_SEGMENTS} segments or {_MAX_SCANS} scans"


def _decoded(raw: bytes, grey: bool) -> NDArray[Any]:
    image: NDArray[Any] = simplejpeg.decode_jpeg(raw, colorspace="GRAY" if grey else "RGB")
    return image


def _without_padding(raw: bytes, jpeg: Jpeg) -> bytes:
    scan = jpeg.scan(raw)
    return raw[:scan] + _PADDING.sub(lambda match: match[1] or match[0], raw[scan:])


def _reason(name: str, error: ValueError) -> str:
    return f"{name}: damaged, {str(error).rstrip('.')}"
