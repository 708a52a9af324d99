"""Picture data, recognised by content: PNG, JPEG, TIFF or BMP, whose header is checked before decoding."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.bounds import LARGEST_PICTURE_PX, LARGEST_PICTURE_SIDE_PX
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.bmp import BMP_BEGIN, Bmp, decode_bmp
from mirrorcam.core.images.jpeg import JPEG_BEGIN, DamagedPicture, Jpeg, decode_jpeg, overlong
from mirrorcam.core.images.png import PNG_BEGIN, PNG_END, Png, decode_png, significant_bits
from mirrorcam.core.images.tiff import BIG_TIFF_BEGINS, TIFF_BEGINS, Tiff, decode_tiff

EXPECTED = "PNG, JPEG, TIFF or BMP"
_LARGEST_BYTES = 3 * LARGEST_PICTURE_PX


@dataclass(frozen=True)
class PictureData:
    """The data of a picture with a valid header and a complete end.

    Attributes
    ----------
    name
        Name of the file in messages.
    raw
        The content of its file.
    header
        Parsed header.
    size
        Width and height in px.
    depth
        Bits per sample: 8, 16, or fewer than 8.
    """

    name: str
    raw: bytes
    header: Png | Jpeg | Tiff | Bmp
    size: tuple[int, int]
    depth: int

    @classmethod
    def of(cls, path: Path, raw: bytes) -> PictureData:
        """Check the content of a file.

        Raises DamagedPicture for data that is not a picture or is truncated, and InputError for a picture larger than
        any camera's.
        """
        name = str(path)
        if raw.startswith(PNG_BEGIN):
            png = Png.of(raw, name)
            data, channels = cls(name, raw, png, png.size, png.depth), png.channels
            complete = raw.rfind(PNG_END) >= 0  # fast: it is at the end
        elif raw.startswith(JPEG_BEGIN):
            jpeg = Jpeg.of(raw)
            if jpeg.is_overlong:
                raise DamagedPicture(overlong(name))
            data, channels, complete = cls(name, raw, jpeg, jpeg.size(raw), 8), 3, jpeg.end is not None
        elif raw.startswith(TIFF_BEGINS):
            tiff = Tiff.of(raw, name)
            data, channels, complete = cls(name, raw, tiff, tiff.size, tiff.depth), tiff.channels, True
        elif raw.startswith(BMP_BEGIN):
            bmp = Bmp.of(raw, name)
            data, channels, complete = cls(name, raw, bmp, bmp.size, 8), 3, True
        else:
            kind = " of BigTIFF" if raw.startswith(BIG_TIFF_BEGINS) else ""
            raise DamagedPicture(f"{name}: not an image{kind} that can be decoded, expected {EXPECTED}")
        if not complete:
            raise DamagedPicture(f"{name}: image is truncated")
        data._check_size(channels)
        return data

    def _check_size(self, channels: int) -> None:
        width, height = self.size
        if not width * height:
            raise DamagedPicture(f"{self.name}: damaged, its header states no size")
        limit = f"expected a picture of at most {LARGEST_PICTURE_PX // 1_000_000} megapixels"
        if width * height > LARGEST_PICTURE_PX:
            raise InputError(f"{self.name}: {width}x{height} px, {limit}")
        if max(width, height) > LARGEST_PICTURE_SIDE_PX:
            raise InputError(f"{self.name}: {width}x{height} px, {limit}, and {LARGEST_PICTURE_SIDE_PX} px a side")
        if width * height * channels * max(self.depth, 8) > 8 * _LARGEST_BYTES:
            samples = f"{channels} x {self.depth} bits a pixel"
            raise InputError(f"{self.name}: {width}x{height} px of {samples}, {limit} of 3 x 8 bits, or as many bytes")

    @property
    def significant_bits(self) -> int | None:
        """Stated number of significant bits per sample, or None."""
        return significant_bits(self.raw) if isinstance(self.header, Png) else None

    def decoded(self, *, grey: bool = False, opacity: bool = False) -> NDArray[Any]:
        """Decode the data: (h, w) grey, (h, w, 3) RGB, or (h, w, 4) with opacity if requested and present.

        Samples have 8 or 16 bits, as stored. `grey` does not convert 16-bit colours. Raises DamagedPicture.
        """
        header = self.header
        if isinstance(header, Jpeg):
            return decode_jpeg(self.raw, header, self.name, grey=grey)
        if isinstance(header, Png):
            if opacity:
                flags = cv2.IMREAD_UNCHANGED
            elif self.depth == 16:
                flags = cv2.IMREAD_ANYDEPTH | (cv2.IMREAD_COLOR_RGB if header.is_coloured else cv2.IMREAD_GRAYSCALE)
            else:
                flags = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR_RGB
            image = decode_png(self.raw, header, self.name, flags, opacity=opacity)
            if opacity and image.ndim == 3:
                image = image[..., [2, 1, 0, 3][: image.shape[2]]]
            return image
        decoded: NDArray[Any] = (
            decode_bmp(self.raw, header, self.name)
            if isinstance(header, Bmp)
            else decode_tiff(self.raw, header, self.name)
        )
        if not opacity and decoded.shape[2:] == (4,):
            decoded = decoded[..., :3]
        return as_grey(decoded) if grey and decoded.dtype == np.uint8 else decoded


def as_grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert a picture (h, w) or (h, w, 3) to grey (h, w)."""
    grey = image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    return np.asarray(grey, dtype=np.uint8)
