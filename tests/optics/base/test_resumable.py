"""Folders written file by file: the same request goes on, what is not intact is made again, others are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import Field

from mirrorcam.optics.base.fingerprint import digest
from mirrorcam.optics.base.resumable import FolderManifest, intact, read_record
from mirrorcam.optics.base.values import InputError


class Pictures(FolderManifest):
    FILE = "pictures.json"
    WHAT = "set"
    FILES = ("board.toml",)
    FOLDERS = ("frames",)
    FOLLOWS = frozenset({"coverage"})

    size: int = 1
    coverage: float = 0.5
    request: str = "asked"
    files: dict[str, str] = Field(default_factory=dict)


def written(folder: Path, **changes: Any) -> Pictures:
    """A manifest with two files."""
    manifest = Pictures(**changes).continued(folder)
    for name in ("frames/1.png", "frames/0.png"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
        manifest = manifest.recorded(folder, name)
    return manifest


def test_a_new_folder_begins_with_its_manifest(tmp_path: Path) -> None:
    assert Pictures().continued(tmp_path / "new") == Pictures.load(tmp_path / "new") == Pictures()


def test_the_same_request_goes_on_with_what_is_intact(tmp_path: Path) -> None:
    assert list(written(tmp_path).files) == ["frames/0.png", "frames/1.png"]
    assert Pictures().continued(tmp_path) == Pictures.load(tmp_path) == written(tmp_path)
    (tmp_path / "frames/0.png").write_text("altered")
    with pytest.raises(InputError, match=r"0\.png: was changed since it was written, expected it as it was, or gone"):
        Pictures().continued(tmp_path)
    (tmp_path / "frames/0.png").unlink()
    assert Pictures().continued(tmp_path).files == {"frames/1.png": digest(b"frames/1.png")}
    (tmp_path / "frames/1.png").unlink()
    assert Pictures().continued(tmp_path).files == {}


def test_temporary_files_of_a_killed_run_are_removed_and_others_stay(tmp_path: Path) -> None:
    written(tmp_path)
    temporary = ("frames/.0-abc.png", ".board-abc.toml", ".pictures-abc.json")
    for name in (*temporary, ".mine-1.json", "notes.txt"):
        (tmp_path / name).touch()
    Pictures().continued(tmp_path)
    assert not any((tmp_path / name).exists() for name in temporary)
    assert (tmp_path / ".mine-1.json").exists() and (tmp_path / "notes.txt").exists()


@pytest.mark.parametrize(
    ("changes", "differs"),
    [({"size": 2, "coverage": 0.1}, "size"), ({"coverage": 0.1}, r"seed \(or of another version of this program\)")],
)
def test_another_request_is_refused_and_names_what_differs(
    changes: dict[str, Any], differs: str, tmp_path: Path
) -> None:
    written(tmp_path)
    before = (tmp_path / "pictures.json").read_bytes()
    with pytest.raises(InputError, match=f"holds a set of another {differs}, expected the same request"):
        Pictures(request="other", **changes).continued(tmp_path)
    assert (tmp_path / "pictures.json").read_bytes() == before


def test_folders_of_somebody_else_are_refused(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    with pytest.raises(InputError, match=r"has 'frames' but no pictures\.json"):
        Pictures().continued(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file: is a file, expected a folder for the set"):
        Pictures().continued(tmp_path / "file")


def test_intact_files_are_there_with_their_content(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_text(name)
    files = {"a": digest(b"a"), "b": digest(b"other"), "c": digest(b"c")}
    assert intact(tmp_path, files) == {"a": digest(b"a")}


@pytest.mark.parametrize("content", [None, "", "{", '{"size": "many"}', '{"unknown": 1}'])
def test_a_record_that_is_not_whole_is_none(content: str | None, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / "record.json").write_text(content)
    assert read_record(Pictures, tmp_path / "record.json") is None
