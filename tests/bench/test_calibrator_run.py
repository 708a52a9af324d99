"""A command's time, end and output, and nothing of it that goes on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mirrorcam.bench.calibrator_run import HEAD_BYTES, TAIL_BYTES, CalibratorRun, run_calibrator
from tests.core.processes.processes import ended, first_line

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="shell of POSIX")
SLEEPS = "import os, sys, time; open(sys.argv[1], 'w').write(f'{os.getpid()}\\n'); time.sleep(300)"


def run(command: str, place: Path, timeout_s: float = 60.0) -> CalibratorRun:
    return run_calibrator(command, place / "set", place / "result", timeout_s)


@pytest.mark.parametrize(
    ("command", "failure"),
    [
        ("echo so >&2; echo it is", ""),
        ("echo so >&2; echo it is; exit 3", "the command ended with exit code 3: it is"),
        ('echo "$MIRRORCAM_SET/x $MIRRORCAM_RESULT"; exit 1', "exit code 1: $MIRRORCAM_SET/x $MIRRORCAM_RESULT"),
        ("kill -9 $$", "signal 9 ended the command"),
        ("kill -SEGV $$", "signal 11 ended the command"),
        ("kill -9 $PPID; sleep 100", "signal 9 ended the command"),
        ("not-a-program-of-anyone", "the command ended with exit code 127"),
        ("exit 255", "the command ended with exit code 255"),
    ],
)
def test_it_says_how_a_command_ended(tmp_path: Path, command: str, failure: str) -> None:
    ran = run(command, tmp_path)
    assert failure in ran.failure
    assert bool(failure) == bool(ran.failure)


def test_both_streams_are_in_the_log_in_their_order(tmp_path: Path) -> None:
    assert run("echo a; echo b >&2; echo c", tmp_path).log == b"a\nb\nc\n"


def test_of_gigabytes_of_output_the_log_has_the_beginning_and_the_end(tmp_path: Path) -> None:
    ran = run("echo first; head -c 300000000 /dev/zero; echo last; exit 1", tmp_path)
    assert ran.failure.endswith("last")
    assert ran.log.startswith(b"first\n") and ran.log.endswith(b"last\n")
    assert b"bytes are omitted here" in ran.log
    assert len(ran.log) < HEAD_BYTES + TAIL_BYTES + 100


@pytest.mark.slow
@pytest.mark.parametrize("command", ["sleep 100", "yes", "kill -STOP $PPID; sleep 100", "sleep 100 & wait"])
def test_a_command_that_takes_too_long_is_ended(tmp_path: Path, command: str) -> None:
    began = time.monotonic()
    assert run(command, tmp_path, 0.5).failure == "the command took longer than 0.5 s"
    assert time.monotonic() - began < 10.0


@pytest.mark.parametrize("detach", ["", "setsid "])
def test_what_a_command_leaves_behind_ends_with_it(tmp_path: Path, detach: str) -> None:
    if detach and sys.platform != "linux":
        pytest.skip("only Linux lists descendants")
    pid = tmp_path / "pid"
    program = f'{detach}"{sys.executable}" -c "{SLEEPS}" "{pid}" & while [ ! -s "{pid}" ]; do sleep 0.02; done'
    assert run(program, tmp_path).failure == ""
    assert ended(int(first_line(pid)))


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives orphans to a process")
def test_what_a_command_leaves_behind_ends_though_it_kills_its_starter(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    wait = f'while [ ! -s "{pid}" ]; do sleep 0.02; done'
    program = f'setsid "{sys.executable}" -c "{SLEEPS}" "{pid}" & {wait}; kill -9 $PPID; sleep 300'
    other = subprocess.Popen(["sleep", "300"])
    try:
        assert run(program, tmp_path).failure == "signal 9 ended the command"
        assert ended(int(first_line(pid)))
        assert other.poll() is None
    finally:
        other.kill()
        other.wait()


def test_a_command_ends_with_this_process_though_it_is_killed(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    here = (
        "import sys; from pathlib import Path; from mirrorcam.bench.calibrator_run import run_calibrator; "
        "run_calibrator(sys.argv[1], Path('/'), Path('/'), 300.0)"
    )
    with subprocess.Popen([sys.executable, "-c", here, f'"{sys.executable}" -c "{SLEEPS}" "{pid}"']) as process:
        number = int(first_line(pid))
        os.kill(process.pid, signal.SIGKILL)
    assert ended(number)
