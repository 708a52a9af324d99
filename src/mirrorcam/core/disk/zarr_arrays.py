"""Zarr version 3 arrays in recordings, read without Zarr: metadata is checked before anything is decoded.

Metadata follows the Zarr core specification. The supported extensions are regular chunk grids, the default chunk key
encoding, little-endian bytes, and one compressor that states the decoded size: Blosc or Zstandard. Anything else is
refused.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from mirrorcam.core.disk.array_files import as_input_error, check_bytes
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, inside, read_bytes, read_model, stored_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value

METADATA = "zarr.json"
MAX_CHUNKS = 100_000
"""Largest number of chunks of an array that is read completely."""
_SLACK_BYTES = 4096
_ZSTD = b"\x28\xb5\x2f\xfd"


class _Named(Value):
    """A named extension of Zarr, with its configuration."""

    name: str
    configuration: dict[str, Any] = Field(default_factory=dict)


class _Grid(Value):
    chunk_shape: tuple[int, ...]


class _Regular(Value):
    name: Literal["regular"]
    configuration: _Grid


class GroupMetadata(Value):
    """The `zarr.json` of a group; copies of its arrays' metadata in it are not used."""

    model_config = ConfigDict(extra="ignore")

    zarr_format: Literal[3]
    node_type: Literal["group"]
    attributes: dict[str, Any] = Field(default_factory=dict)


class ArrayMetadata(Value):
    """The `zarr.json` of an array."""

    zarr_format: Literal[3]
    node_type: Literal["array"]
    shape: tuple[int, ...]
    data_type: Literal["uint8", "float32", "int64", "float64"]
    chunk_grid: _Regular
    chunk_key_encoding: _Named
    fill_value: float = Field(ge=0, le=0)
    codecs: tuple[_Named, ...]
    attributes: dict[str, Any] = Field(default_factory=dict)
    dimension_names: tuple[str | None, ...] | None = None
    storage_transformers: tuple[()] = ()

    @model_validator(mode="after")
    def _check(self) -> Self:
        chunks = self.chunk_grid.configuration.chunk_shape
        if len(chunks) != len(self.shape) or min((*self.shape, *chunks), default=0) < 1:
            raise ValueError(f"shape {self.shape[:8]} in chunks of {chunks[:8]}, expected positive lengths of both")
        key = self.chunk_key_encoding
        if key.name != "default" or key.configuration.get("separator", "/") != "/":
            raise ValueError("keys of chunks are not encoded as by default")
        names = tuple(codec.name for codec in self.codecs)
        if names not in (("bytes",), ("bytes", "blosc"), ("bytes", "zstd")):
            raise ValueError(f"codecs {' '.join(names)[:80]}, expected bytes, and blosc, zstd or none")
        if self.codecs[0].configuration.get("endian", "little") != "little":
            raise ValueError("bytes are not little-endian")
        return self


def read_attributes(folder: Path) -> dict[str, Any]:
    """Read the attributes of a group, or raise a one-line InputError."""
    return read_model(GroupMetadata, inside(folder, METADATA), LARGEST_LAYOUT_BYTES).attributes


class ZarrArray:
    """A named array of a group, read by chunk or completely.

    Raises a one-line InputError for unsupported metadata, and for links that lead out of the group.

    Attributes
    ----------
    shape, chunk_shape
        Shapes of the array and of its chunks.
    chunk_bytes
        Decoded size of a chunk.
    dtype
        Data type of the array.
    """

    def __init__(self, group: Path, name: str) -> None:
        self._group, self._name = group, name
        path = inside(group, f"{name}/{METADATA}")
        self._metadata = read_model(ArrayMetadata, path)
        self.shape, self.dtype = self._metadata.shape, np.dtype(self._metadata.data_type)
        self.chunk_shape = self._metadata.chunk_grid.configuration.chunk_shape
        self.chunk_bytes = self._bytes_of(self.chunk_shape)
        check_bytes(path, self.chunk_bytes, 0)

    def key(self, index: tuple[int, ...]) -> str:
        """Return the name of a chunk's file in the group."""
        return "/".join((self._name, "c", *map(str, index)))

    def has(self, index: tuple[int, ...]) -> bool:
        """Return whether a chunk has a file; Zarr reads a missing chunk as zeros."""
        return (self._group / self.key(index)).exists()

    def chunk(self, index: tuple[int, ...]) -> NDArray[Any]:
        """Read the chunk at an index; raises a one-line InputError if it is damaged."""
        path, size = inside(self._group, self.key(index)), self.chunk_bytes
        with as_input_error(path, "a chunk that can be read"):
            stored = stored_bytes(path)
            if stored > size + size // 100 + _SLACK_BYTES:
                raise ValueError(f"has more bytes than the {size} of its numbers")
            raw = read_bytes(path, stored)
            codec = self._metadata.codecs[-1].name
            if _stated_bytes(raw, codec) != size:
                raise ValueError(f"holds {_stated_bytes(raw, codec)} bytes of numbers, expected {size}")
            return _decoded(raw, codec, size).view(self.dtype).reshape(self.chunk_shape)

    @property
    def is_complete(self) -> bool:
        """Whether all chunks have files; Zarr writes no file for a chunk of zeros."""
        return all(map(self.has, self._chunk_indices()))

    def read(self) -> NDArray[Any]:
        """Read the complete array; chunks without a file are zero."""
        check_bytes(self._group / self._name / METADATA, self._bytes_of(self.shape), 0)
        values = np.zeros(self.shape, self.dtype)
        for index in filter(self.has, self._chunk_indices()):
            begins = [number * length for number, length in zip(index, self.chunk_shape, strict=True)]
            part = values[tuple(slice(begin, begin + n) for begin, n in zip(begins, self.chunk_shape, strict=True))]
            part[...] = self.chunk(index)[tuple(map(slice, part.shape))]
        return values

    def _chunk_indices(self) -> Iterator[tuple[int, ...]]:
        counts = [-(-length // chunk) for length, chunk in zip(self.shape, self.chunk_shape, strict=True)]
        if math.prod(counts) > MAX_CHUNKS:
            path = self._group / self._name / METADATA
            raise InputError(f"{path}: has more than {MAX_CHUNKS} chunks, expected fewer and larger ones")
        return np.ndindex(*counts)

    def _bytes_of(self, shape: tuple[int, ...]) -> int:
        return self.dtype.itemsize * math.prod(shape)


def _decoded(raw: bytes, codec: str, size: int) -> NDArray[np.uint8]:
    if codec == "bytes":
        return np.frombuffer(raw, np.uint8)
    from numcodecs import Blosc, Zstd

    # The buffer limits the output: a Zstandard chunk may have more frames than the one that stated the size.
    values = np.empty(size, np.uint8)
    (Blosc() if codec == "blosc" else Zstd()).decode(raw, values)
    return values


def _stated_bytes(raw: bytes, codec: str) -> int:
    """Return the decoded size that the header of a chunk states, which decoders allocate."""
    if codec == "bytes":
        return len(raw)
    if codec == "blosc":
        _, size, _, compressed = struct.unpack_from("<IIII", raw)
        if compressed != len(raw):
            raise ValueError(f"{len(raw)} bytes, expected {compressed}")
        return int(size)
    if raw[:4] != _ZSTD or len(raw) < 6:
        raise ValueError("not Zstandard data")
    flags = raw[4]
    is_single = flags >> 5 & 1
    begin = 5 + (0 if is_single else 1) + (0, 1, 2, 4)[flags & 3]
    length = (is_single, 2, 4, 8)[flags >> 6]
    if not length:
        raise ValueError("does not state its size")
    return int.from_bytes(raw[begin : begin + length], "little") + (256 if length == 2 else 0)
