"""Variables of .mat files before HDF5: the same as SciPy reads, and tags that lie are refused."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from mirrorcam.core.disk.mat5_arrays import read_mat5
from mirrorcam.core.errors import InputError

WHAT = "a .mat file that can be read"


@pytest.mark.parametrize("compressed", [True, False])
def test_arrays_are_those_that_scipy_reads(tmp_path: Path, compressed: bool) -> None:
    random = np.random.default_rng(3)
    kinds = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
    arrays: dict[str, Any] = {f"a_{kind}": random.integers(0, 100, (2, 3, 4)).astype(kind) for kind in kinds}
    arrays |= {"number": 3.5, "empty": np.zeros((0, 3)), "flag": np.array([True, False])}
    savemat(tmp_path / "a.mat", arrays, do_compression=compressed)
    expected, found = loadmat(tmp_path / "a.mat"), read_mat5(tmp_path / "a.mat", arrays, WHAT)
    assert found.keys() == arrays.keys()
    for name, array in found.items():
        assert array.dtype == (np.uint8 if name == "flag" else expected[name].dtype)
        assert array.shape == expected[name].shape
        assert np.array_equal(array, expected[name])


def test_structs_are_dicts_and_texts_are_texts(tmp_path: Path) -> None:
    said = {"name": "µm and text", "empty": "", "inner": {"deep": np.arange(3.0)}, "cells": np.array([1, "a"], object)}
    savemat(tmp_path / "a.mat", {"said": said, "other": 1})
    found = read_mat5(tmp_path / "a.mat", ("said", "absent"), WHAT)
    assert found.keys() == {"said"}
    assert found["said"]["name"] == "µm and text"
    assert found["said"]["inner"]["deep"].tolist() == [[0.0, 1.0, 2.0]]
    assert found["said"]["cells"] is None


def test_numbers_may_be_stored_in_a_smaller_type_and_big_end_first(tmp_path: Path) -> None:
    """As MATLAB does with whole numbers of a double, in eight bytes for a small element."""
    matrix = struct.pack(">IIII", 6, 8, 6, 0) + struct.pack(">IIii", 5, 8, 1, 3)
    matrix += struct.pack(">HH4s", 1, 1, b"x\0\0\0") + struct.pack(">HHBBBx", 3, 2, 7, 8, 9)
    header = b"MATLAB 5.0".ljust(124) + b"\x01\x00MI"
    (tmp_path / "a.mat").write_bytes(header + struct.pack(">II", 14, len(matrix)) + matrix)
    found = read_mat5(tmp_path / "a.mat", ("x",), WHAT)["x"]
    assert found.dtype == np.float64
    assert found.tolist() == [[7.0, 8.0, 9.0]]


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def variable(shape: tuple[int, ...], kind: int = 9, data: bytes = bytes(8), flags: int = 0) -> bytes:
    content = element(6, struct.pack("<II", kind | flags << 8, 0)) + element(5, np.array(shape, "<i4").tobytes())
    return element(14, content + element(1, b"LF") + element(2, data))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (variable((60000, 60000, 60000, 60000)), "states arrays of"),
        (variable((3, 3)), "8 numbers, expected 9"),
        (variable((-3, 3)), "an array of shape"),
        (variable((2, 4), flags=8), "complex numbers"),
        (variable((2, 4)) * 2, "LF appears twice"),
        (variable((2, 4))[:-9], "an element is cut short"),
        (struct.pack("<II", 14, 0xFFFFFFF8), "an element is cut short"),
        (struct.pack("<II", 99, 0), "an element of type 99, expected a variable"),
        (element(15, zlib.compress(variable((2, 4)))[:-3]), "cut short or too large"),
        (element(15, zlib.compress(struct.pack("<II", 14, 500_000_000))), "states arrays of 500 MB"),
        (element(15, zlib.compress(struct.pack("<II", 14, 8) + bytes(10**6))), "cut short or too large"),
        (element(15, zlib.compress(b"")), "not a .mat file"),
        (element(15, b"not deflate"), "decompressing"),
    ],
)
def test_tags_that_lie_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + content)
    with pytest.raises(InputError, match=message) as caught:
        read_mat5(path, ("LF",), WHAT)
    assert str(caught.value).startswith(str(path))


def test_what_has_no_header_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"not MATLAB")
    with pytest.raises(InputError, match=r"not a \.mat file that can be read: has no header"):
        read_mat5(tmp_path / "a.mat", ("LF",), WHAT)
