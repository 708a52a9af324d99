"""Arrays of Zarr: the same as the library reads, and metadata or chunks of anything else are refused."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from numcodecs import Zstd
from zarr.codecs import BloscCodec, ZstdCodec

from mirrorcam.core.disk.zarr_arrays import ZarrArray, read_attributes
from mirrorcam.core.errors import InputError

VALUES = np.random.default_rng(5).random((7, 10)).astype(np.float32)


def group(path: Path, compressors: Any = "auto", values: Any = VALUES) -> Path:
    made = zarr.open_group(path, mode="w", attributes={"about": [1, 2]})
    made.create_array("a", data=values, chunks=(3, 4), compressors=compressors)
    return path


def change(path: Path, **changes: Any) -> None:
    file = path / "a" / "zarr.json"
    file.write_text(json.dumps(json.loads(file.read_text(encoding="utf-8")) | changes), encoding="utf-8")


@pytest.mark.parametrize("compressors", ["auto", None, BloscCodec(cname="lz4"), BloscCodec(cname="zstd"), ZstdCodec()])
def test_arrays_are_those_that_zarr_reads(tmp_path: Path, compressors: Any) -> None:
    array = ZarrArray(group(tmp_path / "a.zarr", compressors), "a")
    assert (array.shape, array.chunk_shape, str(array.dtype), array.is_complete) == ((7, 10), (3, 4), "float32", True)
    assert np.array_equal(array.read(), VALUES)
    assert np.array_equal(array.chunk((1, 1)), VALUES[3:6, 4:8])
    assert read_attributes(tmp_path / "a.zarr") == {"about": [1, 2]}


@pytest.mark.parametrize("size", [1, 200, 255, 256, 300, 65_535, 70_000])
def test_zstandard_of_every_size_is_read(tmp_path: Path, size: int) -> None:
    made = zarr.open_group(tmp_path / "a.zarr", mode="w")
    values = np.arange(size).astype(np.uint8) + 1
    made.create_array("a", data=values, chunks=(size,), compressors=ZstdCodec())
    assert np.array_equal(ZarrArray(tmp_path / "a.zarr", "a").read(), values)


def test_chunks_of_zeros_have_no_files(tmp_path: Path) -> None:
    values = VALUES.copy()
    values[:3, :4] = 0.0
    array = ZarrArray(group(tmp_path / "a.zarr", values=values), "a")
    assert not array.has((0, 0))
    assert not array.is_complete
    assert np.array_equal(array.read(), values)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"codecs": [{"name": "bytes"}, {"name": "gzip"}]}, "codecs bytes gzip, expected"),
        ({"codecs": [{"name": "numcodecs.pickle"}]}, "codecs numcodecs.pickle, expected"),
        ({"codecs": [{"name": "bytes", "configuration": {"endian": "big"}}]}, "bytes are not little-endian"),
        ({"codecs": [{"name": "bytes"}, {"name": "zstd"}, {"name": "zstd"}]}, "codecs"),
        ({"data_type": "string"}, "data_type: "),
        ({"data_type": "complex64"}, "data_type: "),
        ({"shape": [-1, 3]}, "expected positive lengths"),
        ({"shape": [10**9, 10]}, "states arrays of 40000 MB"),
        ({"shape": [10**7, 1]}, "more than 100000 chunks"),
        ({"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [10**9, 10]}}}, "states arrays of"),
        ({"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [0, 10]}}}, "expected positive lengths"),
        ({"chunk_key_encoding": {"name": "v2"}}, "keys of chunks"),
        ({"fill_value": 1.0}, "fill_value"),
        ({"zarr_format": 2}, "zarr_format: Input should be 3"),
        ({"node_type": "group"}, "node_type"),
        ({"storage_transformers": [{"name": "x"}]}, "storage_transformers"),
    ],
)
def test_metadata_of_anything_else_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    group(tmp_path / "a.zarr")
    change(tmp_path / "a.zarr", **changes)
    with pytest.raises(InputError, match=message) as caught:
        ZarrArray(tmp_path / "a.zarr", "a").read()
    assert len(str(caught.value).replace(str(tmp_path), "")) <= 300


def test_chunks_that_state_another_size_are_refused(tmp_path: Path) -> None:
    """Of several frames of Zstandard, the first alone states as much as it should."""
    group(tmp_path / "blosc.zarr", BloscCodec(cname="lz4"))
    group(tmp_path / "zstd.zarr", ZstdCodec())
    chunk = Path("a", "c", "0", "0")
    raw = bytearray((tmp_path / "blosc.zarr" / chunk).read_bytes())
    raw[4:8] = struct.pack("<I", 2**31 - 1)
    (tmp_path / "blosc.zarr" / chunk).write_bytes(bytes(raw))
    with pytest.raises(InputError, match="holds 2147483647 bytes of numbers, expected 48"):
        ZarrArray(tmp_path / "blosc.zarr", "a").chunk((0, 0))
    file = tmp_path / "zstd.zarr" / chunk
    good = file.read_bytes()
    for content, message in (
        (good + Zstd().encode(bytes(1 << 24)), "destination buffer too small"),
        (good[:-2], "not a chunk that can be read"),
        (b"", "Zstandard"),
        (Zstd().encode(bytes(100)), "holds 100 bytes of numbers, expected 48"),
        (bytes(10_000), "has more bytes than the 48 of its numbers"),
    ):
        file.write_bytes(content)
        with pytest.raises(InputError, match=message):
            ZarrArray(tmp_path / "zstd.zarr", "a").chunk((0, 0))


def test_links_that_lead_out_are_not_followed(tmp_path: Path) -> None:
    group(tmp_path / "a.zarr", None)
    (tmp_path / "secret").write_bytes(b"not to be read".ljust(48))
    chunk = tmp_path / "a.zarr" / "a" / "c" / "0" / "0"
    chunk.unlink()
    chunk.symlink_to(tmp_path / "secret")
    with pytest.raises(InputError, match="expected the name of a file in this folder"):
        ZarrArray(tmp_path / "a.zarr", "a").chunk((0, 0))
