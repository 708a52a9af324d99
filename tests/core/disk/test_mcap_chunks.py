"""MCAP files are checked before they are decompressed: their sizes, and whether they are complete."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from mirrorcam.core.disk import array_files
from mirrorcam.core.disk.bags import MAGIC, Chunk, checked_chunks
from mirrorcam.core.errors import InputError
from tests.optics.light_field.io.bags import needs_rosbags

FOOTER = struct.pack("<BQQQI", 2, 20, 0, 0, 0)


def chunk(content_bytes: int, compression: bytes, content: bytes) -> bytes:
    body = struct.pack("<QQQI", 0, 0, content_bytes, 0) + struct.pack("<I", len(compression)) + compression
    body += struct.pack("<Q", len(content)) + content
    return struct.pack("<BQ", 6, len(body)) + body


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(array_files, "LARGEST_BYTES", 1000)
    monkeypatch.setattr(array_files, "MAX_GROWTH", 0)
    return tmp_path / "a.mcap"


def test_complete_files_pass(path: Path) -> None:
    path.write_bytes(MAGIC + chunk(1000, b"", bytes(1000)) + FOOTER + MAGIC)
    assert checked_chunks(path) == {Chunk(len(MAGIC), "", 1000, 1000)}


def test_truncated_and_other_files_are_refused(path: Path) -> None:
    whole = MAGIC + chunk(10, b"", bytes(10)) + FOOTER + MAGIC
    for content, message in (
        (b"", "does not begin like an MCAP file"),
        (b"\x89PNG", "does not begin like an MCAP file"),
        (whole[:30], "truncated, expected a complete MCAP file"),
        (whole[: -len(MAGIC) - len(FOOTER)], "truncated, expected a complete MCAP file"),
        (whole[:-2], "does not end like an MCAP file"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            checked_chunks(path)


@needs_rosbags
def test_chunks_with_too_large_or_wrong_sizes_are_refused(path: Path) -> None:
    zstd = pytest.importorskip("backports.zstd", reason="needs backports.zstd, as rosbags does before Python 3.14")
    small, large = zstd.compress(bytes(900)), zstd.compress(bytes(2000))
    path.write_bytes(MAGIC + chunk(900, b"zstd", small) + FOOTER + MAGIC)
    checked_chunks(path)
    for bad, message in (
        (chunk(2000, b"zstd", large), "states arrays of 0 MB, expected at most 0 MB"),
        (chunk(2000, b"", bytes(2000)), "states arrays of 0 MB"),
        (chunk(900, b"zstd", large), "a chunk states 900 bytes, but its data 2000"),
        (chunk(900, b"zstd", small + small), "a chunk states 900 bytes, but its data 900 in"),
        (chunk(900, b"zstd", b"no frame of Zstandard"), "not an MCAP file that can be read"),
        (chunk(900, b"lz4", small), "not an MCAP file that can be read"),
        (chunk(900, b"bz2", small), "compressed by 'bz2', expected zstd, lz4 or none"),
    ):
        path.write_bytes(MAGIC + bad + FOOTER + MAGIC)
        with pytest.raises(InputError, match=message):
            checked_chunks(path)


def unsized_zstd(content: bytes) -> bytes:
    """Return a frame without its content size, as ROS 2 writes them."""
    zstd = pytest.importorskip("backports.zstd", reason="needs backports.zstd, as rosbags does before Python 3.14")
    compressor = zstd.ZstdCompressor()
    return bytes(compressor.compress(content) + compressor.flush())


def unsized_lz4(content: bytes) -> bytes:
    frame = pytest.importorskip("lz4.frame", reason="needs lz4, as rosbags does")
    return bytes(frame.compress(content, store_size=False))


def sized_lz4(content: bytes) -> bytes:
    frame = pytest.importorskip("lz4.frame", reason="needs lz4, as rosbags does")
    return bytes(frame.compress(content))


@needs_rosbags
@pytest.mark.parametrize(
    ("name", "compress"),
    [(b"zstd", unsized_zstd), (b"lz4", unsized_lz4), (b"lz4", sized_lz4)],
    ids=["zstd-unsized", "lz4-unsized", "lz4-sized"],
)
def test_frames_are_counted_without_holding_them(path: Path, name: bytes, compress: Callable[[bytes], bytes]) -> None:
    for size in (0, 1, 900):
        path.write_bytes(MAGIC + chunk(size, name, compress(bytes(size))) + FOOTER + MAGIC)
        assert {each.content_bytes for each in checked_chunks(path)} == {size}
    whole = compress(bytes(900))
    for content in (
        compress(bytes(899)),
        compress(bytes(901)),
        compress(bytes(100_000_000)),
        whole + whole,
        whole + b"x",
        whole[:-1],
        whole[:5],
        b"",
        b"no frame at all",
    ):
        path.write_bytes(MAGIC + chunk(900, name, content) + FOOTER + MAGIC)
        with pytest.raises(InputError, match="not an MCAP file that can be read"):
            checked_chunks(path)
    path.write_bytes(MAGIC + chunk(1001, name, compress(bytes(1001))) + FOOTER + MAGIC)
    with pytest.raises(InputError, match="states arrays of 0 MB"):
        checked_chunks(path)
