"""A recording is killed and run again as in the table, and what the table looks for is found."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.robustness import kills
from benchmarks.robustness.guard import watched
from benchmarks.robustness.kills import (
    COMMANDS,
    MARK,
    TERMINATED,
    End,
    Killed,
    contents,
    cycle,
    half_written,
    processes_with,
    unlike_the_end,
)


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found by their environment on Linux only")
def test_a_recording_that_is_killed_is_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kills, "SECONDS_TO_END", 20.0)  # on a busy machine
    decode = next(command for command in COMMANDS if command.name == "decode")
    assert watched(lambda seed, folder: cycle(decode, seed, folder), 1, 300.0) == ""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are found by their environment on Linux only")
@pytest.mark.parametrize("command", TERMINATED, ids=lambda command: command.name)
def test_a_command_that_is_terminated_says_so_and_takes_its_workers_along(
    command: Killed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kills, "SECONDS_TO_END", 20.0)  # on a busy machine
    assert watched(lambda seed, folder: cycle(command, seed, folder, signal.SIGTERM), 1, 1200.0) == ""


def test_an_end_without_a_word_is_found() -> None:
    whole = {"a": "1"}
    said = "mirrorcam: terminated; finished files are complete\n"
    assert unlike_the_end(End(143, said, ()), signal.SIGTERM, {}, whole) == ""
    assert unlike_the_end(End(0, "", ()), signal.SIGTERM, whole, whole) == ""
    assert unlike_the_end(End(-15, "", ()), signal.SIGTERM, {}, whole) == ""
    assert unlike_the_end(End(-15, "", ()), signal.SIGTERM, {"a": "0"}, whole) == "ended with -15: ''"
    assert unlike_the_end(End(143, said * 2, ()), signal.SIGTERM, {}, whole).startswith("ended with 143")
    assert unlike_the_end(End(-9, "", ()), signal.SIGKILL, {}, whole) == ""


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
