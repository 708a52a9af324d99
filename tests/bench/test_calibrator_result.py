"""What a command leaves is a calibration, or is refused in one line before anything of it is taken."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from mirrorcam.bench import calibrator_run
from mirrorcam.bench.calibrator_run import LOG, calibration_path, copy_result
from mirrorcam.core.errors import InputError
from tests.small_set import contents

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="files of POSIX")


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """The folder of a result with one good file, and the place for it."""
    result, place = tmp_path / "result", tmp_path / "place"
    for each in (result, place):
        each.mkdir()
    (result / "a.yaml").write_bytes(b"a")
    return result, place


def test_files_in_folders_are_taken_and_no_log(folders: tuple[Path, Path]) -> None:
    result, place = folders
    (result / "sparse" / "0").mkdir(parents=True)
    (result / "sparse" / "0" / "cameras.bin").write_bytes(b"b")
    (result / "empty").mkdir()
    (result / LOG).write_bytes(b"its own")
    copy_result(result, place)
    assert contents(place) == {"a.yaml": b"a", "sparse/0/cameras.bin": b"b"}
    assert calibration_path(place) == place
    (place / LOG).write_bytes(b"ours")
    (place / "sparse" / "0" / "cameras.bin").unlink()
    (place / "sparse" / "0").rmdir()
    (place / "sparse").rmdir()
    assert calibration_path(place) == place / "a.yaml"
    (place / "a.yaml").unlink()
    with pytest.raises(InputError, match="left no file"):
        calibration_path(place)


def _socket(path: Path) -> None:
    with contextlib.chdir(path.parent):  # the path of a socket is short
        socket.socket(socket.AF_UNIX).bind(path.name)


def _many(path: Path) -> None:
    path.mkdir()
    for number in range(30):
        (path / f"{number}").touch()


def _huge(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2_000_000_000_000)


def _deep(path: Path) -> None:
    (path / "/".join("d" * 12)).mkdir(parents=True)


HOSTILE: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "link to a file": ("b.yaml", lambda path: path.symlink_to("/etc/hostname"), "b.yaml: is a link"),
    "link to itself": ("b.yaml", lambda path: path.symlink_to(path.name), "b.yaml: is a link"),
    "link as the log": (LOG, lambda path: path.symlink_to("/etc/hostname"), "log.txt: is a link"),
    "link to a folder": ("b", lambda path: path.symlink_to("/"), "b: is a link"),
    "pipe": ("b.yaml", os.mkfifo, "b.yaml: is not a regular file"),
    "socket": ("b", _socket, "b: is not a regular file"),
    "two lines": ("b\nc", Path.touch, r"a file named 'b\\nc', expected a name of printable characters"),
    "not UTF-8": (os.fsdecode(b"b\xff"), Path.touch, r"a file named 'b\\udcff', expected a name"),
    "out on Windows": ("..\\b", Path.touch, "expected a name"),
    "many": ("b", _many, "more than 20 files"),
    "huge": ("b", _huge, "or 1 GB"),
    "deep": ("b", _deep, "is nested too deeply"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_what_is_no_calibration_is_refused_before_any_is_taken(
    folders: tuple[Path, Path], case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    result, place = folders
    monkeypatch.setattr(calibrator_run, "MAX_FILES", 20)
    name, make, expected = HOSTILE[case]
    try:
        make(result / name)
    except OSError as error:
        pytest.skip(f"this file system has no such file: {error}")
    with pytest.raises(InputError, match=expected) as caught:
        copy_result(result, place)
    assert f"{caught.value}".isprintable()
    assert list(place.iterdir()) == []


def test_a_folder_that_was_removed_or_replaced_is_refused(folders: tuple[Path, Path], tmp_path: Path) -> None:
    result, place = folders
    moved = result.rename(tmp_path / "moved")
    with pytest.raises(InputError, match="removed"):
        copy_result(result, place)
    result.symlink_to(moved)
    with pytest.raises(InputError, match="replaced"):
        copy_result(result, place)
    result.unlink()
    result.touch()
    with pytest.raises(InputError, match="replaced"):
        copy_result(result, place)


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="root reads every file")
@pytest.mark.parametrize("name", ["a.yaml", "folder"])
def test_what_may_not_be_read_is_refused(folders: tuple[Path, Path], name: str) -> None:
    result, place = folders
    (result / "folder").mkdir()
    (result / name).chmod(0)
    with pytest.raises(InputError, match="cannot be read: Permission denied"):
        copy_result(result, place)
    (result / name).chmod(0o700)
