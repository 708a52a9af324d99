"""Chunks of MCAP files, judged before they are decompressed into memory (https://mcap.dev/spec).

rosbags reads the messages. It, as the `mcap` library, decompresses a chunk whole, however much comes out of it, so that
all chunks pass here first.
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mirrorcam.core.disk.array_files import check_bytes, refusing
from mirrorcam.core.disk.files import stored_bytes
from mirrorcam.core.values import InputError

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _CHANNEL, _CHUNK = 0x02, 0x04, 0x06
LARGEST_TOPICS_BYTES = 400_000
"""Of the descriptions of all topics, whose quality of service is YAML that rosbags takes seconds to read; those of a
light field take less than 1 kB a view."""
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_COMPRESSIONS = ("", "zstd", "lz4")
_PIECE_BYTES = 1 << 16


class Chunk(NamedTuple):
    """A chunk of messages: where its record begins, how it is compressed, and its bytes before and after that."""

    start: int
    compression: str
    held: int
    stored: int


def zstd() -> Any:
    """The module of Zstandard that rosbags uses, too."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


def checked_chunks(path: Path) -> frozenset[Chunk]:
    """The chunks of an MCAP file.

    Raises InputError for a file that was cut off, and for a chunk that would take more memory than it may.
    """
    stored, chunks, topics = stored_bytes(path), [], 0
    with refusing(path, "an MCAP file that can be read"), path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError("does not begin as one")
        opcode = 0
        while opcode != _FOOTER:
            start, head = file.tell(), file.read(_RECORD.size)
            opcode, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, stored)
            after = file.tell() + length
            if after > stored:
                raise InputError(f"{path}: is cut off, expected a whole MCAP file (`mcap recover` saves what is there)")
            topics += length if opcode == _CHANNEL else 0
            if topics > LARGEST_TOPICS_BYTES:
                raise ValueError("topics are described by more text than they need")
            if opcode == _CHUNK:
                chunks.append(_chunk(path, file, start, after, stored))
            file.seek(after)
        if file.read() != MAGIC:
            raise ValueError("does not end as one")
    return frozenset(chunks)


def _chunk(path: Path, file: BinaryIO, start: int, end: int, stored: int) -> Chunk:
    """The chunk whose record ends at `end`, in a file of `stored` bytes.

    Raises ValueError where it does not state truly how much it holds, and InputError where that is too much.
    """
    _, _, held, _, named = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
    compression = file.read(min(named, 16)).decode()
    (length,) = struct.unpack("<Q", file.read(8))
    if compression not in _COMPRESSIONS or length > end - file.tell():
        raise ValueError(f"a chunk of {length} bytes compressed by {compression!r}, expected zstd, lz4 or none")
    check_bytes(path, int(held if compression else length), stored)
    if compression == "zstd":
        _check_zstd(file.read(length), int(held))
    elif compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        _check_pieces(LZ4FrameDecompressor(), file.read(length), int(held))
    return Chunk(start, compression, int(held if compression else length), int(length))


def _check_zstd(raw: bytes, stated: int) -> None:
    """Raise ValueError unless raw data are one frame of Zstandard that holds as many bytes as stated.

    A frame need not state its content size: ROS 2 writes none.
    """
    try:
        held, size = zstd().get_frame_info(raw).decompressed_size, zstd().get_frame_size(raw)
        if held is None:
            _check_pieces(zstd().ZstdDecompressor(), raw, stated)
            return
    except zstd().ZstdError as error:
        raise ValueError(str(error)) from None
    if held != stated or size != len(raw):
        raise ValueError(f"a chunk states {stated} bytes, its compressed data {held} in {size} of {len(raw)} bytes")


def _check_pieces(decompressor: Any, raw: bytes, stated: int) -> None:
    """Raise ValueError unless raw data are one frame that holds as many bytes as stated, with one piece in memory."""
    held = taken = 0
    while not decompressor.eof:
        piece = raw[taken : taken + _PIECE_BYTES] if decompressor.needs_input else b""
        taken += len(piece)
        found = len(decompressor.decompress(piece, _PIECE_BYTES))
        held += found
        if held > stated or not (piece or found):
            break
    rest = len(raw) - taken + len(decompressor.unused_data or b"")
    if not decompressor.eof or held != stated or rest:
        raise ValueError(f"a chunk states {stated} bytes, its compressed data are not one frame that holds as many")
