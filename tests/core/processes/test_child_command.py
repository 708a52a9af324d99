"""Commands as processes of their own: what they say, how they end, and that they can be cancelled."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from mirrorcam.core.processes import child_command
from mirrorcam.core.processes.child_command import LINES_KEPT, ChildCommand
from tests.core.processes.processes import ended, first_line

WAITS = """
import signal, sys, time
def interrupted(number, frame):
    {}
signal.signal(signal.SIGINT, interrupted)
print("ready", flush=True)
time.sleep(60)
"""

STARTER = """
import sys, time
from mirrorcam.core.processes import child_command
sys.executable, child_command.ENDING_S = sys.argv[1], float(sys.argv[2])
command = child_command.ChildCommand(["render"])
time.sleep(300)
"""
LEAVES_FILES = """
import os, pathlib, signal, time
here = pathlib.Path(__file__).parent
def interrupted(number, frame):
    (here / "interrupted").write_text("yes\\n")
    {}
signal.signal(signal.SIGINT, interrupted)
(here / "pid").write_text(f"{{os.getpid()}}\\n")
time.sleep(60)
"""


def ready(command: ChildCommand) -> ChildCommand:
    while command.lines[-1:] != ("ready",):
        assert command.returncode is None
        time.sleep(0.02)
    return command


def test_a_command_is_followed_to_its_end(scripted: Path) -> None:
    scripted.write_text("import sys; print(sys.argv[1:], flush=True); sys.exit('no space')")
    command = ChildCommand(["render", "a b.json"])
    assert command.wait(60.0) == command.returncode == 1
    assert command.lines == ("['-m', 'mirrorcam', 'render', 'a b.json']", "no space")
    assert command.seconds == command.seconds > 0.0
    command.cancel()
    assert not command.cancelled


def test_the_last_lines_are_kept(scripted: Path) -> None:
    scripted.write_text("for k in range(1000): print(k)")
    command = ChildCommand(["render"])
    assert command.wait(60.0) == 0
    assert command.lines == tuple(str(k) for k in range(1000 - LINES_KEPT, 1000))


def test_a_line_of_progress_replaces_the_one_before(scripted: Path) -> None:
    scripted.write_text("for k in range(9): print(f'set  {k}/8 frames after {k} s')\nprint('done')")
    command = ChildCommand(["render"])
    assert command.wait(60.0) == 0
    assert command.lines == ("set  8/8 frames after 8 s", "done")


def test_a_cancelled_command_may_finish_its_file(scripted: Path) -> None:
    scripted.write_text(WAITS.format('print("whole"); sys.exit(130)'))
    command = ready(ChildCommand(["render"]))
    assert command.wait(0.01) is None
    command.cancel()
    command.cancel()
    assert command.wait(60.0) == 130
    assert command.cancelled
    assert command.lines == ("ready", "whole")


def test_a_command_that_does_not_end_is_killed(scripted: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_command, "ENDING_S", 0.3)
    scripted.write_text(WAITS.format('print("not yet", flush=True)'))
    command = ready(ChildCommand(["render"]))
    command.cancel()
    assert command.wait(60.0) == 137
    assert command.lines == ("ready", "not yet")


@pytest.mark.parametrize(
    ("ending_s", "then"), [(60.0, "raise SystemExit(130)"), (0.3, "pass")], ids=["ends", "goes on"]
)
def test_it_is_interrupted_and_then_killed_when_its_starter_is_killed(
    scripted: Path, ending_s: float, then: str
) -> None:
    scripted.write_text(LEAVES_FILES.format(then))
    starter = subprocess.Popen([sys.executable, "-c", STARTER, sys.executable, str(ending_s)])
    pid = int(first_line(scripted.with_name("pid")))
    assert not ended(pid, within_s=0.0)
    starter.kill()
    starter.wait()
    assert ended(pid)
    assert first_line(scripted.with_name("interrupted")) == "yes"
