"""Programs run as children: their output is theirs, and they end with whoever started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mirrorcam.core.processes.child_program import run_program, supervised
from tests.core.processes.processes import ended, first_line

SLEEPS = "import os, sys, time; open(sys.argv[1], 'w').write(f'{os.getpid()}\\n'); time.sleep(300)"


def test_output_exit_code_and_environment_are_those_of_the_program() -> None:
    program = "import os, sys; print(os.environ['WHO'], sys.stdin.read()); print('no', file=sys.stderr); sys.exit(3)"
    done = run_program([sys.executable, "-c", program], timeout_s=60, environment=os.environ | {"WHO": "it"})
    assert (done.returncode, done.stdout.split(), done.stderr.split()) == (3, [b"it"], [b"no"])


def test_a_program_that_is_killed_has_no_good_exit_code() -> None:
    done = run_program([sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"], timeout_s=60)
    assert done.returncode == 137


@pytest.mark.slow
def test_a_program_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        run_program([sys.executable, "-c", SLEEPS, str(tmp_path / "pid")], timeout_s=2)
    assert ended(int(first_line(tmp_path / "pid")))


def test_a_program_ends_with_a_starter_that_is_killed(tmp_path: Path) -> None:
    starter = (
        "import sys; from mirrorcam.core.processes.child_program import run_program; "
        "run_program([sys.executable, '-c', *sys.argv[1:]], timeout_s=300)"
    )
    process = subprocess.Popen([sys.executable, "-c", starter, SLEEPS, str(tmp_path / "pid")])
    pid = int(first_line(tmp_path / "pid"))
    assert not ended(pid, within_s=0.0)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert ended(pid)


@pytest.mark.slow
def test_an_exception_of_the_starter_ends_the_program(tmp_path: Path) -> None:
    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 2.0)
    began = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            run_program([sys.executable, "-c", SLEEPS, str(tmp_path / "pid")], timeout_s=300)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert time.monotonic() - began < 60
    assert ended(int(first_line(tmp_path / "pid")))


INTERRUPTED = """
import os, signal, sys, time
def interrupted(number, frame):
    print("whole", flush=True)
    {}
if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
    signal.signal(signal.SIGINT, interrupted)
print("ready", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("ending_s", "then", "code", "said"),
    [(60.0, "sys.exit(5)", 5, "whole"), (0.3, "pass", 137, "whole"), (0.0, "sys.exit(5)", 137, "")],
    ids=["finishes its file", "goes on", "may not"],
)
def test_a_program_may_finish_its_file_before_it_is_killed(ending_s: float, then: str, code: int, said: str) -> None:
    command = supervised([sys.executable, "-c", INTERRUPTED.format(then)], ending_s=ending_s)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as for jobs in the background of a script
    try:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, before)
    with process:
        assert process.stdin is not None and process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.stdin.close()
        assert process.stdout.read().strip() == said
    assert process.returncode == code


LEAVES = """
import os, subprocess, sys, time
write, how, ends = sys.argv[1:]
sleeps = f"import os, time; open({write!r}, 'w').write(f'{{os.getpid()}}\\\\n'); time.sleep(300)"
if how == "same group":
    subprocess.Popen([sys.executable, "-c", sleeps])
elif how == "own session":
    subprocess.Popen([sys.executable, "-c", sleeps], start_new_session=True)
elif os.fork() == 0:  # a daemon: in a session of its own, and the child of nobody
    os.setsid()
    if os.fork() == 0:
        exec(sleeps)
    os._exit(0)
while not os.path.exists(write) or not open(write).read():
    time.sleep(0.01)
if ends == "kills itself":
    os.kill(os.getpid(), 9)
if ends == "waits":
    time.sleep(300)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="processes of POSIX")
@pytest.mark.parametrize("ends", ["ends well", "waits", "kills itself"])
@pytest.mark.parametrize(
    "how",
    [
        "same group",
        *(
            pytest.param(how, marks=pytest.mark.skipif(sys.platform != "linux", reason="only Linux lists descendants"))
            for how in ("own session", "daemon")
        ),
    ],
)
def test_what_a_program_leaves_behind_ends_with_it_or_with_its_starter(tmp_path: Path, how: str, ends: str) -> None:
    mark = tmp_path / "pid"
    command = supervised([sys.executable, "-c", LEAVES, str(mark), how, ends], tree=True)
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        pid = int(first_line(mark))
        assert process.stdin is not None
        if ends == "waits":
            process.stdin.close()
        code = process.wait(60)
    assert code == (0 if ends == "ends well" else 137)
    assert ended(pid)


def test_a_line_for_the_shell_is_run_by_it(tmp_path: Path) -> None:
    command = supervised("echo $((1 + 2)); exit 5", tree=True)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.read().strip() == b"3"
    assert process.returncode == 5
