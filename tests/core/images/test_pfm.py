"""Portable float maps: against OpenCV's reader and writer, and files that are none."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pfm import read_pfm, write_pfm
from tests.soon import soon

VALUES = np.arange(12, dtype=np.float32).reshape(3, 4) - 5.5


def test_maps_survive_the_round_trip_to_the_bit(tmp_path: Path) -> None:
    values = VALUES.copy()
    values[1, 2], values[0, 0] = np.nan, np.inf
    write_pfm(tmp_path / "a.pfm", values)
    assert np.array_equal(read_pfm(tmp_path / "a.pfm"), values, equal_nan=True)


def test_opencv_reads_ours_and_we_read_its(tmp_path: Path) -> None:
    write_pfm(tmp_path / "ours.pfm", VALUES)
    read = cv2.imread(str(tmp_path / "ours.pfm"), cv2.IMREAD_UNCHANGED)
    assert read is not None
    assert np.array_equal(read, VALUES)
    assert cv2.imwrite(str(tmp_path / "theirs.pfm"), VALUES)
    assert np.array_equal(read_pfm(tmp_path / "theirs.pfm"), VALUES)


def test_big_ends_and_comments_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.pfm").write_bytes(b"Pf\n# made by hand\n4 3\n2.0\n" + (VALUES[::-1] / 2).astype(">f4").tobytes())
    assert np.array_equal(read_pfm(tmp_path / "a.pfm"), VALUES)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a PFM file of one channel"),
        (b"PF\n4 3\n-1\n" + bytes(144), "not a PFM file of one channel"),
        (b"Pf\n4 3\n-1\n" + bytes(47), "47 bytes of numbers, expected 48 for 4x3"),
        (b"Pf\n4 3\n0\n" + bytes(48), "expected 48 for 4x3"),
    ],
)
def test_files_that_are_not_maps_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.pfm").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_pfm(tmp_path / "a.pfm")


def test_comments_are_no_longer_than_a_header(tmp_path: Path) -> None:
    (tmp_path / "a.pfm").write_bytes(b"Pf\n" + b"#\n" * 5_000_000)
    with soon(), pytest.raises(InputError, match="not a PFM file"):
        read_pfm(tmp_path / "a.pfm")
