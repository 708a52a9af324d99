"""MP4 files whose data are in a different file, by an alias in their data reference box (dref)."""

from __future__ import annotations

import struct

PARENTS = ("moov", "trak", "mdia", "minf", "dinf")
_VOLUME = b"volume"


def with_external_data(raw: bytes, target: str) -> bytes:
    """Return an MP4 whose references to its own data are replaced by one to a target file; its index is at the end."""
    return b"".join(_box(name, content, target) for name, content in _boxes(raw))


def _boxes(raw: bytes) -> list[tuple[str, bytes]]:
    boxes, offset = [], 0
    while offset + 8 <= len(raw):
        size, name = struct.unpack_from(">I4s", raw, offset)
        boxes.append((name.decode("latin-1"), raw[offset + 8 : offset + size]))
        offset += size
    return boxes


def _box(name: str, content: bytes, target: str) -> bytes:
    if name in PARENTS:
        content = with_external_data(content, target)
    elif name == "dref":
        content = struct.pack(">II", 0, 1) + _box("alis", _alias(target), target)
    return struct.pack(">I4s", 8 + len(content), name.encode("latin-1")) + content


def _alias(target: str) -> bytes:
    """Return a QuickTime alias record with an absolute path, which begins with the name of a volume."""
    path = _VOLUME + target.encode()
    path += bytes(len(path) % 2)
    name = target.rpartition("/")[2].encode()[:63]
    head = bytes(4 + 10) + bytes([len(_VOLUME)]) + _VOLUME.ljust(27, b"\0") + bytes(12)
    levels = bytes(16) + struct.pack(">HH", 1, 1) + bytes(16)
    ends = struct.pack(">HH", 2, len(path)) + path + struct.pack(">HH", 0xFFFF, 0)
    return head + bytes([len(name)]) + name.ljust(63, b"\0") + levels + ends
