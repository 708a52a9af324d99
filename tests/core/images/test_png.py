"""PNG of every kind is decoded as others decode it; what is damaged or hostile is refused, and nothing is printed."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from io import BytesIO

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirrorcam.core.images import png
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.png import Png, decode_png, significant_bits
from tests.soon import soon

WIDTH, HEIGHT = 21, 13
KINDS = [(colour, 1 << n) for colour, some in {0: 5, 3: 4}.items() for n in range(some)]
KINDS += [(colour, depth) for colour in (2, 4, 6) for depth in (8, 16)]
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))


def chunk(name: bytes, content: bytes, checksum: int | None = None) -> bytes:
    """A chunk of a PNG."""
    right = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", right if checksum is None else checksum)


def header(colour: int = 2, depth: int = 8, size: tuple[int, int] = (WIDTH, HEIGHT), last: bytes = b"\0\0\0") -> bytes:
    """The begin of a PNG, up to its header."""
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBB", *size, depth, colour) + last)


END = chunk(b"IEND", b"")
NOISE = np.random.default_rng(0)


def lines(colour: int, depth: int, filtering: int = 0, rows: int = HEIGHT) -> bytes:
    """Lines of noise, of one filter."""
    row_bytes = (WIDTH * CHANNELS[colour] * depth + 7) // 8
    noise = NOISE.integers(0, 256, (rows, row_bytes), dtype=np.uint8)
    return np.insert(noise, 0, filtering, axis=1).tobytes()


def palette(colour: int, depth: int) -> bytes:
    return chunk(b"PLTE", NOISE.integers(0, 256, 3 << depth, dtype=np.uint8).tobytes()) if colour == 3 else b""


def decoded(raw: bytes, flags: int = cv2.IMREAD_COLOR_RGB, *, opacity: bool = False) -> NDArray[np.uint8]:
    return np.asarray(decode_png(raw, Png.of(raw, "a.png"), "a.png", flags, opacity=opacity))


@pytest.mark.parametrize(("colour", "depth"), KINDS)
def test_every_kind_and_filter_is_decoded_as_by_pillow(colour: int, depth: int) -> None:
    for filtering in range(5):
        data = chunk(b"IDAT", zlib.compress(lines(colour, depth, filtering)))
        raw = header(colour, depth) + palette(colour, depth) + data + END
        image = Image.open(BytesIO(raw))
        if image.mode == "I;16":
            found = decoded(raw, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE)
            assert np.array_equal(found, np.asarray(image))
        else:
            assert np.array_equal(decoded(raw), np.asarray(image.convert("RGB")))


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (21, 13), (8, 8)])
def test_an_interlaced_picture_is_that_without(size: tuple[int, int]) -> None:
    picture = NOISE.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    data = b""
    for column, row, across, down in PASSES:
        part = picture[row::down, column::across]
        data += b"".join(b"\0" + line.tobytes() for line in part if line.size)
    raw = header(size=size, last=b"\0\0\1") + chunk(b"IDAT", zlib.compress(data)) + END
    assert np.array_equal(decoded(raw), picture)


GOOD = zlib.compress(lines(2, 8))
INDEXED = zlib.compress(lines(3, 8))
DATA, INDICES = chunk(b"IDAT", GOOD), chunk(b"IDAT", INDEXED)
ANIMATED = struct.pack(">IIIIIHHBB", 0, WIDTH, HEIGHT, 0, 0, 1, 10, 0, 0)
READ = {
    "data in two": header() + chunk(b"IDAT", GOOD[:50]) + chunk(b"IDAT", GOOD[50:]) + END,
    "data too long": header() + chunk(b"IDAT", zlib.compress(lines(2, 8, rows=40))) + END,
    "profile is none": header() + chunk(b"iCCP", b"a\0\0" + zlib.compress(b"junk")) + DATA + END,
    "profile is junk": header() + chunk(b"iCCP", b"junk") + DATA + END,
    "gamma, colours": header() + chunk(b"gAMA", bytes(4)) + chunk(b"sRGB", b"\x09") + chunk(b"cHRM", b"1") + DATA + END,
    "opacity too short": header() + chunk(b"tRNS", b"\1") + DATA + END,
    "opacity out of range": header() + chunk(b"tRNS", b"\xff" * 6) + DATA + END,
    "opacity of opacity": header(6) + chunk(b"tRNS", bytes(6)) + chunk(b"IDAT", zlib.compress(lines(6, 8))) + END,
    "opacity of more colours": header(3) + chunk(b"PLTE", b"abc") + chunk(b"tRNS", b"\1\2\3") + INDICES + END,
    "index beyond palette": header(3) + chunk(b"PLTE", b"abcdef") + INDICES + END,
    "palette of grey": header(0) + chunk(b"PLTE", b"abc") + chunk(b"IDAT", zlib.compress(lines(0, 8))) + END,
    "text that explodes": header() + chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(50_000_000))) + DATA + END,
    "long text": header() + chunk(b"tEXt", b"a\0" + b"x" * 5_000_000) + DATA + END,
    "no significant bit": header() + chunk(b"sBIT", b"\0\0\0") + DATA + END,
    "orientation is junk": header() + chunk(b"eXIf", b"MM\0*junk") + DATA + END,
    "something after": header() + DATA + END + b"junk" * 100,
    "animation": header() + chunk(b"acTL", bytes(8)) + chunk(b"fcTL", ANIMATED) + DATA + chunk(b"fdAT", GOOD) + END,
    "animation is junk": header() + chunk(b"acTL", b"1") + chunk(b"fcTL", b"2") + DATA + chunk(b"fdAT", b"3") + END,
}
REFUSED = {
    "filter": (header() + chunk(b"IDAT", zlib.compress(lines(2, 8, 7))) + END, "cannot be decoded"),
    "line missing": (header() + chunk(b"IDAT", zlib.compress(lines(2, 8, rows=12))) + END, "part of it is missing"),
    "data cut": (header() + chunk(b"IDAT", GOOD[:-99]) + END, "part of it is missing"),
    "no zlib": (header() + chunk(b"IDAT", b"hello" * 40) + END, "cannot be decoded"),
    "checksum of zlib": (header() + chunk(b"IDAT", GOOD[:-4] + b"abcd") + END, "cannot be decoded"),
    "no data": (header() + END, "part of it is missing"),
    "empty data": (header() + chunk(b"IDAT", b"") + END, "part of it is missing"),
    "checksum": (header() + chunk(b"IDAT", GOOD, 5) + END, "a checksum of its data is wrong"),
    "checksum of a text": (header() + chunk(b"tEXt", b"a\0b", 5) + DATA + END, "a checksum of its data is wrong"),
    "data first": (header()[:8] + DATA + header()[8:] + END, "states no size"),
    "two headers": (header() + header()[8:] + DATA + END, "wrong order"),
    "data apart": (header() + DATA + chunk(b"tEXt", b"a\0b") + DATA + END, "wrong order"),
    "palette last": (header(3) + INDICES + chunk(b"PLTE", b"abc") + END, "wrong order"),
    "two palettes": (header(3) + chunk(b"PLTE", b"abc") * 2 + INDICES + END, "wrong order"),
    "no palette": (header(3) + INDICES + END, "palette"),
    "part of a colour": (header(3) + chunk(b"PLTE", b"abcd") + INDICES + END, "palette"),
    "palette too long": (header(3, 2) + chunk(b"PLTE", b"abc" * 5) + INDICES + END, "palette"),
    "unknown critical part": (header() + chunk(b"ABCD", b"x") + DATA + END, "has an unknown part"),
    "depth": (header(2, 3) + DATA + END, "not a PNG's"),
    "type of colour": (header(5) + DATA + END, "not a PNG's"),
    "interlacing": (header(last=b"\0\0\2") + DATA + END, "not a PNG's"),
    "length": (header() + b"\xff\xff\xff\xffIDAT" + GOOD + END, "part of it is missing"),
}


@pytest.mark.parametrize("case", READ)
def test_pictures_with_odd_parts_are_read_in_silence(case: str, capfd: pytest.CaptureFixture[str]) -> None:
    for flags, opacity in ((cv2.IMREAD_COLOR_RGB, False), (cv2.IMREAD_UNCHANGED, True)):
        assert decoded(READ[case], flags, opacity=opacity).shape[:2] == (HEIGHT, WIDTH)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("case", REFUSED)
def test_damaged_pictures_are_refused_in_silence(case: str, capfd: pytest.CaptureFixture[str]) -> None:
    raw, reason = REFUSED[case]
    with pytest.raises(DamagedPicture, match=reason):
        decoded(raw)
    assert capfd.readouterr() == ("", "")


def test_data_that_explode_take_the_memory_of_the_picture() -> None:
    raw = header() + chunk(b"IDAT", zlib.compress(bytes(100_000_000))) + END
    tracemalloc.start()
    with soon():
        decoded(raw)
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


def test_large_pictures_are_decoded_as_small_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = decoded(header() + DATA + END)
    with monkeypatch.context() as patch:
        patch.setattr(png, "_LARGE_BYTES", 0)
        assert np.array_equal(decoded(header() + DATA + END), picture)
        for case in READ:
            decoded(READ[case])


def test_significant_bits_are_those_of_colours() -> None:
    assert significant_bits(header() + DATA + END) is None
    assert significant_bits(header(2, 16) + chunk(b"sBIT", b"\x0a\x0c\x0b") + DATA + END) == 12
    assert significant_bits(header(4, 16) + chunk(b"sBIT", b"\x0c\x10") + DATA + END) == 12
    assert significant_bits(header(0, 16) + DATA + chunk(b"sBIT", b"\x0c") + END) is None


def test_more_parts_than_a_picture_needs_are_refused_at_once() -> None:
    raw = cv2.imencode(".png", np.zeros((2, 2), np.uint8))[1].tobytes()
    empty = b"\x00\x00\x00\x00IDAT" + zlib.crc32(b"IDAT").to_bytes(4)
    at = raw.index(b"IDAT") - 4
    with pytest.raises(DamagedPicture, match="more than 200000 parts"):
        decode_png(raw[:at] + empty * 200_000 + raw[at:], Png.of(raw, "a"), "a", cv2.IMREAD_GRAYSCALE)
