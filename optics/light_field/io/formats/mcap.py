"""Light fields in ROS 2 bags: written by `BagWriter`, or recorded again from its topics; read frame by frame.

rosbags reads the messages. Like the `mcap` library, it decompresses an entire chunk of an MCAP file, however large the
result, so chunks are checked before they are decompressed into memory (https://mcap.dev/spec).
"""

from __future__ import annotations

import os
import struct
import sys
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.array_files import as_input_error, check_bytes
from mirrorcam.core.disk.files import inside, json_of, model_from, read_bytes, refuse_pointer, stored_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.bag_writer import BagWriter, need_rosbags
from mirrorcam.optics.light_field.io.light_field_format import Contents, Format, StoredFrames, depthless_writer
from mirrorcam.optics.light_field.io.ros_messages import (
    VIEWS_TOPIC,
    WEIGHTS_TOPIC,
    encoding_of,
    frame_messages,
    latched_messages,
    view_topic,
)
from mirrorcam.optics.light_field.io.views_file import SCHEMA, ViewsFile, light_field_of_fields, views_of_fields
from mirrorcam.optics.light_field.light_field import LightField

METADATA = "metadata.yaml"
TEXT, ARRAY, IMAGE = "std_msgs/msg/String", "std_msgs/msg/Float32MultiArray", "sensor_msgs/msg/Image"
_NS_PER_S = 10**9
_MAX_NAMES = 3
"""Number of names that a message lists."""
View = tuple[int, int]
MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _CHANNEL, _CHUNK = 0x02, 0x04, 0x06
MAX_TOPICS_BYTES = 400_000
"""Maximum size of all topics' descriptions, whose quality of service is YAML that rosbags parses slowly; those of a
light
field take less than 1 kB per view."""
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_COMPRESSIONS = ("", "zstd", "lz4")
_PIECE_BYTES = 1 << 16


class StoredBag(StoredFrames):
    """The light fields of a bag (an MCAP file or a rosbag2 folder), each read on access.

    A frame consists of the images of all views with one stamp. Frames that lack a view are left out; the first and last
    ones of a bag recorded over a network may be incomplete.

    Parameters
    ----------
    path
        The bag.

    Attributes
    ----------
    stamps_ns
        Stamps of the frames, ns, ascending.
    incomplete
        Number of incomplete frames, which are left out.

    Raises
    ------
    InputError
        In one line, if the bag cannot be read, or contains no light field or those of several cameras.
    """

    def __init__(self, path: Path) -> None:
        need_rosbags()
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import Stores, get_typestore

        self.path, self._store = path, get_typestore(Stores.ROS2_HUMBLE)
        files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if path.is_dir() and os.path.lexists(path / METADATA):
            read_bytes(inside(path, METADATA), MAX_TOPICS_BYTES)
        chunks = {file.name: checked_chunks(file) for file in files}
        self._file_bytes = sum(file.stat().st_size for file in files)
        for file in sorted(path.glob("*.db3")) if path.is_dir() else ():
            refuse_pointer(file)
        compressed_files = path.is_dir() and any(path.glob("*.zstd"))
        with _reading(path):
            self._reader = Reader(path)
            if not compressed_files:
                self._reader.open()
                weakref.finalize(self, self._reader.close)
            self._check_index(chunks)
            if compressed_files or self._reader.compression_mode:
                raise InputError(f"{path}: its files or messages are compressed, but only chunks of MCAP files may be")
            description, namespace = self._geometry()
            views = views_of_fields(description.views, str(path))
            shape = (views.rows, views.cols, views.height_px, views.width_px)
            self._dtype, self._channels = np.dtype(description.dtype or "uint8"), description.channels
            frame_bytes = self._dtype.itemsize * self._channels + np.dtype(np.float32).itemsize
            check_bytes(path, frame_bytes * int(np.prod([float(length) for length in shape])), self._file_bytes)
            self._topics = {f"{namespace}{view_topic(view)}/image_rect": view for view in np.ndindex(shape[:2])}
            weights = self._weights(f"{namespace}{WEIGHTS_TOPIC}", shape)
            empty = np.zeros((*shape, self._channels), self._dtype)
            self._empty = light_field_of_fields({**description.views, "samples": empty, "weights": weights}, str(path))
            self._frame_times = self._frames()
        self.stamps_ns = tuple(self._frame_times)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def _frame(self, index: int) -> LightField:
        stamp = self.stamps_ns[index]
        samples = np.empty_like(self._empty.samples)
        with _reading(self.path):
            first, last = self._frame_times[stamp]
            for _, view, raw in self._images(first, last + 1):
                if _stamp_of(raw) == stamp:
                    samples[view] = self._pixels(raw, samples.shape[2:])
        return LightField.of(self._empty, samples, self._empty.weights)

    def _check_index(self, chunks: Mapping[str, frozenset[Chunk]]) -> None:
        """Raise ValueError if the index of an MCAP file refers to chunks other than the checked ones."""
        for storage in getattr(self._reader.storage, "storages", [self._reader.storage]):
            for entry in getattr(storage, "chunks", ()):
                chunk = Chunk(
                    entry.chunk_start_offset, entry.compression, entry.uncompressed_size, entry.compressed_size
                )
                if chunk not in chunks[Path(storage.path).name]:
                    raise ValueError(f"its index refers to a chunk at byte {chunk.start} that does not exist")

    def _geometry(self) -> tuple[ViewsFile, str]:
        """Return the bag's description of its light field, and the namespace of its topics."""
        descriptions: dict[str, ViewsFile] = {}
        connections = [
            connection
            for connection in self._reader.connections
            if connection.topic.endswith(f"/{VIEWS_TOPIC}") and connection.msgtype == TEXT
        ]
        for connection, _, raw in self._messages(connections):
            message: Any = self._store.deserialize_cdr(raw, TEXT)
            if SCHEMA in message.data:
                where = f"{self.path}: {connection.topic}"
                description = model_from(ViewsFile, where, json_of(where, message.data.encode()))
                descriptions[connection.topic.removesuffix(VIEWS_TOPIC)] = description
        if not descriptions:
            topics = _shortened_list(sorted({connection.topic for connection in self._reader.connections}))
            raise InputError(f"{self.path}: contains no light field: topics are {topics}, expected .../{VIEWS_TOPIC}")
        if len(descriptions) > 1:
            cameras = _shortened_list(sorted(descriptions))
            raise InputError(
                f"{self.path}: contains the light fields of {len(descriptions)} cameras ({cameras}), expected one"
            )
        ((namespace, description),) = descriptions.items()
        return description, namespace

    def _messages(self, connections: Sequence[Any], start: int | None = None, stop: int | None = None) -> Iterator[Any]:
        """Return the messages of some connections; for none, rosbags would return all."""
        return self._reader.messages(connections, start, stop) if connections else iter(())

    def _weights(self, topic: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Read the weights (t, s, v, u), which are the same for all frames."""
        wanted = [conn for conn in self._reader.connections if conn.topic == topic and conn.msgtype == ARRAY]
        for _, _, raw in self._messages(wanted):
            message: Any = self._store.deserialize_cdr(raw, ARRAY)
            return np.asarray(message.data, np.float32).reshape(shape)
        raise InputError(f"{self.path}: has no message on {topic}, expected the weights of the views")

    def _images(self, start: int | None = None, stop: int | None = None) -> Iterator[tuple[int, View, bytes]]:
        """Yield bag time in ns, view and data of the views' images, between two times."""
        wanted = [conn for conn in self._reader.connections if conn.topic in self._topics and conn.msgtype == IMAGE]
        for connection, time_ns, raw in self._messages(wanted, start, stop):
            yield time_ns, self._topics[connection.topic], raw

    def _frames(self) -> Mapping[int, tuple[int, int]]:
        """Return the stamps of all frames, ascending, with the first and last bag time of their images."""
        descriptions: dict[int, dict[View, int]] = {}
        for time_ns, view, raw in self._images():
            descriptions.setdefault(_stamp_of(raw), {})[view] = time_ns
        complete = {
            stamp: views.values() for stamp, views in sorted(descriptions.items()) if len(views) == len(self._topics)
        }
        self.incomplete = len(descriptions) - len(complete)
        if not complete:
            available = {view for views in descriptions.values() for view in views}
            missing = next((topic for topic, view in self._topics.items() if view not in available), None)
            reason = "no stamp that all views have" if missing is None else f"no image on {missing}"
            raise InputError(f"{self.path}: has {reason}, expected an image of each view at every stamp")
        return {stamp: (min(times), max(times)) for stamp, times in complete.items()}

    def _pixels(self, raw: bytes, shape: tuple[int, ...]) -> NDArray[Any]:
        """Decode the pixels (v, u, c) of an image message; raises ValueError for a different size or encoding."""
        message: Any = self._store.deserialize_cdr(raw, IMAGE)
        height, width, channels = shape
        encoding = encoding_of(self._dtype, channels)
        actual = (message.width, message.height, message.encoding, bool(message.is_bigendian))
        if actual != (width, height, encoding, False):
            raise ValueError(
                f"an image is {actual[0]}x{actual[1]} {actual[2][:20]!r}, expected {width}x{height} {encoding!r}"
            )
        row_bytes = width * channels * self._dtype.itemsize
        if message.step < row_bytes or len(message.data) != message.step * height:
            raise ValueError(
                f"an image has {len(message.data)} bytes in rows of {message.step}, expected {height} rows"
            )
        rows = np.ascontiguousarray(message.data.reshape(height, message.step)[:, :row_bytes])
        return rows.view(self._dtype.newbyteorder("<")).reshape(shape)


def _shortened_list(names: Sequence[str]) -> str:
    """List the first names, and the number of others."""
    names_text = ", ".join(name[:60] for name in names[:_MAX_NAMES]) or "none"
    return names_text if len(names) <= _MAX_NAMES else f"{names_text} and {len(names) - _MAX_NAMES} more"


def _stamp_of(raw: bytes) -> int:
    """Return the stamp in ns from the header at the start of a serialized message."""
    seconds, rest = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, 4)
    return int(seconds) * _NS_PER_S + int(rest)


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Convert exceptions of rosbags to an InputError of one line."""
    from rosbags.rosbag2 import ReaderError
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    with as_input_error(path, "a ROS 2 bag that can be read"):
        try:
            yield
        except (ReaderError, SerdeError, TypesysError, AssertionError, zstd().ZstdError) as error:
            raise ValueError(str(error) or "is damaged") from None


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


def is_bag(path: Path) -> bool:
    """Return whether a path is named as an MCAP file, or is a rosbag2 folder."""
    return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix.lower() == ".mcap"


def write_bag(path: Path, light_field: LightField) -> None:
    """Write one light field as a bag with one frame at time 0."""
    with BagWriter(path) as bag:
        bag.write([*latched_messages(light_field, 0), *frame_messages(light_field, 0)], 0)


def _contents(bag: StoredBag) -> Contents:
    return Contents(bag, is_recording=True, times_s=[stamp / 1e9 for stamp in bag.stamps_ns])


FORMAT = Format(
    name="mcap",
    ending=".mcap",
    detect=is_bag,
    read=lambda path, assumed: _contents(StoredBag(path)),
    write=depthless_writer(write_bag),
)
