"""A process of a live session, and the thread of the engine that gives it work."""

from __future__ import annotations

import threading
from collections.abc import Callable

from mirrorcam.core.processes.worker_process import WorkerDied, WorkerProcess
from mirrorcam.core.values import InputError

ENDING_S = 5.0
"""Time that work has to end by itself."""


class LiveWorker:
    """A worker process that a thread stands by; close it.

    Parameters
    ----------
    what
        What it is for, as messages name it.
    work
        What the thread does, by calls of `process`, until `ending` is set.
    fail
        Called with one line where `work` fails before it is to end.

    Attributes
    ----------
    process : WorkerProcess
        The process.
    changed : threading.Condition
        What `work` waits on for more to do, or for its end.
    ending : threading.Event
        Set when `work` is to return.
    """

    def __init__(self, what: str, work: Callable[[], None], fail: Callable[[str], None]) -> None:
        self.process, self.changed, self.ending = WorkerProcess(), threading.Condition(), threading.Event()
        self._what, self._work, self._fail = what, work, fail
        self._thread = threading.Thread(target=self._run, name=f"live {what}", daemon=True)

    def start(self) -> None:
        """Begin the work."""
        self._thread.start()

    def close(self, *, at_once: bool = False) -> None:
        """End the thread and the process: after what `work` still does within ENDING_S, or in the middle of a call."""
        with self.changed:
            self.ending.set()
            self.changed.notify_all()
        if at_once:
            self.process.close()
        if self._thread.ident is not None:
            self._thread.join(ENDING_S)
        self.process.close()

    def _run(self) -> None:
        try:
            self._work()
        except (InputError, RuntimeError, WorkerDied) as error:
            if not self.ending.is_set():
                died = isinstance(error, WorkerDied)
                self._fail(f"the process for {self._what} has ended {error}" if died else str(error))
