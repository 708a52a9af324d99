"""Decode TIFF data of a single picture, after checking its tags."""

from __future__ import annotations

import struct
from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture

TIFF_BEGINS = (b"II*\x00", b"MM\x00*")
BIG_TIFF_BEGINS = (b"II+\x00", b"MM\x00+")
_KIND, _WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC = 254, 256, 257, 258, 259, 262
_FILL_ORDER, _OFFSETS, _SAMPLES, _ROWS, _BYTES, _PLANES = 266, 273, 277, 278, 279, 284
_PREDICTOR, _COLOURS, _TILE_WIDTH, _FORMAT = 317, 320, 322, 339
_DEFAULTS = {_KIND: 0, _BITS: 1, _COMPRESSION: 1, _FILL_ORDER: 1, _SAMPLES: 1, _PLANES: 1, _PREDICTOR: 1, _FORMAT: 1}
_COMPRESSIONS = {1: "none", 5: "LZW", 8: "deflate", 32_946: "deflate", 32_773: "PackBits"}
_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE = 0, 1, 2, 3
_CHANNELS = {_WHITE_IS_ZERO: (1,), _BLACK_IS_ZERO: (1,), _RGB: (3, 4), _PALETTE: (1,)}
_TYPES = {1: "B", 3: "H", 4: "I"}
_REDUCED = 1
_MAX_PAGES = 16
_MAX_VALUES = 1 << 20
"""Maximum number of values of a tag: strips have at least one line."""
_READ_TAGS = frozenset(
    (_WIDTH, _HEIGHT, _OFFSETS, _ROWS, _BYTES, _COLOURS, _TILE_WIDTH, _PHOTOMETRIC, *_DEFAULTS)
)  # fmt: skip


@dataclass(frozen=True)
class Tiff:
    """The tags of a TIFF with one picture, with grey values or colours of 8 or 16 bits in strips.

    Attributes
    ----------
    size
        Width and height in px.
    depth
        Bits per sample.
    samples
        Stored samples per pixel.
    order
        Byte order: "<" or ">".
    """

    size: tuple[int, int]
    depth: int
    samples: int
    order: str
    photometric: int
    compression: int
    predictor: int
    rows: int
    offsets: tuple[int, ...]
    sizes: tuple[int, ...]
    colours: tuple[int, ...]

    @classmethod
    def of(cls, raw: bytes, name: str) -> Tiff:
        """Read the tags; raises DamagedPicture if they are damaged, and InputError for an unsupported TIFF."""
        order = "<" if raw[:2] == b"II" else ">"
        try:
            tags, next_page = _tags(raw, order, struct.unpack_from(f"{order}I", raw, 4)[0], _READ_TAGS)
            for _ in range(_MAX_PAGES):
                if not next_page:
                    break
                page, next_page = _tags(raw, order, next_page, {_KIND})
                if not page.get(_KIND, (0,))[0] & _REDUCED:
                    raise InputError(f"{name}: holds several pictures, expected a TIFF with one")
            return cls._of_tags(tags, order, name)
        except (struct.error, LookupError):
            raise DamagedPicture(f"{name}: damaged or truncated, its tags cannot be read") from None

    @classmethod
    def _of_tags(cls, tags: dict[int, tuple[int, ...]], order: str, name: str) -> Tiff:
        def first(tag: int) -> int:
            return tags[tag][0] if tag in tags else _DEFAULTS[tag]

        width, height = first(_WIDTH), first(_HEIGHT)
        depths, samples, photometric = set(tags.get(_BITS, (1,))), first(_SAMPLES), first(_PHOTOMETRIC)
        unsupported = {
            "with an unsupported compression": first(_COMPRESSION) not in _COMPRESSIONS,
            "in tiles": _TILE_WIDTH in tags,
            "with floating-point or signed numbers": first(_FORMAT) != 1,
            "of an unsupported depth": depths not in ({8}, {16}) or (photometric == _PALETTE and depths != {8}),
            "of unsupported colours": samples not in _CHANNELS.get(photometric, ()),
            "in separate planes": first(_PLANES) != 1 and samples > 1,
            "with an unsupported bit order or predictor": first(_FILL_ORDER) != 1 or first(_PREDICTOR) not in (1, 2),
        }
        problem = next((text for text, applies in unsupported.items() if applies), None)
        if problem is not None:
            expected = "grey or RGB of 8 or 16 bits in strips, uncompressed or by LZW, deflate or PackBits"
            raise InputError(f"{name}: a TIFF {problem}, expected {expected}")
        rows = min(tags.get(_ROWS, (height,))[0], height)
        strips = -(-height // rows) if rows else 0
        if width and height and (not strips or not len(tags[_OFFSETS]) == len(tags[_BYTES]) == strips):
            raise DamagedPicture(f"{name}: damaged, its tags contradict each other")
        return cls(
            (width, height), depths.pop(), samples, order, photometric, first(_COMPRESSION), first(_PREDICTOR), rows,
            tags[_OFFSETS], tags[_BYTES], tags.get(_COLOURS, ()),
        )  # fmt: skip

    @property
    def channels(self) -> int:
        """Channels of the decoded pixels."""
        return 3 if self.photometric == _PALETTE else self.samples


def _tags(raw: bytes, order: str, at: int, wanted: Set[int]) -> tuple[dict[int, tuple[int, ...]], int]:
    """Return the wanted tags of a directory, and the offset of the next; raises struct.error beyond the file."""
    (count,) = struct.unpack_from(f"{order}H", raw, at)
    tags: dict[int, tuple[int, ...]] = {}
    for number in range(count):
        entry = at + 2 + 12 * number
        tag, kind, length = struct.unpack_from(f"{order}HHI", raw, entry)
        if tag in wanted and kind in _TYPES and 0 < length <= _MAX_VALUES and tag not in tags:
            layout = f"{order}{length}{_TYPES[kind]}"
            is_inline = struct.calcsize(layout) <= 4
            begin = entry + 8 if is_inline else struct.unpack_from(f"{order}I", raw, entry + 8)[0]
            tags[tag] = struct.unpack_from(layout, raw, begin)
    return tags, struct.unpack_from(f"{order}I", raw, at + 2 + 12 * count)[0]


def decode_tiff(raw: bytes, tiff: Tiff, name: str) -> NDArray[Any]:
    """Decode TIFF data: grey (h, w), RGB (h, w, 3), or RGB with opacity (h, w, 4), of 8 or 16 bits.

    Raises DamagedPicture for data that is truncated or cannot be decompressed.
    """
    import av

    width, height = tiff.size
    line_bytes = width * tiff.samples * tiff.depth // 8
    for number, (offset, size) in enumerate(zip(tiff.offsets, tiff.sizes, strict=True)):
        min_bytes = line_bytes * min(tiff.rows, height - number * tiff.rows) if tiff.compression == 1 else 1
        if offset + size > len(raw):
            raise DamagedPicture(f"{name}: image is truncated")
        if size < min_bytes:
            raise DamagedPicture(f"{name}: damaged, a part of it is missing")
    decoder: Any = av.CodecContext.create("tiff", "r")
    decoder.options = {"err_detect": "explode"}  # otherwise, undecodable lines stay black
    decoder.thread_count = 1
    try:
        frames = decoder.decode(av.Packet(_with_own_tags(raw, tiff)))
        image = frames[0].to_ndarray().reshape(height, width, tiff.samples)
    except (av.FFmpegError, LookupError, ValueError):
        raise DamagedPicture(f"{name}: damaged, its data cannot be decoded") from None
    if tiff.photometric == _WHITE_IS_ZERO:
        image[..., 0] = (1 << tiff.depth) - 1 - image[..., 0]
    if tiff.photometric == _PALETTE:
        return _colours(tiff, name)[image[..., 0]]
    return image[..., 0] if tiff.samples == 1 else image


def _colours(tiff: Tiff, name: str) -> NDArray[np.uint8]:
    """Return the colours (256, 3) of a palette."""
    if len(tiff.colours) != 3 * 256:
        raise DamagedPicture(f"{name}: damaged, its palette is missing or has a wrong length")
    colours = np.reshape(tiff.colours, (3, 256)).T
    return (colours >> (8 if colours.max() > 255 else 0)).astype(np.uint8)


def _with_own_tags(raw: bytes, tiff: Tiff) -> bytes:
    """Return TIFF data with only the tags that determine the pixels: the decoder fails on some others."""
    photometric = _RGB if tiff.photometric == _RGB else _BLACK_IS_ZERO
    shorts: dict[int, Sequence[int]] = {
        _BITS: (tiff.depth,) * tiff.samples,
        _COMPRESSION: (tiff.compression,),
        _PHOTOMETRIC: (photometric,),
        _SAMPLES: (tiff.samples,),
        _PLANES: (1,),
        _PREDICTOR: (tiff.predictor,),
    }
    longs: dict[int, Sequence[int]] = {
        _WIDTH: tiff.size[:1],
        _HEIGHT: tiff.size[1:],
        _OFFSETS: tiff.offsets,
        _ROWS: (tiff.rows,),
        _BYTES: tiff.sizes,
    }
    fields = sorted([(tag, 3, "H", values) for tag, values in shorts.items()] + [
        (tag, 4, "I", values) for tag, values in longs.items()
    ])  # fmt: skip
    begin = len(raw) + len(raw) % 2
    arrays_offset, entries = begin + 2 + 12 * len(fields) + 4, b""
    arrays = b""
    for tag, kind, letter, values in fields:
        packed = struct.pack(f"{tiff.order}{len(values)}{letter}", *values)
        if len(packed) > 4:
            value = struct.pack(f"{tiff.order}I", arrays_offset + len(arrays))
            arrays += packed
        else:
            value = packed.ljust(4, b"\x00")
        entries += struct.pack(f"{tiff.order}HHI", tag, kind, len(values)) + value
    directory = struct.pack(f"{tiff.order}H", len(fields)) + entries + bytes(4) + arrays
    return b"".join((raw[:4], struct.pack(f"{tiff.order}I", begin), raw[8:], bytes(begin - len(raw)), directory))
