"""A recording is killed and run again as in the table, and what the table looks for is found."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.robustness.guard import watched
from benchmarks.robustness.kills import COMMANDS, MARK, contents, cycle, half_written, processes_with


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found by their environment on Linux only")
def test_a_recording_that_is_killed_is_gone_on_with(tmp_path: Path) -> None:
    decode = next(command for command in COMMANDS if command.name == "decode")
    assert watched(lambda seed, folder: cycle(decode, seed, folder), 1, 300.0) == ""


def test_half_written_files_are_found() -> None:
    whole = {"a.json": "1", "frames/0.png": "2"}
    assert half_written({"a.json": "1"}, whole, ()) == ""
    assert half_written({"a.json": "0"}, whole, ()) == "a.json"
    assert half_written({"frames/1.png": "2"}, whole, ()) == "frames/1.png"
    growing = {"video.zarr.partial/journal.jsonl": "0", "a.json": "1"}
    assert half_written(growing, whole, (".partial",)) == ""
    assert half_written(growing, whole, ()) == "video.zarr.partial/journal.jsonl"


def test_hidden_files_are_no_results(tmp_path: Path) -> None:
    (tmp_path / ".mirrorcam").mkdir()
    for name in (".mirrorcam/lock", ".beginning", "result"):
        (tmp_path / name).write_text(name)
    assert list(contents(tmp_path)) == ["result"]


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found by their environment on Linux only")
def test_processes_are_found_by_their_mark() -> None:
    process = subprocess.Popen(["sleep", "60"], env=os.environ | {MARK: "of this test"})
    assert processes_with("of this test") == [process.pid]
    process.kill()
    process.wait()
    assert processes_with("of this test") == []
