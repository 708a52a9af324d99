"""Arrays in .npy and .npz files: what is good comes back, and headers that lie are refused before memory is taken."""

from __future__ import annotations

import os
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.disk.array_files import as_input_error, check_bytes, read_npy, read_npz
from mirrorcam.core.errors import InputError


def header(shape: tuple[Any, ...], kind: str = "'<f4'") -> bytes:
    text = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24, dtype=np.uint8).reshape(2, 3, 4),
        np.asfortranarray(np.random.default_rng(1).random((3, 4))),
        np.array(3.5),
        np.array("0123456789abcdef"),
        np.zeros((0, 3), np.float32),
        np.arange(5, dtype=">i4"),
    ],
)
def test_arrays_come_back_as_numpy_reads_them(tmp_path: Path, array: Any) -> None:
    np.save(tmp_path / "a.npy", array)
    np.savez_compressed(tmp_path / "a.npz", one=array, other=np.ones(3))
    for found in (read_npy(tmp_path / "a.npy"), read_npz(tmp_path / "a.npz", ("one", "absent"))["one"]):
        assert (found.dtype, found.shape, found.flags.f_contiguous) == (
            array.dtype,
            array.shape,
            array.flags.f_contiguous,
        )
        assert np.array_equal(found, array)
    assert read_npz(tmp_path / "a.npz", ("absent",)) == {}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (header((10**5, 10**5, 10**5)), "states arrays of 4000000000 MB, expected at most 400 MB"),
        (header((10**300,)), "states arrays of 1000000000000 MB"),
        (header((3, 3)) + bytes(35), "has 35 bytes of numbers, expected 36"),
        (header((3, 3)) + bytes(37), "has 37 bytes of numbers, expected 36"),
        (header((-1, 3)), "its shape has a negative length"),
        (header((1,), "'|O'") + b"\x80\x04N.", "holds object, expected numbers or text"),
        (header((1,), "[('a', '<f4')]") + bytes(4), "expected numbers or text"),
        (header((1,), "'<f999'"), "not an .npy file that can be read"),
        (b"\x93NUMPY\x09\x00" + bytes(90), "not an .npy file that can be read"),
        (b"", "not an .npy file that can be read"),
    ],
)
def test_headers_that_lie_are_refused_in_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(content)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", content)
    with pytest.raises(InputError, match=message) as caught:
        read_npy(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=message.replace(".npy", ".npz")):
        read_npz(tmp_path / "a.npz", ("a",))


def test_damage_to_an_npz_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, a=np.zeros(1000, np.uint8))
    raw = bytearray(path.read_bytes())
    raw[700] ^= 1
    path.write_bytes(bytes(raw))
    with pytest.raises(InputError, match="Bad CRC-32"):
        read_npz(path, ("a",))


def test_other_compression_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("a.npy", header((1,)) + bytes(4))
    with pytest.raises(InputError, match="a is not compressed by deflate"):
        read_npz(tmp_path / "a.npz", ("a",))


def test_anything_but_a_regular_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npy")
    for path, message in (
        (tmp_path / "pipe.npy", "is not a regular file"),
        (tmp_path, "is a folder"),
        (tmp_path / "none.npz", "no such file"),
    ):
        with pytest.raises(InputError, match=message):
            read_npy(path)
        with pytest.raises(InputError, match=message):
            read_npz(path, ("a",))


def test_large_files_may_hold_large_arrays() -> None:
    check_bytes(Path("a"), 1_000_000_000, stored=125_000_000)
    with pytest.raises(InputError, match="states arrays of 1000 MB, expected at most 800 MB"):
        check_bytes(Path("a"), 1_000_000_000, stored=100_000_000)


def test_errors_of_decoders_become_one_line_and_others_stay() -> None:
    with pytest.raises(InputError, match=r"^a\.x: not a picture: too bad$"), as_input_error(Path("a.x"), "a picture"):
        raise RuntimeError("too\nbad")
    with pytest.raises(InputError) as caught, as_input_error(Path("a.x"), "a picture"):
        raise ValueError("x" * 1000)
    assert len(str(caught.value)) <= 300
    with pytest.raises(InputError, match="as it is"), as_input_error(Path("a.x"), "a picture"):
        raise InputError("as it is")
    with pytest.raises(AssertionError), as_input_error(Path("a.x"), "a picture"):
        raise AssertionError


@pytest.mark.parametrize("text", ["[" * 9000, "  a\n b\n", "-" * 9000, "{'descr': '<f4', (", "'" * 3])
def test_headers_that_are_no_text_of_python_are_refused(tmp_path: Path, text: str) -> None:
    stated = text.encode()
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x02\x00" + struct.pack("<I", len(stated)) + stated)
    with pytest.raises(InputError, match=r"not an \.npy file that can be read"):
        read_npy(tmp_path / "a.npy")


def test_an_archive_of_very_many_files_is_refused_before_they_are_listed(tmp_path: Path) -> None:
    entry = b"PK\x01\x02" + bytes(42)
    count = 2_000_000
    end = b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 0xFFFF, 0xFFFF, count * len(entry), 0, 0)
    (tmp_path / "a.npz").write_bytes(entry * count + end)
    with pytest.raises(InputError, match=r"a\.npz: not an \.npz file that can be read: too many files"):
        read_npz(tmp_path / "a.npz", ["a"])
