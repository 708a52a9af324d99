"""A record knows what a command wrote, whatever else lies in the folder and whenever writing was cut off."""

from __future__ import annotations

import hashlib
import itertools
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from mirrorcam.core.disk.written_files import FolderRecord
from mirrorcam.core.errors import InputError


def tree(folder: Path) -> dict[str, str]:
    """The text of every file of a folder by its path, without the record and what is staged."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    found = {path.relative_to(folder).as_posix(): path.read_text() for path in files}
    return {name: text for name, text in found.items() if name != "record" and not name.startswith("staging/")}


def put(
    folder: Path, *, complete: bool = True, force: bool = False, command: str = "cad", **files: str
) -> dict[str, str]:
    """Adopt files, by names in which __ stands for /; the record is read anew, as by another process."""
    staging = folder / "staging"
    shutil.rmtree(staging, ignore_errors=True)
    for name, text in files.items():
        path = staging / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    FolderRecord(folder / "record").adopt(command, staging, folder, complete=complete, force=force)
    return tree(folder)


def test_files_are_written_replaced_and_deleted_and_others_stay(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    assert put(tmp_path, a="1", deep__b="1", deep__er__c="1") == {
        "mine": "mine",
        "a": "1",
        "deep/b": "1",
        "deep/er/c": "1",
    }
    assert put(tmp_path, a="2", deep__b="1") == {"mine": "mine", "a": "2", "deep/b": "1"}
    assert not (tmp_path / "deep" / "er").exists()
    assert put(tmp_path) == {"mine": "mine"}


def test_a_listed_file_that_nobody_wrote_is_not_deleted(tmp_path: Path) -> None:
    """A shared folder may carry a record that lists what its receiver has in it."""
    (tmp_path / "thesis.docx").write_text("years of work")
    (tmp_path / "folder").mkdir()
    listed = {"thesis.docx": "0" * 64, "folder": "0" * 64}
    (tmp_path / "record").write_text(json.dumps({"schema": "mirrorcam.written/1", "command": "cad", "now": listed}))
    assert put(tmp_path, a="1") == {"thesis.docx": "years of work", "a": "1"}
    assert (tmp_path / "folder").is_dir()


def others_file(folder: Path) -> None:
    (folder / "a").write_text("mine")


def others_link(folder: Path) -> None:
    (folder / "elsewhere").write_text("mine")
    (folder / "a").symlink_to(folder / "elsewhere")


def broken_link(folder: Path) -> None:
    (folder / "a").symlink_to(folder / "nothing")


@pytest.mark.parametrize("other", [others_file, others_link, broken_link])
def test_what_a_command_did_not_write_is_replaced_by_force_alone(other: Callable[[Path], None], tmp_path: Path) -> None:
    other(tmp_path)
    before = tree(tmp_path)
    with pytest.raises(InputError, match="a: was not written by this command, expected another --out, or --force"):
        put(tmp_path, a="1", b="1")
    assert tree(tmp_path) == before
    after = put(tmp_path, a="1", b="1", force=True)
    assert (after["a"], after["b"], after.get("elsewhere", "mine")) == ("1", "1", "mine")


def test_what_was_changed_since_is_replaced_by_force_alone_and_never_deleted(tmp_path: Path) -> None:
    put(tmp_path, a="1", b="1")
    (tmp_path / "a").write_text("edited")
    with pytest.raises(InputError, match="a: was changed since this command wrote it"):
        put(tmp_path, a="2", b="2")
    assert tree(tmp_path) == {"a": "edited", "b": "1"}
    assert put(tmp_path, b="2") == {"a": "edited", "b": "2"}
    # From here on it is the user's.
    with pytest.raises(InputError, match="a: was not written by this command"):
        put(tmp_path, a="2")
    assert put(tmp_path, a="2", force=True) == {"a": "2"}


def test_a_file_that_is_already_as_it_is_to_be_is_none_to_lose(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("1")
    assert put(tmp_path, a="1") == {"a": "1"}
    assert put(tmp_path, a="2") == {"a": "2"}


def test_commands_have_records_of_their_own(tmp_path: Path) -> None:
    put(tmp_path, command="design", a="1")
    with pytest.raises(InputError, match="was not written by this command"):
        put(tmp_path, command="cad", a="2")
    assert put(tmp_path, command="cad", b="1") == {"a": "1", "b": "1"}
    assert put(tmp_path, command="design", a="2") == {"a": "2", "b": "1"}


def test_results_beside_each_other_stay_and_folders_are_written_whole(tmp_path: Path) -> None:
    put(tmp_path, complete=False, one="1", scene__a="1", scene__b="1", other__a="1")
    found = put(tmp_path, complete=False, two="1", scene__a="2")
    assert found == {"one": "1", "two": "1", "scene/a": "2", "other/a": "1"}


@pytest.mark.parametrize("stop", range(4))
def test_writing_that_was_cut_off_goes_on_another_time(
    stop: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, a="1", b="1", c="1")
    moved: list[Path] = []
    replace = Path.replace

    def cut_off(source: Path, target: Path) -> Path:
        if source.parent.name != "staging":
            return replace(source, target)
        if len(moved) == stop:
            raise KeyboardInterrupt
        moved.append(target)
        return replace(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", cut_off)
        if stop < 3:
            with pytest.raises(KeyboardInterrupt):
                put(tmp_path, a="2", b="2", d="2")
        else:
            put(tmp_path, a="2", b="2", d="2")
    assert put(tmp_path, a="3", b="3") == {"a": "3", "b": "3"}


def test_a_damaged_record_knows_nothing(tmp_path: Path) -> None:
    put(tmp_path, a="1")
    record = tmp_path / "record"
    record.write_bytes(b"\x00" * record.stat().st_size)
    with pytest.raises(InputError, match="a: was not written by this command"):
        put(tmp_path, a="2")


@pytest.mark.parametrize(
    "name", ["../outside", "/etc/outside", "..\\outside", "C:\\outside", "link/outside", "", "a\x00b"]
)
def test_no_name_of_a_record_leads_out_of_its_folder(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "outside").write_text("theirs")
    (folder / "link").symlink_to(tmp_path)
    now = {name: hashlib.sha256(b"theirs").hexdigest()}
    (folder / "record").write_text(json.dumps({"schema": "mirrorcam.written/1", "command": "cad", "now": now}))
    put(folder, a="1")
    assert (tmp_path / "outside").read_text() == "theirs"


def test_the_record_grows_by_what_is_new(tmp_path: Path) -> None:
    sizes = []
    record = FolderRecord(tmp_path / "record")
    for number in range(40):
        staging = tmp_path / "staging"
        staging.mkdir(exist_ok=True)
        (staging / f"{number:03d}").write_text("x")
        record.adopt("depth", staging, tmp_path, complete=False, force=False)
        sizes.append((tmp_path / "record").stat().st_size)
    steps = [after - before for before, after in itertools.pairwise(sizes)]
    assert max(steps) == min(steps)
    FolderRecord(tmp_path / "record")
    assert len((tmp_path / "record").read_text().splitlines()) == 1
    assert FolderRecord(tmp_path / "record").of("depth").now == record.of("depth").now


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("blocked", ["file", "folder", "link"])
def test_what_is_in_the_way_is_refused_before_anything_is_moved(blocked: str, force: bool, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    put(folder, a="1", stale="1")
    if blocked == "file":
        (folder / "parts").write_text("mine")
    elif blocked == "folder":
        (folder / "parts" / "x").mkdir(parents=True)
        (folder / "parts" / "x" / "mine").write_text("mine")
    else:
        (tmp_path / "theirs").mkdir()
        (folder / "parts").symlink_to(tmp_path / "theirs")
    before = tree(folder)
    with pytest.raises(InputError, match=r"parts: is a file or a link out of|parts/x: is a folder, expected a file"):
        put(folder, a="2", parts__x="2", force=force)
    assert tree(folder) == before
    assert not (tmp_path / "theirs").exists() or not list((tmp_path / "theirs").iterdir())


def test_a_link_is_replaced_by_force_and_what_it_leads_to_stays(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "mine").write_text("mine")
    folder.mkdir()
    (folder / "a").symlink_to(tmp_path / "theirs")
    with pytest.raises(InputError, match="a: was not written by this command"):
        put(folder, a="1")
    assert put(folder, a="1", force=True) == {"a": "1"}
    assert tree(tmp_path / "theirs") == {"mine": "mine"}
