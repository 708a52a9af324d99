"""Decode PNG data within the limits of its header; the decoder prints nothing on standard error."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.images.jpeg import DamagedPicture

PNG_BEGIN, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
_GREY, _COLOURS, _PALETTE = 0, 2, 3
# First column and row of each pass of an interlaced picture, and its column and row steps.
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
_LARGEST_FILTER = 4
_STORED_BYTES = 65_535
"""Bytes of the largest stored block of deflate."""
_MAX_CHUNKS = 200_000
"""More chunks than the largest picture has, at 8 kB each as encoders write them."""
_LARGE_BYTES = 1 << 26
"""Size of lines above which they should not be in memory twice."""


@dataclass(frozen=True)
class Png:
    """The header of a PNG: width and height in px, bits per sample, colour type, and whether it is interlaced."""

    size: tuple[int, int]
    depth: int
    colour: int
    interlaced: bool

    @classmethod
    def of(cls, raw: bytes, name: str) -> Png:
        """Read the header of PNG data; raises DamagedPicture for an invalid one."""
        if raw[8:16] != b"\x00\x00\x00\rIHDR" or len(raw) < 29:
            raise DamagedPicture(f"{name}: damaged, its header states no size")
        width, height, depth, colour, method, filters, interlaced = struct.unpack(">IIBBBBB", raw[16:29])
        if depth not in _DEPTHS.get(colour, ()) or method or filters or interlaced > 1:
            raise DamagedPicture(f"{name}: damaged, its header is not a PNG's")
        return cls((width, height), depth, colour, bool(interlaced))

    @property
    def channels(self) -> int:
        """Channels of the decoded pixels."""
        return 4 if self.colour == _PALETTE else _CHANNELS[self.colour]

    @property
    def is_coloured(self) -> bool:
        """Whether pixels are coloured rather than grey."""
        return bool(self.colour & 2)

    @property
    def _row_bytes(self) -> Iterator[tuple[int, int]]:
        """Number of rows of each pass, and bytes per row with its filter byte."""
        width, height = self.size
        for column, row, column_step, row_step in _PASSES if self.interlaced else ((0, 0, 1, 1),):
            cols, rows = -(-(width - column) // column_step), -(-(height - row) // row_step)
            if cols > 0 and rows > 0:
                yield rows, 1 + (cols * _CHANNELS[self.colour] * self.depth + 7) // 8


def significant_bits(raw: bytes) -> int | None:
    """Return the significant bits (sBIT) that a PNG states, the maximum over its colours; None if it states none.

    Opacity does not count.
    """
    for begin, end in _chunks(raw):
        name = raw[begin : begin + 4]
        if name == b"sBIT":
            stated = raw[begin + 4 : end][: 1 if raw[25] in (_GREY, 4) else 3]
            return max(stated, default=0) or None
        if name == b"IDAT":
            break
    return None


def decode_png(raw: bytes, png: Png, name: str, flags: int, *, opacity: bool = False) -> NDArray[Any]:
    """Decode PNG data by OpenCV's flags.

    The decoder gets only the critical chunks, after a check of their data: it prints warnings about anything else on
    standard error.

    Parameters
    ----------
    raw
        The data.
    png
        Header of the data.
    name
        Name of the file in error messages.
    flags
        Flags of `cv2.imdecode`.
    opacity
        Whether the opacity of colours (tRNS) is read.

    Raises
    ------
    DamagedPicture
        For a wrong checksum, order or length, or data that cannot be inflated.
    """
    parts = _parts(raw, png, name)
    lines = _lines(parts[b"IDAT"], png, name)
    pieces: list[bytes | memoryview] = [PNG_BEGIN, *_chunk(raw[12:29])]
    if png.colour == _PALETTE:
        # Padded, because the decoder prints a warning for an index beyond the palette.
        pieces += _chunk(b"PLTE", parts[b"PLTE"].ljust(3 << png.depth, b"\x00"))
    if opacity and _is_valid_opacity(png, parts):
        pieces += _chunk(b"tRNS", parts[b"tRNS"])
    pieces += (*_chunk(b"IDAT", *lines), *_chunk(b"IEND"))
    clean = np.frombuffer(b"".join(pieces), np.uint8)
    del pieces, lines, parts
    try:
        image = cv2.imdecode(clean, flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        image = None
    if image is None:
        raise DamagedPicture(f"{name}: damaged, its data cannot be decoded")
    return image


def _chunks(raw: bytes) -> Iterator[tuple[int, int]]:
    """Yield begin and end of name and content of each complete chunk, up to IEND."""
    at = len(PNG_BEGIN)
    while (end := at + 8 + int.from_bytes(raw[at : at + 4])) + 4 <= len(raw):
        yield at + 4, end
        if raw[at + 4 : at + 8] == b"IEND":
            return
        at = end + 4


def _parts(raw: bytes, png: Png, name: str) -> dict[bytes, bytes]:
    """Return the contents of the chunks that determine the picture, by name; check all checksums."""
    content, last = memoryview(raw), b""
    data: list[memoryview] = []
    parts: dict[bytes, bytes] = {}
    for number, (begin, end) in enumerate(_chunks(raw)):
        if number >= _MAX_CHUNKS:
            raise DamagedPicture(f"{name}: damaged, has more than {_MAX_CHUNKS} parts")
        previous, last = last, raw[begin : begin + 4]
        if zlib.crc32(content[begin:end]) != int.from_bytes(raw[end : end + 4]):
            raise DamagedPicture(f"{name}: damaged, a checksum of its data is wrong")
        if last == b"IHDR" and previous:
            raise DamagedPicture(f"{name}: damaged, its parts are in a wrong order")
        if last == b"IDAT":
            if data and previous != b"IDAT":
                raise DamagedPicture(f"{name}: damaged, its parts are in a wrong order")
            data.append(content[begin + 4 : end])
        elif last in (b"PLTE", b"tRNS"):
            if data or (last == b"PLTE" and last in parts):
                raise DamagedPicture(f"{name}: damaged, its parts are in a wrong order")
            parts[last] = raw[begin + 4 : end]
        elif not last[0] & 0x20 and last not in (b"IHDR", b"IEND"):
            raise DamagedPicture(f"{name}: damaged, has an unknown part {last!r}")
    if last != b"IEND" or not data:
        raise DamagedPicture(f"{name}: damaged, a part of it is missing")
    if png.colour == _PALETTE:
        palette = parts.get(b"PLTE", b"")
        if not palette or len(palette) % 3 or len(palette) > 3 << png.depth:
            raise DamagedPicture(f"{name}: damaged, its palette is missing or has a wrong length")
    return parts | {b"IDAT": b"".join(data)}


def _is_valid_opacity(png: Png, parts: dict[bytes, bytes]) -> bool:
    """Return whether there is a valid tRNS chunk; all programs ignore an invalid one."""
    stated = parts.get(b"tRNS")
    if stated is None:
        return False
    if png.colour == _PALETTE:
        return 0 < len(stated) <= len(parts[b"PLTE"]) // 3
    if len(stated) != {_GREY: 2, _COLOURS: 6}.get(png.colour):
        return False
    return all(value < 1 << png.depth for (value,) in struct.iter_unpack(">H", stated))


def _lines(data: bytes, png: Png, name: str) -> list[bytes | memoryview]:
    """Return pieces of a zlib stream with the filtered lines of a picture, of the size that its header states.

    For a small picture, the stream is uncompressed, so that it is not inflated twice.
    """
    layout = list(png._row_bytes)
    total_bytes = sum(rows * row_bytes for rows, row_bytes in layout)
    stream = zlib.decompressobj()
    try:
        lines = stream.decompress(data, total_bytes + 1)
    except zlib.error:
        raise DamagedPicture(f"{name}: damaged, its data cannot be decoded") from None
    if len(lines) < total_bytes:
        raise DamagedPicture(f"{name}: damaged, a part of it is missing")
    at, filters = 0, np.frombuffer(lines, np.uint8)
    for rows, row_bytes in layout:
        if (filters[at : at + rows * row_bytes : row_bytes] > _LARGEST_FILTER).any():
            raise DamagedPicture(f"{name}: damaged, its data cannot be decoded")
        at += rows * row_bytes
    if total_bytes > _LARGE_BYTES and len(lines) == total_bytes and stream.eof and not stream.unused_data:
        return [data]
    return _stored(memoryview(lines)[:total_bytes])


def _stored(lines: memoryview) -> list[bytes | memoryview]:
    """Return pieces of an uncompressed zlib stream."""
    blocks: list[bytes | memoryview] = [b"\x78\x01"]
    for at in range(0, len(lines), _STORED_BYTES):
        piece = lines[at : at + _STORED_BYTES]
        is_last = at + _STORED_BYTES >= len(lines)
        blocks += (struct.pack("<BHH", is_last, len(piece), len(piece) ^ 0xFFFF), piece)
    return [*blocks, zlib.adler32(lines).to_bytes(4)]


def _chunk(*pieces: bytes | memoryview) -> list[bytes | memoryview]:
    """Return pieces of a chunk from its name and the pieces of its content."""
    checksum = 0
    for piece in pieces:
        checksum = zlib.crc32(piece, checksum)
    return [(sum(map(len, pieces)) - 4).to_bytes(4), *pieces, checksum.to_bytes(4)]
