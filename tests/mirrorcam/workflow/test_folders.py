"""Folders appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.optics.base.values import InputError
from mirrorcam.workflow.folders import merged, replaced


def test_merged_adds_files_and_keeps_others(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "deep").mkdir(parents=True)
    (out / "mine.txt").write_text("mine")
    (out / "deep" / "old.txt").write_text("old")
    with merged(out) as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "old.txt").write_text("new")
        (folder / "more.txt").write_text("more")
        assert not (out / "more.txt").exists()
    texts = {path.name: path.read_text() for path in out.rglob("*.txt")}
    assert texts == {"mine.txt": "mine", "old.txt": "new", "more.txt": "more"}
    assert list(tmp_path.iterdir()) == [out]


def test_merged_leaves_nothing_when_the_block_fails(tmp_path: Path) -> None:
    with pytest.raises(InputError), merged(tmp_path / "output" / "out") as folder:
        (folder / "half.txt").write_text("half")
        raise InputError("no")
    assert list(tmp_path.iterdir()) == []


def test_replaced_removes_what_was_there(tmp_path: Path) -> None:
    for name in ("one", "two"):
        with replaced(tmp_path / "out", marker="marker") as folder:
            (folder / "marker").touch()
            (folder / name).touch()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["marker", "two"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_replaced_refuses_a_file_and_a_folder_without_the_marker(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "mine.txt").write_text("mine")
    for name in ("file", "folder"):
        with pytest.raises(InputError, match="holds no marker"), replaced(tmp_path / name, marker="marker"):
            pass
    assert (tmp_path / "file").read_text() == (tmp_path / "folder" / "mine.txt").read_text() == "mine"


def test_replaced_takes_an_empty_folder(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with replaced(tmp_path / "out", marker="marker") as folder:
        (folder / "file").touch()
    assert (tmp_path / "out" / "file").exists()


def test_an_interrupted_folder_is_kept_on_request_and_a_failed_one_is_not(tmp_path: Path) -> None:
    out = tmp_path / "output" / "out"
    for error in (KeyboardInterrupt, InputError):
        with pytest.raises(error), replaced(out, marker="marker", keep_interrupted=True) as folder:
            assert (folder / "half.txt").exists() == (error is InputError)
            (folder / "half.txt").write_text("half")
            raise error
    assert not out.exists()
    assert list(out.parent.iterdir()) == []


def test_merged_removes_what_an_earlier_block_wrote_and_this_one_does_not(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for names in (("parts/half_1.stl", "parts/half_2.stl", "same.txt"), ("parts/whole.stl", "same.txt")):
        with merged(out, listing=".files.txt") as folder:
            (folder / "parts").mkdir()
            for name in names:
                (folder / name).write_text(name)
        (out / "mine.txt").write_text("mine")
    found = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert found == {".files.txt", "mine.txt", "parts/whole.stl", "same.txt"}
    # A listing that somebody else has written reaches nothing outside the folder.
    (out / ".files.txt").write_text("../outside.txt\n/etc/hostname\nparts/whole.stl\n")
    (tmp_path / "outside.txt").write_text("theirs")
    with merged(out, listing=".files.txt"):
        pass
    assert (tmp_path / "outside.txt").exists()
    assert not (out / "parts" / "whole.stl").exists()
