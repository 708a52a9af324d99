"""Decode uncompressed BMP data."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture

BMP_BEGIN = b"BM"
_FILE_BYTES, _HEADER_BYTES = 14, 40
_UNCOMPRESSED, _MASKS = 0, 3
_BLUE_GREEN_RED = struct.pack("<III", 0xFF0000, 0xFF00, 0xFF)
"""Masks of red, green and blue in a number of 32 bits whose first byte is blue."""


@dataclass(frozen=True)
class Bmp:
    """The header of a BMP: size in px, bits per pixel, whether the top line is first, and offset of the pixels.

    `colours` is the offset of the palette and its number of colours, 0 for pixels with more than 8 bits.
    """

    size: tuple[int, int]
    depth: int
    top_down: bool
    pixels: int
    colours: tuple[int, int]

    @classmethod
    def of(cls, raw: bytes, name: str) -> Bmp:
        """Read the header; raises DamagedPicture if it is damaged, and InputError for an unsupported kind of BMP."""
        if len(raw) < _FILE_BYTES + _HEADER_BYTES:
            raise DamagedPicture(f"{name}: image is truncated")
        pixels, header, width, height, planes, depth, method = struct.unpack_from("<IIiiHHI", raw, 10)
        (colours,) = struct.unpack_from("<I", raw, 46)
        if header < _HEADER_BYTES or planes != 1 or width < 0:
            raise DamagedPicture(f"{name}: damaged, its header is not a BMP's")
        masks = raw[54:66] if method == _MASKS and depth == 32 else _BLUE_GREEN_RED
        if method not in (_UNCOMPRESSED, _MASKS) or depth not in (1, 4, 8, 24, 32) or masks != _BLUE_GREEN_RED:
            raise InputError(
                f"{name}: a BMP of {depth} bits a pixel, compressed or with other colours, expected "
                "an uncompressed one of 8, 24 or 32 bits"
            )
        palette_size = (colours or 1 << depth) if depth <= 8 else 0
        if palette_size > 256:
            raise DamagedPicture(f"{name}: damaged, its palette has a wrong length")
        return cls((width, abs(height)), depth, height < 0, pixels, (_FILE_BYTES + header, palette_size))

    @property
    def line_bytes(self) -> int:
        """Bytes of a line as stored."""
        return (self.size[0] * self.depth + 31) // 32 * 4


def decode_bmp(raw: bytes, bmp: Bmp, name: str) -> NDArray[np.uint8]:
    """Decode BMP data (h, w, 3) in RGB; raises DamagedPicture for truncated data."""
    width, height = bmp.size
    begin, count = bmp.colours
    if bmp.pixels + bmp.line_bytes * height > len(raw) or begin + 4 * count > len(raw):
        raise DamagedPicture(f"{name}: image is truncated")
    lines = np.frombuffer(raw, np.uint8, bmp.line_bytes * height, bmp.pixels).reshape(height, -1)
    lines = lines if bmp.top_down else lines[::-1]
    if bmp.depth > 8:
        samples = lines[:, : width * bmp.depth // 8].reshape(height, width, -1)
        return np.ascontiguousarray(samples[..., 2::-1])
    palette = np.zeros((256, 3), np.uint8)
    palette[:count] = np.frombuffer(raw, np.uint8, 4 * count, begin).reshape(count, 4)[:, 2::-1]
    indices: NDArray[Any] = lines
    if bmp.depth == 4:
        indices = np.stack([lines >> 4, lines & 15], axis=-1).reshape(height, -1)
    elif bmp.depth == 1:
        indices = np.unpackbits(lines, axis=1)
    return palette[indices[:, :width]]
