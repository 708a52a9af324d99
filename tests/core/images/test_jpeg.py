"""JPEG data as cameras write it are read; data of which libjpeg warns are damaged."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
import simplejpeg
from numpy.typing import NDArray

from mirrorcam.core.images.jpeg import DamagedPicture, Jpeg, decode_jpeg
from tests.soon import soon

TABLES = 0xC4


def picture() -> NDArray[np.uint8]:
    random = np.random.default_rng(0)
    smooth = cv2.resize(random.uniform(20, 230, (6, 9, 3)), (160, 96), interpolation=cv2.INTER_CUBIC)
    return np.clip(smooth + random.normal(0, 3, smooth.shape), 0, 255).astype(np.uint8)


def encoded(*options: int) -> bytes:
    return cv2.imencode(".jpg", picture(), [*options])[1].tobytes()


def read(raw: bytes) -> NDArray[np.uint8]:
    return decode_jpeg(raw, Jpeg.of(raw), "frame")


@pytest.mark.parametrize("padding", [b"\x00", b"\x00\x00\x00", b"\xff\x00", b"\xff\x00\xff\x00"])
def test_padding_before_restarts_as_from_webcams_is_not_damage(padding: bytes) -> None:
    raw = encoded(cv2.IMWRITE_JPEG_RST_INTERVAL, 5)
    scan = Jpeg.of(raw).scan(raw)
    padded = raw[:scan] + re.sub(rb"(?=\xff[\xd0-\xd7\xd9])", lambda _: padding, raw[scan:])
    with pytest.raises(ValueError, match="extraneous"):
        simplejpeg.decode_jpeg(padded)
    assert np.array_equal(read(padded), read(raw))


def test_bytes_between_data_and_marker_that_are_no_padding_are_damage() -> None:
    raw = encoded(cv2.IMWRITE_JPEG_RST_INTERVAL, 5)
    scan = Jpeg.of(raw).scan(raw)
    changed = raw[:scan] + re.sub(rb"(?=\xff[\xd0-\xd7\xd9])", b"\x55\x21\x13", raw[scan:])
    with pytest.raises(DamagedPicture, match=r"^frame: damaged, Corrupt JPEG data: \d+ extraneous bytes before marker"):
        read(changed)


def test_lost_data_are_not_taken_for_padding() -> None:
    raw = bytearray(encoded(cv2.IMWRITE_JPEG_RST_INTERVAL, 5))
    second = [match.start() for match in re.finditer(rb"\xff[\xd0-\xd7]", raw)][1]
    raw[second - 20 : second] = bytes(20)
    with pytest.raises(DamagedPicture, match="damaged"):
        read(bytes(raw))


def test_frames_without_tables_are_read_with_those_of_the_standard() -> None:
    raw = encoded()
    bare = raw
    for kind, begin, end in reversed(Jpeg.of(raw).segments):
        if kind == TABLES:
            bare = bare[: begin - 4] + bare[end:]
    assert len(bare) < len(raw) - 400
    assert np.array_equal(read(bare), read(raw))


def test_a_flipped_bit_can_give_the_very_bytes_of_another_picture() -> None:
    # Neither a checksum nor redundancy: what an encoder writes for other pixels, no reader can tell from damage.
    smooth = cv2.resize(np.random.default_rng(0).uniform(90, 160, (4, 6)), (160, 96)).astype(np.uint8)
    options = [cv2.IMWRITE_JPEG_QUALITY, 60]
    raw = cv2.imencode(".jpg", smooth, options)[1].tobytes()
    same = 0
    for at in range(Jpeg.of(raw).scan(raw), len(raw) - 2):
        for bit in range(8):
            changed = bytearray(raw)
            changed[at] ^= 1 << bit
            try:
                found = decode_jpeg(bytes(changed), Jpeg.of(bytes(changed)), "frame", grey=True)
            except DamagedPicture:
                continue
            wrong = np.mean(np.abs(found.astype(int) - smooth) > 24) if found.shape == smooth.shape else 0.0
            same += bool(wrong > 0.02 and cv2.imencode(".jpg", found, options)[1].tobytes() == bytes(changed))
    assert same > 10


@pytest.mark.parametrize("content", [b"\xff\x00" * 60_000, (bytes(250) + b"\xff\x00") * 500, b"\x00\xff\xff" * 60_000])
@pytest.mark.parametrize("restarts", [0, 5])
def test_what_looks_like_padding_is_looked_at_once(content: bytes, restarts: int) -> None:
    raw = encoded(cv2.IMWRITE_JPEG_RST_INTERVAL, restarts)
    scan = Jpeg.of(raw).scan(raw)
    with soon(), pytest.raises(DamagedPicture, match="damaged"):
        read(raw[:scan] + b"\x00\xff\xd0" + content + b"\x01" + raw[scan:])


def test_many_scans_and_segments_are_refused_before_they_are_decoded() -> None:
    raw = encoded(cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    jpeg = Jpeg.of(raw)
    assert not jpeg.is_overlong
    kind, begin, _ = next(each for each in jpeg.segments if each[0] == 0xDA)
    again = raw[begin - 4 : jpeg.segments[jpeg.segments.index((kind, begin, jpeg.scan(raw))) + 1][1] - 4]
    assert again.startswith(b"\xff\xda")
    with soon():
        for content in (again * 1000, b"\xff\xe0\x00\x02" * 1_000_000):
            with pytest.raises(DamagedPicture, match="more parts than any JPEG"):
                read(raw[: begin - 4] + content + raw[begin - 4 :])
