"""Pictures are judged by their headers: what would take more memory than any camera's is refused at once."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.picture_data import PictureData, as_grey
from tests.core.images.test_png import DATA, END, header
from tests.soon import soon

NOISE = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)


def file_of(kind: str) -> bytes:
    buffer = BytesIO()
    Image.fromarray(NOISE).save(buffer, kind)
    return buffer.getvalue()


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "BMP"])
def test_pixels_of_every_kind_are_the_same(kind: str) -> None:
    data = PictureData.of(Path("a"), file_of(kind))
    assert (data.size, data.depth, data.significant_bits) == ((30, 20), 8, None)
    assert np.array_equal(data.decoded(), NOISE)
    assert np.abs(data.decoded(grey=True).astype(int) - as_grey(NOISE)).max() <= 1
    assert data.decoded(opacity=True).shape == NOISE.shape


@pytest.mark.parametrize("last", [b"\0\0\0", b"\0\0\1"])
@pytest.mark.parametrize(
    ("colour", "depth", "size"), [(2, 16, (10_950, 10_950)), (6, 16, (7000, 7000)), (6, 8, (10_000, 10_000))]
)
def test_channels_and_depth_count_as_memory(colour: int, depth: int, size: tuple[int, int], last: bytes) -> None:
    raw = header(colour, depth, size, last) + DATA + END
    with soon():
        with pytest.raises(InputError, match="megapixels of 3 x 8 bits, or as many bytes") as error:
            PictureData.of(Path("a.png"), raw)
        assert f"{size[0]}x{size[1]} px of {4 if colour == 6 else 3} x {depth} bits" in str(error.value)


def test_one_side_may_be_too_long() -> None:
    with pytest.raises(InputError, match=r"2000000x50 px, expected .* 1000000 px a side"):
        PictureData.of(Path("a.png"), header(0, 1, (2_000_000, 50)) + DATA + END)


@pytest.mark.parametrize("kind", ["TIFF", "BMP"])
def test_sizes_of_other_kinds_are_judged_too(kind: str) -> None:
    raw = file_of(kind)
    for height in (0, 1 << 30):
        tag = struct.pack("<HHI", 257, 4, 1)
        at = 22 if kind == "BMP" else raw.index(tag) + len(tag)
        changed = raw[:at] + struct.pack("<I", height) + raw[at + 4 :]
        with pytest.raises(InputError, match=r"megapixels|states no size|contradict each other"):
            PictureData.of(Path("a"), changed)


@pytest.mark.parametrize("raw", [b"", b"II+\0" + bytes(60), b"GIF89a" + bytes(60), b"RIFF\0\0\0\0WEBP" + bytes(60)])
def test_files_that_are_not_pictures_are_refused(raw: bytes) -> None:
    with pytest.raises(DamagedPicture, match="expected PNG, JPEG, TIFF or BMP"):
        PictureData.of(Path("a.png"), raw)
