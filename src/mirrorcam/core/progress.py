"""Progress reports from long work to what displays them."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called as `progress(done, total)` as work proceeds: how many steps, frames or pictures are done, and of how many."""


def no_progress(done: int, total: int) -> None:
    """Ignore progress."""
