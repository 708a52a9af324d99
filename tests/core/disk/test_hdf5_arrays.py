"""Arrays of HDF5: those in the file come back; links, other files and filters that are not known are refused."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from mirrorcam.core.disk.hdf5_arrays import read_hdf5
from mirrorcam.core.errors import InputError

VALUES = np.arange(600, dtype=np.uint16).reshape(20, 30)
SECRET = b"not to be read" * 100


def read(path: Path) -> Any:
    return read_hdf5(path, {"a": "a", "deep": "group/deep", "absent": "group/absent"}, "a file that can be read")


@pytest.mark.parametrize("filters", [{}, {"compression": "gzip", "shuffle": True, "fletcher32": True}])
def test_arrays_come_back_by_name(tmp_path: Path, filters: dict[str, Any]) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a", data=VALUES, **filters)
        file["group/deep"] = 2.5
    found = read(tmp_path / "a.h5")
    assert found.keys() == {"a", "deep"}
    assert np.array_equal(found["a"], VALUES)
    assert found["deep"] == 2.5


def external_link(file: h5py.File, beside: Path) -> None:
    file["a"] = h5py.ExternalLink(str(beside / "secret.h5"), "a")


def soft_link(file: h5py.File, beside: Path) -> None:
    file["b"] = VALUES
    file["a"] = h5py.SoftLink("/b")


def link_on_the_way(file: h5py.File, beside: Path) -> None:
    file["group"] = h5py.ExternalLink(str(beside / "secret.h5"), "/")


def external_storage(file: h5py.File, beside: Path) -> None:
    file.create_dataset("a", (100,), "u1", external=[(str(beside / "secret.bin"), 0, 100)])


def virtual(file: h5py.File, beside: Path) -> None:
    layout = h5py.VirtualLayout(shape=(100,), dtype="u1")
    layout[:] = h5py.VirtualSource(str(beside / "secret.h5"), "a", shape=(100,))
    file.create_virtual_dataset("a", layout)


def lzf(file: h5py.File, beside: Path) -> None:
    file.create_dataset("a", data=VALUES, compression="lzf")


def huge(file: h5py.File, beside: Path) -> None:
    file.create_dataset("a", (10**6, 10**6), "f8", chunks=(10, 10))


def missing(file: h5py.File, beside: Path) -> None:
    file.create_dataset("a", (100, 100), "f8", chunks=(10, 10))[:10] = 1.0


def unwritten(file: h5py.File, beside: Path) -> None:
    file.create_dataset("a", (100, 100), "f8")


def text(file: h5py.File, beside: Path) -> None:
    file.create_dataset("a", data=["text"])


def inflating(file: h5py.File, beside: Path) -> None:
    dataset = file.create_dataset("a", (10, 10), "u1", chunks=(10, 10), compression="gzip")
    dataset.id.write_direct_chunk((0, 0), zlib.compress(bytes(100_000_000)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (external_link, "a is a link"),
        (soft_link, "a is a link"),
        (link_on_the_way, "group/deep is a link"),
        (external_storage, "/a is stored in other files"),
        (virtual, "/a is stored in other files"),
        (lzf, "/a has filter 32000, expected none but deflate, shuffle, fletcher32"),
        (huge, "states arrays of 8000000 MB"),
        (missing, "/a is incomplete"),
        (unwritten, "/a is incomplete"),
        (text, "/a holds object, expected numbers"),
        (inflating, "/a has a chunk of more than the 100 bytes"),
    ],
)
def test_what_is_not_in_the_file_is_refused(
    tmp_path: Path, make: Callable[[h5py.File, Path], None], message: str
) -> None:
    (tmp_path / "secret.bin").write_bytes(SECRET)
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["a"] = file["deep"] = np.frombuffer(SECRET, np.uint8)[:100]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        make(file, tmp_path)
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path / "a.h5")
    assert str(caught.value).startswith(str(tmp_path / "a.h5"))


def test_what_is_no_hdf5_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_bytes(b"no HDF5")
    with pytest.raises(InputError, match="not a file that can be read: ") as caught:
        read(tmp_path / "a.h5")
    assert "\n" not in str(caught.value)
