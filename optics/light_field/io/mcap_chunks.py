"""Chunks of MCAP files, judged by what they state before anything is decompressed (https://mcap.dev/spec)."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import BinaryIO

from mirrorcam.optics.base.array_files import check_bytes, refusing
from mirrorcam.optics.base.files import stored_bytes
from mirrorcam.optics.base.values import InputError

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _CHUNK = 0x02, 0x06
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")


def check_chunks(path: Path) -> None:
    """Raise InputError for an MCAP file that was cut off, or with a chunk that would take more memory than it may."""
    stored = stored_bytes(path)
    with refusing(path, "an MCAP file that can be read"), path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError("does not begin as one")
        opcode = 0
        while opcode != _FOOTER:
            head = file.read(_RECORD.size)
            opcode, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, stored)
            after = file.tell() + length
            if after > stored:
                raise InputError(f"{path}: is cut off, expected a whole MCAP file (`mcap recover` saves what is there)")
            if opcode == _CHUNK:
                check_bytes(path, _held_bytes(file, after), stored)
            file.seek(after)
        if file.read() != MAGIC:
            raise ValueError("does not end as one")


def _held_bytes(file: BinaryIO, end: int) -> int:
    """Bytes that a chunk holds, whose record ends at `end`; raises ValueError where it does not state them."""
    _, _, stated, _, named = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
    compression = file.read(min(named, 16)).decode()
    (length,) = struct.unpack("<Q", file.read(8))
    if compression not in ("", "zstd") or length > end - file.tell():
        raise ValueError(f"a chunk of {length} bytes compressed by {compression!r}, expected all of it, zstd or none")
    return int(stated) if not compression else _zstd_bytes(file.read(length), int(stated))


def _zstd_bytes(raw: bytes, stated: int) -> int:
    """The stated number of bytes, where raw data are one frame of Zstandard that states the same."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    try:
        held, size = zstd.get_frame_info(raw).decompressed_size, zstd.get_frame_size(raw)
    except zstd.ZstdError as error:
        raise ValueError(str(error)) from None
    if held != stated or size != len(raw):
        raise ValueError(f"a chunk states {stated} bytes, its compressed data {held} in {size} of {len(raw)} bytes")
    return stated
