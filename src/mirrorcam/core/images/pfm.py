"""Portable float maps: one channel of 32-bit floats, the format of depths and disparities in many benchmarks."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import read_bytes, write_bytes
from mirrorcam.core.errors import InputError

# "Pf", width and height, and the scale whose sign gives the byte order; then one blank and the numbers.
_HEADER = re.compile(rb"Pf\s+(?:#[^\n]*\n\s*)*(\d{1,6})\s+(\d{1,6})\s+([-+]?[0-9.]+(?:[eE][-+]?\d+)?)[ \t]*\r?\n")

_MAX_HEADER_BYTES = 4096


def write_pfm(path: Path, values: NDArray[np.float32]) -> None:
    """Write a map (v, u) to a .pfm file, atomically; rows from the bottom up, little-endian."""
    height, width = values.shape
    write_bytes(path, f"Pf\n{width} {height}\n-1\n".encode() + values[::-1].astype("<f4").tobytes())


def read_pfm(path: Path) -> NDArray[np.float32]:
    """Read the map (v, u) of a one-channel .pfm file, row 0 at the top; NaN and infinities are kept.

    Raises a one-line InputError for a file of another format, or a truncated one.
    """
    raw = read_bytes(path)
    header = _HEADER.match(raw, 0, _MAX_HEADER_BYTES)
    if header is None:
        raise InputError(f"{path}: not a PFM file of one channel, expected a header like 'Pf 512 512 -1'")
    width, height, scale = int(header[1]), int(header[2]), float(header[3])
    size = 4 * width * height
    if scale == 0.0 or len(raw) - header.end() < size or size == 0:
        raise InputError(f"{path}: {len(raw) - header.end()} bytes of numbers, expected {size} for {width}x{height}")
    values = np.frombuffer(raw, "<f4" if scale < 0 else ">f4", width * height, header.end())
    return (values.reshape(height, width)[::-1] * np.float32(abs(scale))).astype(np.float32)
