"""Ctrl-C that is not lost: some native libraries swallow the KeyboardInterrupt that a signal raises inside them."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_asked = False


def _on_signal(number: int, frame: FrameType | None) -> None:
    global _asked
    _asked = True
    signal.default_int_handler(number, frame)


@contextmanager
def remembered() -> Iterator[None]:
    """Record Ctrl-C within the block, besides raising KeyboardInterrupt; outside a main thread, nothing changes.

    Where the process ignores the signal, as jobs in the background of a script do, it goes on ignoring it.
    """
    global _asked
    _asked = False
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _on_signal)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def check() -> None:
    """Raise KeyboardInterrupt where Ctrl-C was pressed, even if what ran then has swallowed it."""
    if _asked:
        raise KeyboardInterrupt
