"""MP4 files whose data are in another file, by an alias in their table of references (dref)."""

from __future__ import annotations

import struct

PARENTS = ("moov", "trak", "mdia", "minf", "dinf")
_VOLUME = b"volume"


def with_external_data(raw: bytes, target: str) -> bytes:
    """An MP4 with its index at the end, with the references to its own data replaced by one to a file of this name."""
    return b"".join(_box(name, content, target) for name, content in _boxes(raw))


def _boxes(raw: bytes) -> list[tuple[str, bytes]]:
    found, at = [], 0
    while at + 8 <= len(raw):
        size, name = struct.unpack_from(">I4s", raw, at)
        found.append((name.decode("latin-1"), raw[at + 8 : at + size]))
        at += size
    return found


def _box(name: str, content: bytes, target: str) -> bytes:
    if name in PARENTS:
        content = with_external_data(content, target)
    elif name == "dref":
        content = struct.pack(">II", 0, 1) + _box("alis", _alias(target), target)
    return struct.pack(">I4s", 8 + len(content), name.encode("latin-1")) + content


def _alias(target: str) -> bytes:
    """An alias record of QuickTime with an absolute path, which begins with the name of a volume."""
    path = _VOLUME + target.encode()
    path += bytes(len(path) % 2)
    name = target.rpartition("/")[2].encode()[:63]
    head = bytes(4 + 10) + bytes([len(_VOLUME)]) + _VOLUME.ljust(27, b"\0") + bytes(12)
    levels = bytes(16) + struct.pack(">HH", 1, 1) + bytes(16)
    ends = struct.pack(">HH", 2, len(path)) + path + struct.pack(">HH", 0xFFFF, 0)
    return head + bytes([len(name)]) + name.ljust(63, b"\0") + levels + ends
