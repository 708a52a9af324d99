"""Progress reports of long work."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called as `progress(done, total)` with the number of steps, frames or pictures done, and their total.

It is called in the thread of the caller; an exception that it raises ends the work.
"""


def no_progress(done: int, total: int) -> None:
    """Ignore progress."""


Step = Callable[[str], None]
"""Called with each step of long work in words: "trying bent mirrors"."""


def no_step(step: str) -> None:
    """Ignore steps."""
