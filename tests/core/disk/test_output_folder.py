"""Output folders: one command at a time, files that take their places when all are finished, and whose they are."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from mirrorcam.core.disk.output_folder import HIDDEN, output_folder
from mirrorcam.core.disk.written_files import FolderRecord
from mirrorcam.core.errors import InputError

STAGED = ("", "/parts", "/parts/a.stl")


def contents(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_files_are_moved_into_place_together_when_the_block_ends(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with output_folder(out, "cad") as output:
        with output.staged() as folder:
            (folder / "parts").mkdir()
            (folder / "parts" / "a.stl").write_text("a")
            working = ("holder.json", "lock", "unfinished", *(f"unfinished/files{name}" for name in STAGED))
            assert contents(out) == [HIDDEN, *(f"{HIDDEN}/{name}" for name in working)]
        assert (out / "parts" / "a.stl").read_text() == "a"
    assert contents(out) == [HIDDEN, f"{HIDDEN}/written.jsonl", "parts", "parts/a.stl"]


@pytest.mark.parametrize("error", [InputError, KeyboardInterrupt])
def test_a_block_that_fails_leaves_nothing(error: type[BaseException], tmp_path: Path) -> None:
    with pytest.raises(error), output_folder(tmp_path / "deep" / "out", "cad") as output, output.staged() as folder:
        (folder / "half").write_text("half")
        raise error
    assert contents(tmp_path) == []
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("mine")
    with pytest.raises(error), output_folder(tmp_path / "out", "cad") as output, output.staged() as folder:
        raise error
    assert contents(tmp_path) == ["out", "out/mine"]


@pytest.mark.parametrize("error", [InputError, ValueError, KeyboardInterrupt])
def test_a_finished_result_is_kept_where_what_follows_fails(error: type[BaseException], tmp_path: Path) -> None:
    def work(*names: str) -> None:
        with (
            pytest.raises(error),
            output_folder(tmp_path, "design") as output,
            output.staged(result="layout.json") as folder,
        ):
            for name in names:
                (folder / name).write_text(name)
            raise error

    work("focus.png")
    assert contents(tmp_path) == []
    work("layout.json", "focus.png")
    work("layout.json")
    assert contents(tmp_path) == [HIDDEN, f"{HIDDEN}/written.jsonl", "layout.json"]


def test_names_are_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("mine")
    with output_folder(tmp_path, "cameras") as output:
        output.refuse_others("*.yaml")
        with pytest.raises(InputError, match=r"README\.md: was not written by this command"):
            output.refuse_others("*.yaml", "README.md")
    with output_folder(tmp_path, "cameras", force=True) as output:
        output.refuse_others("README.md")
    (tmp_path / "folder").mkdir()
    with output_folder(tmp_path, "cameras", force=True) as output, pytest.raises(InputError, match="is a folder"):
        output.refuse_others("folder")


def test_a_folder_of_others_is_refused_before_the_work(tmp_path: Path) -> None:
    with output_folder(tmp_path, "run") as output:
        output.subfolder("design").refuse_unknown()
        (tmp_path / "design").mkdir()
        output.subfolder("design").refuse_unknown()
        (tmp_path / "design" / "thesis").write_text("mine")
        with pytest.raises(InputError, match="design: holds files that this command did not write"):
            output.subfolder("design").refuse_unknown()


def test_subfolders_have_records_of_their_own(tmp_path: Path) -> None:
    for names in (("a", "b"), ("b",)):
        with output_folder(tmp_path, "run") as output:
            for part in ("one", "two"):
                with output.subfolder(part).staged() as folder:
                    for name in names if part == "one" else ("a",):
                        (folder / name).write_text(part)
    assert contents(tmp_path) == [HIDDEN, f"{HIDDEN}/written.jsonl", "one", "one/b", "two", "two/a"]


def test_groups_of_files_are_replaced_each_by_itself(tmp_path: Path) -> None:
    for names in (("a", "b"), ("b",)):
        with output_folder(tmp_path, "sweep") as output:
            for group in ("one", "two"):
                with output.grouped(group).staged() as folder:
                    for name in names if group == "one" else ("a",):
                        (folder / f"{group}-{name}").write_text(name)
    assert contents(tmp_path) == [HIDDEN, f"{HIDDEN}/written.jsonl", "one-b", "two-a"]
    (tmp_path / "two-a").write_text("mine")
    with output_folder(tmp_path, "sweep") as output:
        output.grouped("one").refuse_others("one-b")
        with pytest.raises(InputError, match="two-a: was changed since this command wrote it, expected it removed"):
            output.grouped("two").refuse_others("two-a")


HOLDS = """
import sys, time
from pathlib import Path
from mirrorcam.core.disk.output_folder import output_folder
with output_folder(Path(sys.argv[1]), "decode") as output:
    with output.staged() as folder:
        (folder / "half").write_text("half")
        print("held", flush=True)
        time.sleep(60)
"""


def test_the_second_process_names_the_holder_of_the_folder_and_a_dead_holder_is_ignored(tmp_path: Path) -> None:
    holder = subprocess.Popen([sys.executable, "-c", HOLDS, str(tmp_path / "out")], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        busy = rf"out: in use by mirrorcam decode, process {holder.pid} on .+ since \d{{4}}-.* UTC, expected it to end"
        with pytest.raises(InputError, match=busy), output_folder(tmp_path / "out", "depth"):
            pass
        assert (tmp_path / "out" / HIDDEN / "unfinished" / "files" / "half").exists()
    finally:
        holder.send_signal(signal.SIGKILL if os.name != "nt" else signal.SIGTERM)
        holder.communicate()
    with output_folder(tmp_path / "out", "decode") as output, output.staged() as folder:
        assert contents(folder) == []
        (folder / "whole").write_text("whole")
    assert contents(tmp_path / "out") == [HIDDEN, f"{HIDDEN}/written.jsonl", "whole"]


@pytest.mark.parametrize("kind", ["file", "link"])
def test_a_hidden_folder_of_somebody_else_is_refused(kind: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "theirs").mkdir()
    if kind == "file":
        (out / HIDDEN).write_text("mine")
    else:
        (out / HIDDEN).symlink_to(tmp_path / "theirs")
    with pytest.raises(InputError, match="expected a new --out"), output_folder(out, "cad"):
        pass
    assert contents(tmp_path / "theirs") == []


def test_a_file_instead_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    for path in (tmp_path / "out", tmp_path / "out" / "deeper"):
        with pytest.raises(InputError, match=r"is a file|cannot be written"), output_folder(path, "cad"):
            pass
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.parametrize("link", ["unfinished", "unfinished/files"])
def test_unfinished_files_that_a_link_hides_are_not_removed(link: str, tmp_path: Path) -> None:
    (tmp_path / "theirs" / "files").mkdir(parents=True)
    (tmp_path / "theirs" / "thesis").write_text("mine")
    (tmp_path / "theirs" / "files" / "thesis").write_text("mine")
    path = tmp_path / "out" / HIDDEN / link
    path.parent.mkdir(parents=True)
    path.symlink_to(tmp_path / "theirs")
    with output_folder(tmp_path / "out", "cad") as output, output.staged() as folder:
        (folder / "a").write_text("a")
    assert contents(tmp_path / "theirs") == ["files", "files/thesis", "thesis"]
    assert (tmp_path / "out" / "a").read_text() == "a"


@pytest.mark.parametrize("name", ["written.jsonl", "lock", "holder.json"])
def test_nothing_is_written_through_a_link_in_the_hidden_folder(name: str, tmp_path: Path) -> None:
    (tmp_path / "thesis").write_text("mine")
    (tmp_path / "out" / HIDDEN).mkdir(parents=True)
    (tmp_path / "out" / HIDDEN / name).symlink_to(tmp_path / "thesis")
    with pytest.raises(InputError, match=f"{name}: is a link"), output_folder(tmp_path / "out", "cad"):
        pass
    assert (tmp_path / "thesis").read_text() == "mine"


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
    listed = {"thesis.docx": ["0" * 64], "folder": ["0" * 64]}
    (tmp_path / "record").write_text(json.dumps({"schema": "mirrorcam.written/2", "command": "cad", "files": listed}))
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


def test_an_earlier_version_that_somebody_restored_is_replaced_by_force_alone(tmp_path: Path) -> None:
    put(tmp_path, a="1")
    put(tmp_path, a="2")
    (tmp_path / "a").write_text("1")
    with pytest.raises(InputError, match="a: was changed since this command wrote it"):
        put(tmp_path, a="3")
    assert put(tmp_path, a="3", force=True) == {"a": "3"}


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


def test_other_results_stay_and_folders_are_replaced_completely(tmp_path: Path) -> None:
    put(tmp_path, complete=False, one="1", scene__a="1", scene__b="1", other__a="1")
    found = put(tmp_path, complete=False, two="1", scene__a="2")
    assert found == {"one": "1", "two": "1", "scene/a": "2", "other/a": "1"}


@pytest.mark.parametrize("stop", range(4))
def test_interrupted_writing_is_resumed_by_the_next_run(
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
    listed = {name: [hashlib.sha256(b"theirs").hexdigest()]}
    (folder / "record").write_text(json.dumps({"schema": "mirrorcam.written/2", "command": "cad", "files": listed}))
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
    assert FolderRecord(tmp_path / "record").of("depth") == record.of("depth")


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
