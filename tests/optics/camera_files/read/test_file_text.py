"""YAML of other tools: OpenCV's head and matrices, and nothing but data."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.camera_files.read.file_text import LARGEST_BYTES, entry, read_text, read_yaml, table


def test_matrices_of_opencv_are_mappings(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("%YAML:1.0\n---\nm: !!opencv-matrix\n   rows: 1\n   cols: 2\n   dt: d\n   data: [ 1., 2.e-05 ]\n")
    assert read_yaml(path) == {"m": {"rows": 1, "cols": 2, "dt": "d", "data": [1.0, 2e-5]}}


def test_a_large_file_and_one_that_is_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(b"#" * (LARGEST_BYTES + 1))
    with pytest.raises(InputError, match="is larger than 5 MB"):
        read_text(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not text in UTF-8"):
        read_text(path)


def test_tables_and_entries() -> None:
    with pytest.raises(InputError, match="here: expected names with values"):
        table({1: 2}, "here")
    with pytest.raises(InputError, match="here: a is missing"):
        entry({"a": None}, "a", "here")
    assert entry({"a": 0}, "a", "here") == 0
