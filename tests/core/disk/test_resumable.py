"""Folders written file by file: the same request goes on, what is not intact is made again, others are refused."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from pydantic import Field

from mirrorcam.core.disk.files import write_text
from mirrorcam.core.disk.fingerprint import digest
from mirrorcam.core.disk.resumable import UNFINISHED, FolderManifest
from mirrorcam.core.errors import InputError


class Pictures(FolderManifest):
    FILE = "pictures.json"
    NOUN = "set"
    FILES = ("board.toml",)
    FOLDERS = ("frames",)
    DERIVED = frozenset({"coverage"})

    size: int = 1
    coverage: float = 0.5
    request: str = "asked"
    files: dict[str, str] = Field(default_factory=dict)


PLANNED = ("board.toml", "frames/0.png", "frames/1.png")


def begun(folder: Path, **changes: Any) -> Pictures:
    return Pictures(**changes).resumed(folder, PLANNED)


def write(name: str, folder: Path) -> None:
    write_text(folder / name, name)


def written(folder: Path, **changes: Any) -> Pictures:
    """A manifest with two files."""
    manifest = begun(folder, **changes)
    for name in ("frames/1.png", "frames/0.png"):
        manifest = manifest.added(folder, partial(write, name))
    return manifest


def test_a_new_folder_begins_with_its_manifest(tmp_path: Path) -> None:
    assert begun(tmp_path / "new") == Pictures.load(tmp_path / "new") == Pictures()


def test_the_same_request_resumes_with_intact_files(tmp_path: Path) -> None:
    assert list(written(tmp_path).files) == ["frames/0.png", "frames/1.png"]
    assert begun(tmp_path) == Pictures.load(tmp_path) == written(tmp_path)
    (tmp_path / "frames/0.png").write_text("altered")
    with pytest.raises(InputError, match=r"0\.png: was changed since it was written, expected it unchanged or removed"):
        begun(tmp_path)
    (tmp_path / "frames/0.png").unlink()
    assert begun(tmp_path).files == {"frames/1.png": digest(b"frames/1.png")}
    (tmp_path / "frames/1.png").unlink()
    assert begun(tmp_path).files == {}


def test_unfinished_files_of_a_killed_run_are_removed_and_others_stay(tmp_path: Path) -> None:
    written(tmp_path)
    mine = (".pictures-original.json", ".mirrorcam-mine", "frames/.mirrorcam-mine.png", "notes.txt", "frames/2.png")
    for name in (f"{UNFINISHED}/frames/0.png", f"{UNFINISHED}/pictures.json", *mine):
        write_text(tmp_path / name, "mine")
    begun(tmp_path)
    assert not (tmp_path / UNFINISHED).exists()
    assert all((tmp_path / name).read_text() == "mine" for name in mine)


def test_foreign_files_with_planned_names_are_refused_before_any_work(tmp_path: Path) -> None:
    written(tmp_path)
    write("board.toml", tmp_path)
    with pytest.raises(
        InputError, match=r"board\.toml: is not listed in pictures\.json, expected it removed, or a new"
    ):
        begun(tmp_path)
    assert (tmp_path / "board.toml").read_text() == "board.toml"
    (tmp_path / "board.toml").unlink()
    shutil.rmtree(tmp_path / "frames")
    write("frames", tmp_path)
    with pytest.raises(InputError, match="frames: is a file or a link out of"):
        begun(tmp_path)


def test_a_file_that_came_in_the_meantime_is_not_replaced(tmp_path: Path) -> None:
    manifest = written(tmp_path)
    write_text(tmp_path / "board.toml", "mine")
    with pytest.raises(InputError, match=r"board\.toml: is not listed"):
        manifest.added(tmp_path, partial(write, "board.toml"))
    assert (tmp_path / "board.toml").read_text() == "mine"
    write("board.toml", tmp_path)  # nothing to lose
    assert "board.toml" in manifest.added(tmp_path, partial(write, "board.toml")).files
    assert sorted(path.name for path in tmp_path.iterdir()) == ["board.toml", "frames", "pictures.json"]


def test_a_run_killed_while_files_are_moved_is_resumed(tmp_path: Path) -> None:
    files = {name: digest(name.encode()) for name in PLANNED}
    begun(tmp_path).replaced(files=files).save(tmp_path)
    write("frames/0.png", tmp_path)
    assert begun(tmp_path).files == {"frames/0.png": files["frames/0.png"]}


def test_work_that_fails_leaves_nothing(tmp_path: Path) -> None:
    def fail(folder: Path) -> None:
        write("board.toml", folder)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        begun(tmp_path).added(tmp_path, fail)
    assert [path.name for path in tmp_path.iterdir()] == ["pictures.json"]


@pytest.mark.parametrize(
    ("changes", "differs"),
    [({"size": 2, "coverage": 0.1}, "size"), ({"coverage": 0.1}, r"seed \(or by another version of this program\)")],
)
def test_another_request_is_refused_and_names_what_differs(
    changes: dict[str, Any], differs: str, tmp_path: Path
) -> None:
    written(tmp_path)
    before = (tmp_path / "pictures.json").read_bytes()
    with pytest.raises(InputError, match=f"holds a set that differs in {differs}, expected the same request"):
        begun(tmp_path, request="other", **changes)
    assert (tmp_path / "pictures.json").read_bytes() == before


def test_folders_of_somebody_else_are_refused(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    with pytest.raises(InputError, match=r"has 'frames' but no pictures\.json"):
        begun(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file: is a file, expected a folder for the set"):
        begun(tmp_path / "file")


def test_nothing_is_written_through_a_link(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    written(folder)
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / ".mirrorcam-1.png").touch()
    (folder / "frames").rename(tmp_path / "moved")
    (folder / "frames").symlink_to(tmp_path / "theirs")
    with pytest.raises(InputError, match="frames: is a file or a link out of"):
        begun(folder)
    assert (tmp_path / "theirs" / ".mirrorcam-1.png").exists()
