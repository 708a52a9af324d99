"""Arrays in NumPy's .npy and .npz files: headers are checked before memory is allocated, and nothing is unpickled."""

from __future__ import annotations

import math
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import stored_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.core.values import InvalidValue

LARGEST_BYTES = 400_000_000
"""Array bytes that a file of any size may contain; with a reader's copies, they take less than 1 GB of memory."""
MAX_GROWTH = 8
"""Arrays of more than `LARGEST_BYTES`, as of large scenes, may have up to this many times the size of their files."""
_PIECE_BYTES = 1 << 17
_DIRECTORY_BYTES = 1 << 20
"""Largest file list of an archive; reading it takes 20 times as much memory. An array takes 60 bytes of it."""
_ERRORS = (
    *(ValueError, TypeError, LookupError, ArithmeticError, AttributeError, OSError, EOFError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)
"""Exceptions that decoders raise for invalid files."""


@contextmanager
def as_input_error(path: Path, expected: str) -> Iterator[None]:
    """Convert exceptions of a file's decoders to a one-line InputError: `path` is not `expected`, and the reason.

    The block should contain only reading and decoding. An InputError passes unchanged.
    """
    try:
        yield
    except _ERRORS as error:
        if isinstance(error, InputError) and not isinstance(error, InvalidValue):
            raise
        text = str(getattr(error, "strerror", None) or error)
        reason = " ".join(text.split()) or type(error).__name__
        raise InputError(shortened(f"{path}: not {expected}: {reason}")) from None


def check_bytes(path: Path, size: int, stored: int) -> None:
    """Raise InputError if arrays of `size` bytes exceed the memory limit for files of `stored` bytes."""
    max_bytes = max(LARGEST_BYTES, MAX_GROWTH * stored)
    if size > max_bytes:
        megabytes = min(size, 10**18) // 1_000_000
        raise InputError(f"{path}: states arrays of {megabytes} MB, expected at most {max_bytes // 1_000_000} MB")


def read_npy(path: Path) -> NDArray[Any]:
    """Read an .npy file of numbers, booleans or text; raises a one-line InputError for anything else."""
    stored = stored_bytes(path)
    with as_input_error(path, "an .npy file that can be read"), path.open("rb") as stream:
        return _array(stream, path, stored, stored)


def read_npz(
    path: Path, names: Sequence[str], expected: str = "an .npz file that can be read"
) -> Mapping[str, NDArray[Any]]:
    """Read those of the named arrays that an .npz file contains, as `read_npy` does.

    Their checksums reveal damage. The InputError for an invalid file states that it is not `expected`.
    """
    stored = stored_bytes(path)
    with as_input_error(path, expected), _Archive(path) as file, zipfile.ZipFile(file) as archive:
        stored_members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        members = {name: stored_members[name] for name in names if name in stored_members}
        check_bytes(path, sum(info.file_size for info in members.values()), stored)
        arrays = {}
        for name, info in members.items():
            # Other decompressors do not limit their output.
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"{name} is not compressed by deflate")
            with archive.open(info) as stream:
                arrays[name] = _array(stream, path, info.file_size, stored)
        return arrays


class _Archive(FileIO):
    """An open archive that limits single reads: `zipfile` reads the list of its files at once."""

    def read(self, size: int | None = -1) -> bytes:
        """Read bytes; raises ValueError for a list of files that is too long."""
        if size is not None and size > _DIRECTORY_BYTES:
            raise ValueError("too many files in one archive")
        return super().read(size)


def _array(stream: IO[bytes], path: Path, size: int, stored: int) -> NDArray[Any]:
    """Read the array in a stream of `size` bytes, including its header."""
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"header of version {version}, expected 1 or 2")
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    try:
        shape, columns_first, dtype = read_header(stream)
    except (SyntaxError, TokenError, MemoryError):  # Python parses the header
        raise ValueError("its header is not an array's") from None
    if dtype.kind not in "uifbcU" or dtype.names is not None or dtype.subdtype is not None or not dtype.itemsize:
        raise ValueError(f"holds {str(dtype)[:40]}, expected numbers or text")
    if any(length < 0 or isinstance(length, bool) for length in shape):
        raise ValueError("its shape has a negative length")
    array_bytes = dtype.itemsize * math.prod(shape)
    check_bytes(path, array_bytes, stored)
    if stream.tell() + array_bytes != size:
        raise ValueError(f"has {size - stream.tell()} bytes of numbers, expected {array_bytes} for its shape")
    content = np.empty(array_bytes, np.uint8)
    for begin in range(0, array_bytes, _PIECE_BYTES):
        piece = stream.read(min(_PIECE_BYTES, array_bytes - begin))
        if len(piece) != min(_PIECE_BYTES, array_bytes - begin):
            raise EOFError("is cut short")
        content[begin : begin + len(piece)] = np.frombuffer(piece, np.uint8)
    return content.view(dtype).reshape(shape, order="F" if columns_first else "C")
