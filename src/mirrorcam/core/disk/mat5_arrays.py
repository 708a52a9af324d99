"""Variables of MATLAB 5 to 7 .mat files: numbers, strings and structs; tags are checked before reading.

The layout follows MathWorks' "MAT-File Format". Each element is a tag (type and size) and its content: a variable is
of type miMATRIX or, since MATLAB 7, of type miCOMPRESSED, a deflated miMATRIX element.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mirrorcam.core.disk.array_files import as_input_error, check_bytes
from mirrorcam.core.disk.files import read_bytes, stored_bytes

HEADER_BYTES = 128
LARGEST_FILE_BYTES = 1 << 31
_MATRIX, _COMPRESSED = 14, 15
# Types of numbers in the file, and the element types of array classes.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16-{}", 16: "utf-8", 17: "utf-16-{}", 18: "utf-32-{}"}
_STRUCT, _CHAR = 2, 4
_IS_COMPLEX = 0x08
_MAX_DEPTH = 4

Order = Literal["<", ">"]
Parts = Iterator[tuple[int, memoryview]]


def read_mat5(path: Path, names: Collection[str], expected: str) -> dict[str, Any]:
    """Read variables by name: arrays, strings, and structs as dicts; None for other classes.

    Raises a one-line InputError for a file that is not `expected`, and for arrays above the memory limit. Checksums
    reveal damage to compressed variables.
    """
    stored, total_bytes = stored_bytes(path), 0
    raw, variables = read_bytes(path, LARGEST_FILE_BYTES), dict[str, Any]()
    with as_input_error(path, expected):
        order = _order(raw)
        for kind, content in _elements(memoryview(raw)[HEADER_BYTES:], order):
            inflate, size = zlib.decompressobj(), len(content)
            if kind == _COMPRESSED:
                kind, size = struct.unpack(f"{order}II", inflate.decompress(content, 8))
            if kind != _MATRIX:
                raise ValueError(f"an element of type {kind}, expected a variable")
            total_bytes += size
            check_bytes(path, total_bytes, stored)
            if inflate.unconsumed_tail:
                content = _inflated(inflate, size)
            name, value = _Matrix(order, path, stored).read(content, names)
            if name in names:
                if name in variables:
                    raise ValueError(f"{name} appears twice")
                variables[name] = value
    return variables


def _order(raw: bytes) -> Order:
    order_mark = raw[HEADER_BYTES - 2 : HEADER_BYTES]
    if order_mark not in (b"IM", b"MI"):
        raise ValueError("has no header of MATLAB 5 to 7")
    return "<" if order_mark == b"IM" else ">"


def _inflated(inflate: zlib._Decompress, size: int) -> memoryview:
    """Return the rest of a compressed variable of a given size, without its optional padding."""
    inflated = inflate.decompress(inflate.unconsumed_tail, size + 8)
    if not inflate.eof or len(inflated) < size:
        raise ValueError("a compressed variable is cut short or too large")
    return memoryview(inflated)[:size]


def _elements(content: memoryview, order: Order) -> Parts:
    """Yield type and content of each element; a small element has both in eight bytes."""
    at = 0
    while at < len(content):
        if len(content) - at < 8:
            raise ValueError("an element is cut short")
        kind, size = struct.unpack_from(f"{order}II", content, at)
        if kind >> 16:
            kind, size, begin, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
            if size > 4:
                raise ValueError("a small element of more than four bytes")
        else:
            begin = at + 8
            # Compressed elements have no padding between them.
            end = begin + (size if kind == _COMPRESSED else -(-size // 8) * 8)
        if begin + size > len(content):
            raise ValueError("an element is cut short")
        yield kind, content[begin : begin + size]
        at = end


def _next_part(parts: Parts) -> tuple[int, memoryview]:
    for part in parts:
        return part
    raise ValueError("an element is missing")


class _Matrix:
    """Reader of miMATRIX elements."""

    def __init__(self, order: Order, path: Path, stored: int) -> None:
        self._order, self._path, self._stored = order, path, stored

    def read(self, content: memoryview, names: Collection[str]) -> tuple[str, Any]:
        """Return name and value of a variable; the value is read only if the name is requested."""
        flags, shape, name, parts = self._header(content)
        return name, self._value(flags, shape, parts, 0) if name in names else None

    def _header(self, content: memoryview) -> tuple[int, tuple[int, ...], str, Parts]:
        parts = _elements(content, self._order)
        flags = self._number(*_next_part(parts))
        if flags & 0xFF not in {*_CLASSES, _STRUCT, _CHAR}:
            return flags, (), "", parts
        shape = tuple(int(length) for length in self._numbers(*_next_part(parts)))
        if not 2 <= len(shape) <= 8 or min(shape) < 0:
            raise ValueError(f"an array of shape {shape[:8]}")
        return flags, shape, bytes(_next_part(parts)[1]).decode("ascii"), parts

    def _value(self, flags: int, shape: tuple[int, ...], parts: Parts, depth: int) -> Any:
        kind, count = flags & 0xFF, math.prod(shape)
        if kind == _STRUCT:
            return self._fields(count, parts, depth)
        if kind == _CHAR:
            coding, text = _next_part(parts)
            return bytes(text).decode(_TEXTS[coding].format("le" if self._order == "<" else "be"))
        if kind not in _CLASSES:
            return None
        if flags >> 8 & _IS_COMPLEX:
            raise ValueError("an array of complex numbers, expected real ones")
        dtype = np.dtype(_CLASSES[kind])
        check_bytes(self._path, count * dtype.itemsize, self._stored)
        numbers = self._numbers(*_next_part(parts))
        if numbers.size != count:
            raise ValueError(f"{numbers.size} numbers, expected {count} of shape {shape}")
        return numbers.astype(dtype, copy=False).reshape(shape, order="F")

    def _fields(self, count: int, parts: Parts, depth: int) -> dict[str, Any] | None:
        """The fields of a struct by name; None for an array of structs."""
        if count != 1 or depth > _MAX_DEPTH:
            return None
        length = self._number(*_next_part(parts))
        names = bytes(_next_part(parts)[1])
        if not 0 < length <= 64 or len(names) % length:
            raise ValueError("a struct without field names")
        keys = [names[at : at + length].partition(b"\x00")[0].decode("ascii") for at in range(0, len(names), length)]
        fields = {}
        for key, (kind, content) in zip(keys, parts, strict=True):
            if kind != _MATRIX:
                raise ValueError(f"a field of type {kind}, expected an array")
            flags, shape, _, inner = self._header(content) if len(content) else (0, (), "", iter(()))
            fields[key] = self._value(flags, shape, inner, depth + 1)
        return fields

    def _number(self, kind: int, content: memoryview) -> int:
        return int(self._numbers(kind, content)[0])

    def _numbers(self, kind: int, content: memoryview) -> Any:
        if kind not in _TYPES:
            raise ValueError(f"numbers of an unknown type {kind}")
        return np.frombuffer(content, f"{self._order}{_TYPES[kind]}")
