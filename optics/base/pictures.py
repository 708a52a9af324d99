"""Pictures as files: PNG and JPEG by their content, of 8 bits a channel, whole or refused."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.arguments import AnyPath, path_of
from mirrorcam.optics.base.bounds import LARGEST_PICTURE_PX
from mirrorcam.optics.base.files import read_bytes, write_bytes
from mirrorcam.optics.base.jpeg import JPEG_BEGIN, DamagedPicture, Jpeg, decode_jpeg
from mirrorcam.optics.base.values import InputError

JPEG_ENDINGS = (".jpg", ".jpeg")
PICTURE_ENDINGS = (".png", *JPEG_ENDINGS)
"""Endings of names of pictures, in lower case, wherever pictures are read."""
LARGEST_FILE_BYTES = 1 << 30

_PNG_BEGIN, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_ORIENTATION = 0x0112


def is_picture(path: Path) -> bool:
    """Return whether a file is named like a picture; capitals count as small letters."""
    return path.suffix.lower() in PICTURE_ENDINGS


def pictures_in(paths: Sequence[Path]) -> list[Path]:
    """The pictures among files and folders, in order: a folder stands for all pictures in it, by name."""
    found: list[Path] = []
    for path in paths:
        inside = sorted(filter(is_picture, path.iterdir())) if path.is_dir() else [path]
        if not inside:
            raise InputError(f"{path}: holds no picture, expected {', '.join(PICTURE_ENDINGS)} files")
        found += inside
    return found


def read_image(path: AnyPath, *, grey: bool = False) -> NDArray[np.uint8]:
    """Read a picture of 8 bits a channel, PNG or JPEG by its content.

    Parameters
    ----------
    path
        File to read.
    grey
        Convert to grey.

    Returns
    -------
    ndarray of uint8
        (h, w, 3) in RGB, or (h, w) in grey, with rows as on the sensor: a rotation in the EXIF data is not applied.

    Raises
    ------
    InputError
        If the file is missing or larger than any camera's picture.
    DamagedPicture
        If it is neither PNG nor JPEG, cut short, or its data are not what was written.
    """
    path = path_of("path", path)
    raw = read_bytes(path, LARGEST_FILE_BYTES)
    header = _header_of(path, raw)
    if header.jpeg is None:
        return _read_png(path, raw, cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR_RGB).astype(np.uint8, copy=False)
    return decode_jpeg(raw, header.jpeg, str(path), grey=grey)


def read_opacity(path: Path) -> NDArray[np.uint8] | None:
    """Read the opacity (h, w) of a PNG of 8 bits a channel; None of a picture without. Raises as `read_image`."""
    raw = read_bytes(path, LARGEST_FILE_BYTES)
    if _header_of(path, raw).jpeg is not None:
        return None
    image = _read_png(path, raw, cv2.IMREAD_UNCHANGED)
    return np.ascontiguousarray(image[..., 3]) if image.dtype == np.uint8 and image.shape[2:] == (4,) else None


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height of a picture in px, by its header alone; raises as `read_image`, but for what lies behind."""
    return _header_of(path, read_bytes(path, LARGEST_FILE_BYTES)).size


def orientation(path: Path) -> int:
    """EXIF orientation of a picture, 1 to 8: 1, also where the file states none, is as on the sensor."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(read_bytes(path, LARGEST_FILE_BYTES))) as image:
            found = image.getexif().get(_ORIENTATION, 1)
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError):
        return 1
    return found if isinstance(found, int) and 1 <= found <= 8 else 1


def check_size(path: Path, size: tuple[int, int], expected: tuple[int, int], whose: str) -> None:
    """Raise InputError for a picture or video of another width and height, px, than `whose`.

    The message names a rotation in the EXIF data, which other programs apply.
    """
    if size != expected:
        turned = " as stored (its EXIF data turns it)" if is_picture(path) and orientation(path) > 1 else ""
        raise InputError(f"{path}: {size[0]}x{size[1]} px{turned}, expected {expected[0]}x{expected[1]} of {whose}")


@dataclass(frozen=True)
class _Header:
    """Width and height of a picture in px, and the segments of a JPEG; None for a PNG."""

    size: tuple[int, int]
    jpeg: Jpeg | None = None


def _header_of(path: Path, raw: bytes) -> _Header:
    if raw.startswith(_PNG_BEGIN):
        size = struct.unpack(">II", raw[16:24]) if raw[12:16] == b"IHDR" and len(raw) >= 24 else (0, 0)
        header, whole = _Header(size), raw.rfind(_PNG_END) >= 0  # found at once: it is the end
    elif raw.startswith(JPEG_BEGIN):
        jpeg = Jpeg.of(raw)
        header, whole = _Header(jpeg.size(raw), jpeg), jpeg.end is not None
    else:
        raise DamagedPicture(f"{path}: not an image that can be decoded, expected PNG or JPEG")
    if not whole:
        raise DamagedPicture(f"{path}: image is truncated")
    width, height = header.size
    if not width * height:
        raise DamagedPicture(f"{path}: damaged, its header states no size")
    if width * height > LARGEST_PICTURE_PX:
        most = f"{LARGEST_PICTURE_PX // 1_000_000} megapixels"
        raise InputError(f"{path}: {width}x{height} px, expected a picture of at most {most}")
    return header


def _png_chunks(raw: bytes) -> Iterator[tuple[int, int]]:
    """Begin and end of the name and content of each chunk of a PNG that is there in full, up to its last."""
    at = len(_PNG_BEGIN)
    while (end := at + 8 + int.from_bytes(raw[at : at + 4])) + 4 <= len(raw):
        yield at + 4, end
        if raw[at + 4 : at + 8] == b"IEND":
            return
        at = end + 4


def _read_png(path: Path, raw: bytes, flags: int) -> NDArray[Any]:
    """Decode a PNG whose checksums are all right: the decoder itself would write of others to standard error."""
    content, last = memoryview(raw), b""
    for begin, end in _png_chunks(raw):
        last = raw[begin : begin + 4]
        if zlib.crc32(content[begin:end]) != int.from_bytes(raw[end : end + 4]):
            raise DamagedPicture(f"{path}: damaged, a checksum of its data is wrong")
    if last != b"IEND":
        raise DamagedPicture(f"{path}: damaged, a part of it is missing")
    try:
        image = cv2.imdecode(np.frombuffer(raw, np.uint8), flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        image = None
    if image is None:
        raise DamagedPicture(f"{path}: damaged, its data cannot be decoded")
    return image


def encoded_image(image: NDArray[np.uint8], suffix: str, jpeg_quality: int = 95) -> bytes:
    """The bytes of the file of an RGB (h, w, 3) or grey (h, w) 8-bit image, in the format of the suffix."""
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if suffix in JPEG_ENDINGS else []
    encoded, buffer = cv2.imencode(suffix, image if image.ndim == 2 else image[..., ::-1], options)
    if not encoded:
        raise ValueError(f"no encoder for {image.shape=}")
    return buffer.tobytes()


def write_image(path: Path, image: NDArray[np.uint8]) -> None:
    """Write an RGB (h, w, 3) or grey (h, w) 8-bit image atomically, in the format of the suffix."""
    if not is_picture(path):
        raise InputError(f"{path}: no image format for this suffix, expected .png or .jpg")
    write_bytes(path, encoded_image(image, path.suffix.lower()))
