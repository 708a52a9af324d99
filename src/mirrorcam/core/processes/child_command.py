"""A `mirrorcam` command as a process of its own, for pages that start one: its output, its end, and cancelling it."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence

from mirrorcam.core.processes.child_program import NEW_GROUP, supervised

LINES_KEPT = 40
ENDING_S = 10.0
"""Time that a command has to finish its file when it is cancelled, or this process ends; it is killed afterwards."""


class ChildCommand:
    """A started command; any thread may poll or cancel it.

    It ends with this process, as by Ctrl-C, also if that is killed. A Ctrl-C of the terminal is not for it.

    Parameters
    ----------
    arguments
        What follows `mirrorcam` on the command line.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self.cancelled = False
        """Whether `cancel` came before its end."""
        self._lines: deque[str] = deque(maxlen=LINES_KEPT)
        self._lock = threading.Lock()
        self._began, self._seconds = time.monotonic(), 0.0
        self._process = subprocess.Popen(
            supervised([sys.executable, "-m", "mirrorcam", *arguments], ending_s=ENDING_S),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
            creationflags=NEW_GROUP,
        )
        self._follower = threading.Thread(target=self._follow, daemon=True, name=f"follow {arguments[0]}")
        self._follower.start()

    @property
    def lines(self) -> tuple[str, ...]:
        """The last lines that it has printed, to either stream; all of these once it has ended."""
        with self._lock:
            return tuple(self._lines)

    @property
    def returncode(self) -> int | None:
        """Its exit code, once it has ended and all its lines are there; 128 and its number where a signal ended it."""
        return None if self._follower.is_alive() else self._process.returncode

    @property
    def seconds(self) -> float:
        """How long it has worked."""
        return time.monotonic() - self._began if self._follower.is_alive() else self._seconds

    def wait(self, timeout_s: float | None = None) -> int | None:
        """Its exit code once it has ended; None where it has not after a time."""
        self._follower.join(timeout_s)
        return self.returncode

    def cancel(self) -> None:
        """End it as Ctrl-C would, with finished files complete, without waiting; no effect once it has ended."""
        if self._process.poll() is None and not self.cancelled:
            self.cancelled = True
            assert self._process.stdin is not None
            self._process.stdin.close()

    def _follow(self) -> None:
        with self._process:
            assert self._process.stdout is not None
            for line in self._process.stdout:
                with self._lock:
                    self._lines.append(line.rstrip())
        self._seconds = time.monotonic() - self._began
