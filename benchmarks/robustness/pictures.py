"""Damaged pictures: refused, or read with at most a few wrong pixels."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.robustness.damage import damaged_bytes
from benchmarks.robustness.guard import Category, refused_well
from mirrorcam.core.images.pictures import picture_size, read_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.view_images import read_rgba

SIZE = (640, 480)
WRONG_BY = 8
"""Difference of a wrong pixel, of 255."""
WRONG_PART = 0.02
"""Part of the pixels of an accepted picture that may be wrong."""

JPEG_KINDS: dict[str, tuple[int, ...]] = {
    "baseline": (),
    "4:4:4": (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
    "optimised": (cv2.IMWRITE_JPEG_OPTIMIZE, 1),
    "progressive": (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "restarts": (cv2.IMWRITE_JPEG_RST_INTERVAL, 40),
    "quality 75": (cv2.IMWRITE_JPEG_QUALITY, 75),
}
PNG_KINDS = ("colour", "grey PNG", "16 bits", "opacity", "palette", "interlaced")


def scene() -> NDArray[np.uint8]:
    """A picture (h, w, 3) as of a camera: smooth light, a checkerboard and noise."""
    random = np.random.default_rng(0)
    light = cv2.resize(random.uniform(40, 220, (7, 9, 3)), SIZE, interpolation=cv2.INTER_CUBIC)
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    turned = (u * 0.97 + v * 0.22, v * 0.97 - u * 0.22)
    inside = (np.abs(turned[0] - 370) < 150) & (np.abs(turned[1] - 160) < 120)
    squares = ((turned[0] // 30).astype(int) + (turned[1] // 30).astype(int)) % 2
    light[inside] = np.where(squares, 200, 40)[inside, None]
    noisy = cv2.GaussianBlur(light, (0, 0), 0.8) + random.normal(0, 2.5, light.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


@cache
def good() -> dict[str, bytes]:
    """The files of the same scene, by their kind."""
    picture = scene()
    found = {
        kind: cv2.imencode(".jpg", picture[..., ::-1], [*options])[1].tobytes() for kind, options in JPEG_KINDS.items()
    }
    found["grey"] = cv2.imencode(".jpg", picture[..., 1])[1].tobytes()
    found["photograph"] = _with_thumbnail(picture)
    wide = picture.astype(np.uint16) * 257
    alpha = np.concatenate([picture, np.full((*picture.shape[:2], 1), 200, np.uint8)], axis=-1)
    images: tuple[NDArray[Any], ...] = (picture, picture[..., 1], wide, alpha)
    for kind, image in zip(PNG_KINDS, images, strict=False):
        found[kind] = cv2.imencode(".png", image)[1].tobytes()
    small = Image.fromarray(picture).quantize(64)
    found["palette"] = _saved(small, "PNG")
    found["interlaced"] = interlaced(picture)
    return found


def _saved(image: Image.Image, kind: str, **options: object) -> bytes:
    stream = BytesIO()
    image.save(stream, kind, **options)
    return stream.getvalue()


def _with_thumbnail(picture: NDArray[np.uint8]) -> bytes:
    """A JPEG with an EXIF segment that holds a smaller JPEG, as of a phone."""
    thumbnail = cv2.imencode(".jpg", np.ascontiguousarray(picture[::4, ::4]))[1].tobytes()[:60_000]
    plain = _saved(Image.fromarray(picture), "JPEG", quality=90)
    return plain[:2] + b"\xff\xe1" + (2 + len(thumbnail)).to_bytes(2) + thumbnail + plain[2:]


def chunk(name: bytes, content: bytes) -> bytes:
    """A chunk of a PNG file."""
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(width: int, height: int, bits: int, colours: int, data: bytes, interlaces: int = 0) -> bytes:
    """A PNG file of compressed data."""
    header = struct.pack(">IIBBBBB", width, height, bits, colours, 0, 0, interlaces)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def interlaced(picture: NDArray[np.uint8]) -> bytes:
    """An RGB picture as a PNG in Adam7's seven passes."""
    passes = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
    rows = [row for v, u, dv, du in passes for row in picture[v::dv, u::du]]
    data = zlib.compress(b"".join(b"\x00" + row.tobytes() for row in rows))
    return png(picture.shape[1], picture.shape[0], 8, 2, data, 1)


def _huge_jpeg() -> bytes:
    raw = bytearray(good()["baseline"])
    at = raw.index(b"\xff\xc0")
    raw[at + 5 : at + 9] = b"\xff\xff\xff\xff"
    return bytes(raw)


def _of_frame(marker: int, bits: int = 8) -> bytes:
    """A JPEG whose frame header is of another process, or states other bits."""
    raw = bytearray(good()["baseline"])
    at = raw.index(b"\xff\xc0")
    raw[at + 1], raw[at + 4] = marker, bits
    return bytes(raw)


def _bomb() -> bytes:
    """A PNG of 118 megapixels in 2 MB."""
    packer = zlib.compressobj(1)
    rows = [packer.compress(bytes(10_900 * 3 + 1)) for _ in range(10_900)]
    return png(10_900, 10_900, 8, 2, b"".join(rows) + packer.flush())


def _cut_after(marker: bytes, more: int) -> bytes:
    raw = good()["baseline"]
    return raw[: raw.index(marker) + more]


ODD_FILES: dict[str, tuple[str, Callable[[], bytes]]] = {
    "CMYK": ("a.jpg", lambda: _saved(Image.fromarray(scene()).convert("CMYK"), "JPEG")),
    "arithmetic coding": ("a.jpg", lambda: _of_frame(0xC9)),
    "12 bits": ("a.jpg", lambda: _of_frame(0xC1, 12)),
    "lossless": ("a.jpg", lambda: _of_frame(0xC3)),
    "cut after the scan's header": ("a.jpg", lambda: _cut_after(b"\xff\xda", 14)),
    "cut in the tables": ("a.jpg", lambda: _cut_after(b"\xff\xc4", 20)),
    "huge JPEG": ("a.jpg", _huge_jpeg),
    "bomb": ("a.png", _bomb),
    "GIF": ("a.png", lambda: _saved(Image.fromarray(scene()), "GIF")),
    "empty": ("a.jpg", lambda: b""),
    "end alone": ("a.JPG", lambda: b"\xff\xd8\xff\xd9"),
    "header alone": ("a.PNG", lambda: good()["colour"][:33]),
    "no data": ("a.png", lambda: png(640, 480, 8, 2, b"")),
    "too few data": ("a.png", lambda: png(640, 480, 8, 2, zlib.compress(bytes(1921 * 240)))),
    "palette without colours": ("a.png", lambda: png(640, 480, 8, 3, zlib.compress(bytes(641 * 480)))),
}
READ = frozenset({"CMYK", "bomb"})
"""Odd files that may be read."""


def attempt(seed: int, folder: Path) -> str:
    """Read a damaged picture, or an odd one."""
    random = np.random.default_rng(seed)
    if random.random() < 0.1:
        return _odd(str(random.choice(sorted(ODD_FILES))), folder)
    kind = str(random.choice(sorted(good())))
    suffix = ".png" if kind in PNG_KINDS else ".jpg"
    grey = bool(random.random() < 0.2)
    path = folder / f"whole{suffix}"
    path.write_bytes(good()[kind])
    expected = read_image(path, grey=grey)
    damaged = folder / f"damaged{suffix.upper() if seed % 2 else suffix}"
    damaged.write_bytes(damaged_bytes(good()[kind], random))
    try:
        size = picture_size(damaged)
        found = read_image(damaged, grey=grey) if seed % 5 else read_rgba(damaged)[0]
    except InputError as error:
        return refused_well(str(error).replace(str(folder), "")) or _unnamed(damaged, error)
    if found.shape[1::-1] != size:
        return f"{kind}: {found.shape=}, {size=}"
    if found.ndim == 3 and expected.ndim == 2:
        expected = read_image(path)
    part = wrong_part(found, expected)
    return f"{kind}: {part:.0%} of the pixels are wrong, and accepted" if part > WRONG_PART else ""


def wrong_part(found: NDArray[np.uint8], expected: NDArray[np.uint8]) -> float:
    """The part of the pixels of a picture that are wrong; all where its size is."""
    if found.shape != expected.shape:
        return 1.0
    wrong = np.abs(found.astype(np.int16) - expected) > WRONG_BY
    return float(np.mean(wrong.any(axis=-1) if wrong.ndim == 3 else wrong))


def _odd(kind: str, folder: Path) -> str:
    name, content = ODD_FILES[kind]
    path = folder / name
    path.write_bytes(content())
    try:
        read_image(path)
    except InputError as error:
        return refused_well(str(error).replace(str(folder), "")) or _unnamed(path, error)
    return "" if kind in READ else f"{kind}: accepted"


def _unnamed(path: Path, error: InputError) -> str:
    return "" if str(error).startswith(str(path)) else f"names no file: {str(error)[:80]}"


CATEGORY = Category("pictures", 1_000, attempt)
