"""ROS 2 bags (MCAP files and folders of rosbag2), checked before their messages are read by rosbags.

Like the `mcap` library, rosbags decompresses an entire chunk of an MCAP file, however large the result, so chunks are
checked before they are decompressed into memory (https://mcap.dev/spec).
"""

from __future__ import annotations

import os
import struct
import sys
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mirrorcam.core.disk.array_files import as_input_error, check_bytes
from mirrorcam.core.disk.files import inside, read_bytes, refuse_pointer, stored_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require

METADATA = "metadata.yaml"
MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _CHANNEL, _CHUNK = 0x02, 0x04, 0x06
MAX_TOPICS_BYTES = 400_000
"""Maximum size of all topics' descriptions, whose quality of service is YAML that rosbags parses slowly; those of a
light field take less than 1 kB per view."""
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_COMPRESSIONS = ("", "zstd", "lz4")
_PIECE_BYTES = 1 << 16
_NS_PER_S = 10**9
_MAX_NAMES = 3
"""Number of names that a message lists."""


def is_bag(path: Path) -> bool:
    """Return whether a path is named as an MCAP file, or is a rosbag2 folder."""
    return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix.lower() == ".mcap"


class Bag:
    """An open bag.

    Parameters
    ----------
    path
        The MCAP file or the folder.

    Attributes
    ----------
    connections
        Topics with their message types, as rosbags describes them.
    duration_ns
        Time between its first and its last message.
    file_bytes
        Size of its MCAP files.

    Raises
    ------
    InputError
        In one line, if rosbags is not installed or the bag cannot be read.
    """

    def __init__(self, path: Path) -> None:
        require("robot")
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import Stores, get_typestore

        self.path, self._store = path, get_typestore(Stores.ROS2_HUMBLE)
        files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if path.is_dir() and os.path.lexists(path / METADATA):
            read_bytes(inside(path, METADATA), MAX_TOPICS_BYTES)
        chunks = {file.name: checked_chunks(file) for file in files}
        self.file_bytes = sum(file.stat().st_size for file in files)
        for file in sorted(path.glob("*.db3")) if path.is_dir() else ():
            refuse_pointer(file)
        compressed_files = path.is_dir() and any(path.glob("*.zstd"))
        with self.reading():
            self._reader = Reader(path)
            if not compressed_files:
                self._reader.open()
                weakref.finalize(self, self._reader.close)
            self._check_index(chunks)
            if compressed_files or self._reader.compression_mode:
                raise InputError(f"{path}: its files or messages are compressed, but only chunks of MCAP files may be")
            self.connections: Sequence[Any] = self._reader.connections
            self.duration_ns = self._reader.duration

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Convert exceptions of rosbags to an InputError of one line."""
        from rosbags.rosbag2 import ReaderError
        from rosbags.serde import SerdeError
        from rosbags.typesys import TypesysError

        with as_input_error(self.path, "a ROS 2 bag that can be read"):
            try:
                yield
            except (ReaderError, SerdeError, TypesysError, AssertionError, zstd().ZstdError) as error:
                raise ValueError(str(error) or "is damaged") from None

    def messages(self, connections: Sequence[Any], start: int | None = None, stop: int | None = None) -> Iterator[Any]:
        """Yield connection, bag time in ns and data of the messages of some connections, between two times."""
        # For no connections, rosbags would return all messages.
        return self._reader.messages(connections, start, stop) if connections else iter(())

    def message(self, raw: bytes, kind: str) -> Any:
        """Deserialize a message of a type."""
        return self._store.deserialize_cdr(raw, kind)

    def _check_index(self, chunks: Mapping[str, frozenset[Chunk]]) -> None:
        """Raise ValueError if the index of an MCAP file refers to chunks other than the checked ones."""
        for storage in getattr(self._reader.storage, "storages", [self._reader.storage]):
            for entry in getattr(storage, "chunks", ()):
                chunk = Chunk(
                    entry.chunk_start_offset, entry.compression, entry.uncompressed_size, entry.compressed_size
                )
                if chunk not in chunks[Path(storage.path).name]:
                    raise ValueError(f"its index refers to a chunk at byte {chunk.start} that does not exist")


def topics_text(names: Iterable[str]) -> str:
    """List the first names, sorted, and the number of others."""
    names = sorted(names)
    names_text = ", ".join(name[:60] for name in names[:_MAX_NAMES]) or "none"
    return names_text if len(names) <= _MAX_NAMES else f"{names_text} and {len(names) - _MAX_NAMES} more"


def stamp_of(raw: bytes) -> int:
    """Return the stamp in ns from the header at the start of a serialized message."""
    seconds, rest = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, 4)
    return int(seconds) * _NS_PER_S + int(rest)


class Chunk(NamedTuple):
    """A chunk of messages: start of its record, compression, and size in bytes before and after compression."""

    start: int
    compression: str
    content_bytes: int
    stored_size: int


def zstd() -> Any:
    """Return the Zstandard module, the one that rosbags uses."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


def checked_chunks(path: Path) -> frozenset[Chunk]:
    """Return the chunks of an MCAP file.

    Raises InputError if the file is truncated, or a chunk would take more memory than allowed.
    """
    stored_size, chunks, topics = stored_bytes(path), [], 0
    with as_input_error(path, "an MCAP file that can be read"), path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError("does not begin like an MCAP file")
        opcode = 0
        while opcode != _FOOTER:
            start, head = file.tell(), file.read(_RECORD.size)
            opcode, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, stored_size)
            end = file.tell() + length
            if end > stored_size:
                raise InputError(f"{path}: truncated, expected a complete MCAP file (`mcap recover` saves the rest)")
            topics += length if opcode == _CHANNEL else 0
            if topics > MAX_TOPICS_BYTES:
                raise ValueError("descriptions of topics are too long")
            if opcode == _CHUNK:
                chunks.append(_chunk(path, file, start, end, stored_size))
            file.seek(end)
        if file.read() != MAGIC:
            raise ValueError("does not end like an MCAP file")
    return frozenset(chunks)


def _chunk(path: Path, file: BinaryIO, start: int, end: int, stored_size: int) -> Chunk:
    """Read the chunk whose record ends at `end`, in a file of `stored_size` bytes.

    Raises ValueError if its stated size is wrong, and InputError if it is too large.
    """
    _, _, size, _, name_length = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
    compression = file.read(min(name_length, 16)).decode()
    (length,) = struct.unpack("<Q", file.read(8))
    if compression not in _COMPRESSIONS or length > end - file.tell():
        raise ValueError(f"a chunk of {length} bytes compressed by {compression!r}, expected zstd, lz4 or none")
    check_bytes(path, int(size if compression else length), stored_size)
    if compression == "zstd":
        _check_zstd(file.read(length), int(size))
    elif compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        _check_pieces(LZ4FrameDecompressor(), file.read(length), int(size))
    return Chunk(start, compression, int(size if compression else length), int(length))


def _check_zstd(raw: bytes, stated_bytes: int) -> None:
    """Raise ValueError unless the data are one Zstandard frame with the stated number of bytes.

    A frame need not state its content size: ROS 2 omits it.
    """
    try:
        content_bytes, frame_bytes = zstd().get_frame_info(raw).decompressed_size, zstd().get_frame_size(raw)
        if content_bytes is None:
            _check_pieces(zstd().ZstdDecompressor(), raw, stated_bytes)
            return
    except zstd().ZstdError as error:
        raise ValueError(str(error)) from None
    if content_bytes != stated_bytes or frame_bytes != len(raw):
        raise ValueError(
            f"a chunk states {stated_bytes} bytes, but its data {content_bytes} in {frame_bytes} of {len(raw)} bytes"
        )


def _check_pieces(decompressor: Any, raw: bytes, stated_bytes: int) -> None:
    """Raise ValueError unless the data are one frame with the stated number of bytes, decompressed piece by piece."""
    decompressed = consumed = 0
    while not decompressor.eof:
        piece = raw[consumed : consumed + _PIECE_BYTES] if decompressor.needs_input else b""
        consumed += len(piece)
        produced = len(decompressor.decompress(piece, _PIECE_BYTES))
        decompressed += produced
        if decompressed > stated_bytes or not (piece or produced):
            break
    unused = len(raw) - consumed + len(decompressor.unused_data or b"")
    if not decompressor.eof or decompressed != stated_bytes or unused:
        raise ValueError(f"a chunk states {stated_bytes} bytes, but its data are not one frame of that size")
