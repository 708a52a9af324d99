"""Processes that tests wait for: what they write, and whether they have ended."""

from __future__ import annotations

import os
import time
from pathlib import Path


def finding_tests() -> dict[str, str]:
    """The environment of a process that imports from `tests`, and all else as this one does."""
    found_in = os.pathsep.join([str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": found_in}


def first_line(path: Path) -> str:
    """The first line of a file, as soon as another process has written it."""
    deadline = time.monotonic() + 60
    while not (path.exists() and "\n" in path.read_text()):
        assert time.monotonic() < deadline, f"{path} was not written"
        time.sleep(0.01)
    return path.read_text().splitlines()[0]


def ended(pid: int, within_s: float = 20.0) -> bool:
    """Whether a process has ended, or does within a time that is long enough for a busy machine."""
    deadline = time.monotonic() + within_s
    while _runs(pid):
        if time.monotonic() >= deadline:
            return False
        time.sleep(0.01)
    return True


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")
    # One that has ended, whom nobody has asked about yet, is there still.
    return not (status.exists() and status.read_text().rpartition(")")[2].split()[0] == "Z")
