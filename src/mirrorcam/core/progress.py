"""Progress reports of long work."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called as `progress(done, total)` with the number of steps, frames or pictures done, and their total.

It is called in the thread of the caller, first with no step done and last with all; the total may grow, but never
decreases. An exception that it raises ends the work.
"""


def no_progress(done: int, total: int) -> None:
    """Ignore progress."""


Step = Callable[[str], None]
"""Called with each step of long work in words: "trying bent mirrors"."""


def no_step(step: str) -> None:
    """Ignore steps."""


class Steps:
    """Counts steps whose number is only expected, and reports each: the total grows if more are needed."""

    def __init__(self, progress: Progress, expected: int) -> None:
        self._progress, self._done, self.total = progress, 0, expected
        progress(0, expected)

    def advance(self, *_: object) -> None:
        """Report one more step as done, and another one to come."""
        self._done += 1
        self.total = max(self.total, self._done + 1)
        self._progress(self._done, self.total)

    def counting(self, on_step: Step) -> Step:
        """Return a callback that reports a step, then calls `on_step` with its name."""

        def begin(name: str) -> None:
            self.advance()
            on_step(name)

        return begin

    def finish(self) -> None:
        """Report all steps as done."""
        self._progress(self.total, self.total)
