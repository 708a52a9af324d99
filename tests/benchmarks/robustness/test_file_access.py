"""What is opened, made, renamed or removed elsewhere is listed; temporary files and libraries are not."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.robustness.file_access import watched_files


@pytest.mark.parametrize(
    ("use", "expected"),
    [
        (lambda path: path.read_bytes(), "reads {}"),
        (lambda path: path.write_bytes(b"x"), "writes {}"),
        (lambda path: path.unlink(), "writes {}"),
        (lambda path: path.rename(path.with_name("other")), "writes {}"),
        (lambda path: path.with_name("folder").mkdir(), "writes {}/folder"),
        (lambda path: path.with_name("link").symlink_to(path), "writes {}/link"),
    ],
)
def test_what_happens_elsewhere_is_listed(tmp_path: Path, use: Callable[[Path], object], expected: str) -> None:
    path = tmp_path / "secret"
    path.write_bytes(b"secret")
    with watched_files() as elsewhere:
        use(path)
    assert elsewhere[0] == expected.format(path.parent if "/" in expected else path)
    with watched_files() as nothing:
        pass
    assert nothing == []


def test_a_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(b"secret")
    with tempfile.TemporaryDirectory() as folder, watched_files() as elsewhere:
        (Path(folder) / "link").symlink_to(tmp_path / "secret")
        (Path(folder) / "link").read_bytes()
    assert f"reads {tmp_path / 'secret'}" in elsewhere
