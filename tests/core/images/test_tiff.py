"""TIFF is decoded as OpenCV and Pillow write it; damage and other kinds are refused, and nothing is printed."""

from __future__ import annotations

import struct
from io import BytesIO
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.tiff import Tiff, decode_tiff
from tests.soon import soon

NONE, LZW, DEFLATE, PACK_BITS = 1, 5, 8, 32_773
SHAPES = {"grey": (64, 80), "RGB": (64, 80, 3), "RGBA": (64, 80, 4)}


def noise(kind: str, depth: int) -> NDArray[np.uint8 | np.uint16]:
    random = np.random.default_rng(0)
    dtype = np.uint8 if depth == 8 else np.uint16
    return np.asarray(cv2.GaussianBlur(random.integers(0, 1 << depth, SHAPES[kind]).astype(dtype), (0, 0), 2), dtype)


def written(image: NDArray[np.uint8 | np.uint16], compression: int) -> bytes:
    swapped = image if image.ndim == 2 else image[..., [2, 1, 0, 3][: image.shape[2]]]
    return cv2.imencode(".tif", np.ascontiguousarray(swapped), [cv2.IMWRITE_TIFF_COMPRESSION, compression])[1].tobytes()


def saved(mode: str, **options: Any) -> bytes:
    buffer = BytesIO()
    Image.fromarray(noise("RGB", 8)).convert(mode).save(buffer, "TIFF", **options)
    return buffer.getvalue()


def decoded(raw: bytes) -> NDArray[np.uint8 | np.uint16]:
    return decode_tiff(raw, Tiff.of(raw, "a.tif"), "a.tif")


@pytest.mark.parametrize("compression", [NONE, LZW, DEFLATE, PACK_BITS])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("kind", SHAPES)
def test_pixels_are_those_that_opencv_wrote(kind: str, depth: int, compression: int) -> None:
    image = noise(kind, depth)
    assert np.array_equal(decoded(written(image, compression)), image)


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_adobe_deflate", "packbits"])
@pytest.mark.parametrize("mode", ["L", "P", "RGB", "RGBA"])
def test_pixels_are_those_that_pillow_wrote(mode: str, compression: str | None) -> None:
    raw = saved(mode, compression=compression)
    image = Image.open(BytesIO(raw))
    assert np.array_equal(decoded(raw), np.asarray(image.convert("RGB") if mode == "P" else image))


def test_numbers_of_either_order_are_read() -> None:
    grey = noise("grey", 16)
    buffer = BytesIO()
    Image.frombytes("I;16B", (80, 64), grey.astype(">u2").tobytes()).save(buffer, "TIFF")
    assert buffer.getvalue().startswith(b"MM")
    assert np.array_equal(decoded(buffer.getvalue()), grey)


def test_white_may_be_zero() -> None:
    raw = written(noise("grey", 8), NONE)
    photometric = struct.pack("<HHI", 262, 3, 1) + struct.pack("<H", 1)
    assert photometric in raw
    inverted = raw.replace(photometric, photometric[:-2] + b"\0\0")
    assert np.array_equal(decoded(inverted), 255 - noise("grey", 8))


@pytest.mark.parametrize("compression", [LZW, DEFLATE])
def test_damage_and_truncation_are_refused_in_silence(compression: int, capfd: pytest.CaptureFixture[str]) -> None:
    raw = written(noise("RGB", 8), compression)
    random, refused = np.random.default_rng(1), 0
    for _ in range(40):
        damaged = bytearray(raw)
        for place in random.integers(8, len(raw) - 300, 4):
            damaged[place] ^= 0xFF
        try:
            decoded(bytes(damaged))
        except DamagedPicture:
            refused += 1
    assert refused > 30  # LZW has no checksum
    for kept in np.linspace(8, len(raw) - 1, 20).astype(int):
        with pytest.raises(DamagedPicture):
            decoded(raw[:kept])
    assert capfd.readouterr() == ("", "")


def test_any_damage_to_tags_is_refused_in_one_line_or_harmless(capfd: pytest.CaptureFixture[str]) -> None:
    raw = written(noise("grey", 8)[:8, :8], NONE)
    for place in range(4, len(raw)):
        for value in (0, 1, 0xFF):
            damaged = bytearray(raw)
            damaged[place] = value
            try:
                tiff = Tiff.of(bytes(damaged), "a.tif")
                if tiff.size[0] * tiff.size[1] < 1_000_000:
                    decode_tiff(bytes(damaged), tiff, "a.tif")
            except InputError as error:
                assert "\n" not in str(error)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        (saved("1"), "of an unsupported depth"),
        (saved("F"), "floating-point"),
        (saved("CMYK"), "of unsupported colours"),
        (saved("RGB", compression="jpeg"), "with an unsupported compression"),
        (saved("RGB", save_all=True, append_images=[Image.new("RGB", (9, 9))]), "holds several pictures"),
    ],
)
def test_other_kinds_are_refused_by_name(raw: bytes, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        decoded(raw)


def test_directories_in_a_circle_and_long_tags_end_at_once() -> None:
    circle = struct.pack("<2sHIH", b"II", 42, 8, 1) + struct.pack("<HHII", 254, 4, 1, 1) + struct.pack("<I", 8)
    long = struct.pack("<2sHIH", b"II", 42, 8, 1) + struct.pack("<HHII", 273, 1, 2**32 - 1, 0) + bytes(4)
    with soon():
        for raw in (circle, long, b"II*\0", b"MM\0*" + b"\xff" * 8):
            with pytest.raises(InputError):
                decoded(raw)
