"""A `mirrorcam` command in its own process, started by a page: output, exit code, and cancellation."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence

from mirrorcam.core.processes.child_program import NEW_GROUP, supervised

LINES_KEPT = 40
COUNT = re.compile(r"(\d+)/(\d+) [\w ]*after \d+ s$")
"""End of a line of progress: how many of how many are done."""
ENDING_S = 10.0
"""Time for a command to finish its file when it is cancelled or this process ends, before it is killed."""


class ChildCommand:
    """A started command; any thread may poll or cancel it.

    It is interrupted, as by Ctrl-C, when this process ends, even if killed. Ctrl-C in the terminal does not reach it.

    Parameters
    ----------
    arguments
        Arguments after `mirrorcam` on the command line.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self.cancelled = False
        """Whether it was cancelled before its end."""
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
        """The last lines of both streams, complete once it has ended; a line of progress replaces the one before."""
        with self._lock:
            return tuple(self._lines)

    @property
    def returncode(self) -> int | None:
        """Exit code once it has ended and all its output is read; 128 plus the signal that ended it."""
        return None if self._follower.is_alive() else self._process.returncode

    @property
    def seconds(self) -> float:
        """Duration so far."""
        return time.monotonic() - self._began if self._follower.is_alive() else self._seconds

    def wait(self, timeout_s: float | None = None) -> int | None:
        """Wait for its exit code; None after `timeout_s`."""
        self._follower.join(timeout_s)
        return self.returncode

    def cancel(self) -> None:
        """Interrupt it as Ctrl-C would, without waiting: finished files stay complete. No effect once it has ended."""
        if self._process.poll() is None and not self.cancelled:
            self.cancelled = True
            assert self._process.stdin is not None
            self._process.stdin.close()

    def _follow(self) -> None:
        with self._process:
            assert self._process.stdout is not None
            for line in map(str.rstrip, self._process.stdout):
                with self._lock:
                    if COUNT.search(line) and self._lines and COUNT.search(self._lines[-1]):
                        self._lines.pop()
                    self._lines.append(line)
        self._seconds = time.monotonic() - self._began
