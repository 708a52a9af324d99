"""BMP is decoded as Pillow decodes it, and refused where it is cut short or of another kind."""

from __future__ import annotations

import struct
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.bmp import Bmp, decode_bmp
from mirrorcam.core.images.jpeg import DamagedPicture


def bmp(mode: str, width: int = 37) -> bytes:
    """A BMP of noise."""
    noise = np.random.default_rng(0).integers(0, 256, (31, width, 3), dtype=np.uint8)
    buffer = BytesIO()
    Image.fromarray(noise).convert(mode).save(buffer, "BMP")
    return buffer.getvalue()


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA"])
@pytest.mark.parametrize("width", [1, 4, 37])
def test_pixels_are_those_of_pillow(mode: str, width: int) -> None:
    raw = bmp(mode, width)
    found = decode_bmp(raw, Bmp.of(raw, "a.bmp"), "a.bmp")
    assert np.array_equal(found, np.asarray(Image.open(BytesIO(raw)).convert("RGB")))


def test_the_first_line_may_be_the_top_one() -> None:
    raw = bmp("RGB")
    upright = raw[:22] + struct.pack("<i", -31) + raw[26:]
    found, flipped = (decode_bmp(each, Bmp.of(each, "a.bmp"), "a.bmp") for each in (raw, upright))
    assert np.array_equal(found, flipped[::-1])


def test_pixels_of_four_bits_are_two_in_a_byte() -> None:
    colours = np.arange(64, dtype=np.uint8).reshape(16, 4)
    head = b"BM" + struct.pack("<IHHI", 0, 0, 0, 118) + struct.pack("<IiiHHIIiiII", 40, 3, 1, 1, 4, 0, 0, 0, 0, 0, 0)
    raw = head + colours.tobytes() + bytes([0x1F, 0x70, 0, 0])
    found = decode_bmp(raw, Bmp.of(raw, "a.bmp"), "a.bmp")
    assert np.array_equal(found[0], colours[[1, 15, 7], 2::-1])


@pytest.mark.parametrize("mode", ["1", "L", "RGB"])
@pytest.mark.parametrize("kept", [2, 30, 60, 0.5, -1])
def test_data_that_are_cut_short_are_refused(mode: str, kept: float) -> None:
    raw = bmp(mode)
    cut = raw[: int(kept * len(raw)) if isinstance(kept, float) else kept]
    with pytest.raises(DamagedPicture, match="truncated"):
        decode_bmp(cut, Bmp.of(cut, "a.bmp"), "a.bmp")


@pytest.mark.parametrize(("at", "value"), [(28, 16), (28, 7), (30, 1), (30, 2), (14, 12), (18, 2**32 - 1), (46, 2**31)])
def test_other_headers_are_refused_in_one_line(at: int, value: int) -> None:
    raw = bmp("L")
    with pytest.raises(InputError) as error:
        Bmp.of(raw[:at] + struct.pack("<I", value) + raw[at + 4 :], "a.bmp")
    assert "\n" not in str(error.value)
