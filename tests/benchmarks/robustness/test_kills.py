"""A recording is killed and run again as in the table, and what the table looks for is found."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.robustness import kills
from benchmarks.robustness.guard import watched
from benchmarks.robustness.kills import COMMANDS, MARK, contents, cycle, half_written, processes_with


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found by their environment on Linux only")
def test_a_recording_that_is_killed_is_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kills, "SECONDS_TO_END", 20.0)  # on a busy machine
    decode = next(command for command in COMMANDS if command.name == "decode")
    assert watched(lambda seed, folder: cycle(decode, seed, folder), 1, 300.0) == ""


def test_half_written_files_are_found(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "0.png").write_bytes(b"whole")
    whole = contents(tmp_path)
    assert half_written(tmp_path, whole) == ""
    assert half_written(tmp_path, {"frames/0.png": "0"}) == "frames/0.png"
    manifest = tmp_path / "set.json"
    manifest.write_text(json.dumps({"files": whole}))
    assert half_written(tmp_path, whole) == ""
    manifest.write_text(json.dumps({"files": {"frames/0.png": "0"}}))
    assert half_written(tmp_path, whole) == "set.json"
    manifest.rename(tmp_path / "frames" / "0.png")
    (tmp_path / "video.zarr.partial").mkdir()
    (tmp_path / "frames" / "0.png").rename(tmp_path / "video.zarr.partial" / "journal.jsonl")
    assert half_written(tmp_path, whole) == ""


def test_hidden_files_are_no_results(tmp_path: Path) -> None:
    (tmp_path / ".mirrorcam").mkdir()
    for name in (".mirrorcam/lock", ".beginning", "result"):
        (tmp_path / name).write_text(name)
    assert list(contents(tmp_path)) == ["result"]


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found by their environment on Linux only")
def test_processes_are_found_by_their_mark() -> None:
    program = "print('began', flush=True); input()"
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        env=os.environ | {MARK: "of this test"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.readline()  # its environment can be read from the moment that its program runs
    assert processes_with("of this test") == [process.pid]
    process.kill()
    process.communicate()
    assert processes_with("of this test") == []
