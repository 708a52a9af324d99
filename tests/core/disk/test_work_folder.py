"""Temporary folders go whatever programs leave in them, and take nothing with them that lies elsewhere."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from mirrorcam.core.disk.work_folder import LOCK, PREFIX, remove_stale, remove_tree, work_folder
from tests.small_set import contents


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files of these tests."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return folder


def nested(folder: Path, depth: int) -> None:
    """Folders in folders, by a path that is too long for the system."""
    with contextlib.chdir(folder):
        for _ in range(depth):
            Path("a" * 100).mkdir()
            os.chdir("a" * 100)


@pytest.mark.skipif(sys.platform == "win32", reason="files of POSIX")
def test_a_folder_goes_with_all_that_is_in_it_and_links_lead_nowhere(tmp_path: Path, temporary: Path) -> None:
    other = tmp_path / "suite"
    (other / "set").mkdir(parents=True)
    (other / "set" / "truth.json").write_bytes(b"truth")
    with work_folder() as folder:
        nested(folder, 60)
        (folder / "link").symlink_to(other)
        (folder / "dead").symlink_to(folder / "nothing")
        os.mkfifo(folder / "pipe")
        (folder / "x\ny").touch()
        Path(os.fsdecode(os.fsencode(folder) + b"/\xff")).mkdir()
        (folder / "closed" / "inner").mkdir(parents=True)
        (folder / "closed" / "inner").chmod(0)
        (folder / "closed").chmod(0)
    assert list(temporary.iterdir()) == []
    assert contents(other) == {"set/truth.json": b"truth"}


@pytest.mark.skipif(sys.platform == "win32", reason="links of POSIX")
def test_a_link_that_replaced_a_folder_is_removed_without_its_target(tmp_path: Path, temporary: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a").touch()
    with work_folder() as folder:
        remove_tree(folder)
        folder.symlink_to(tmp_path / "mine")
    assert list(temporary.iterdir()) == []
    assert (tmp_path / "mine" / "a").exists()
    with work_folder() as folder:
        remove_tree(folder)
    assert list(temporary.iterdir()) == []


def test_folders_of_killed_runs_go_and_no_others(temporary: Path) -> None:
    (temporary / f"{PREFIX}mine").mkdir()
    (temporary / f"{PREFIX}mine" / "a").touch()
    waits = (
        "import sys, time; from pathlib import Path; from mirrorcam.core.disk.work_folder import work_folder\n"
        "with work_folder() as folder:\n    print(folder, flush=True); time.sleep(300)"
    )
    runs = [subprocess.Popen([sys.executable, "-c", waits], stdout=subprocess.PIPE, text=True) for _ in range(2)]
    places = []
    for process in runs:
        assert process.stdout is not None
        places.append(Path(process.stdout.readline().strip()))
    killed, alive = places
    (killed / "set").mkdir()
    runs[0].kill()
    runs[0].wait()
    remove_stale()
    assert not killed.exists()
    assert (alive / LOCK).exists()
    assert (temporary / f"{PREFIX}mine" / "a").exists()
    for process in runs:
        process.kill()
        process.communicate()
    remove_stale()
    assert [path.name for path in temporary.iterdir()] == [f"{PREFIX}mine"]
