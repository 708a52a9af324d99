"""Ctrl-C and SIGTERM: remembered if a native library swallows them, and deferred during indivisible work."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from mirrorcam.core.causes import causes

if sys.platform == "win32":
    SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGBREAK)  # Ctrl-Break
else:
    SIGNALS = (signal.SIGINT, signal.SIGTERM)
SECONDS_OF_ONE = 1.0
"""Signals within this time count as one: `timeout`, for example, signals the process and its group."""

_remembering = False
_asked: signal.Signals | None = None
_raised_s = float("-inf")
_deferrals = 0
_held_back = False


def _on_signal(number: int, frame: FrameType | None) -> None:
    global _asked, _held_back
    _asked = _asked or signal.Signals(number)
    if _deferrals:
        _held_back = True
    else:
        _interrupt()


def _interrupt() -> None:
    global _raised_s
    now = time.monotonic()
    if now - _raised_s > SECONDS_OF_ONE:
        _raised_s = now
        raise KeyboardInterrupt


@contextmanager
def remembered() -> Iterator[None]:
    """Record Ctrl-C and SIGTERM within the block, and raise KeyboardInterrupt for either.

    A signal that the process ignores, as jobs in the background of a script do with Ctrl-C, stays ignored, and one with
    another handler is left to that. Only for the main thread.
    """
    global _remembering, _asked, _raised_s, _held_back
    _remembering, _asked, _raised_s, _held_back = True, None, float("-inf"), False
    unset = (signal.SIG_DFL, signal.default_int_handler)
    before = {number: signal.getsignal(number) for number in SIGNALS}
    ours = [number for number in SIGNALS if before[number] in unset]
    for number in ours:
        signal.signal(number, _on_signal)
    try:
        yield
    finally:
        _remembering = False
        for number in ours:
            signal.signal(number, before[number])


@contextmanager
def deferred() -> Iterator[None]:
    """Defer a `remembered` interruption until the block ends: for short, indivisible work."""
    global _deferrals, _held_back
    _deferrals += 1
    try:
        yield
    finally:
        _deferrals -= 1
    if _held_back and not _deferrals:
        _held_back = False
        _interrupt()


def requested() -> signal.Signals | None:
    """Return the first signal that requested an end since `remembered` was entered; None without one."""
    return _asked


def check() -> None:
    """Raise KeyboardInterrupt if a signal requested an end, even if a library swallowed it.

    That is only so within `remembered`.
    """
    if _remembering and _asked:
        raise KeyboardInterrupt


def ended(error: BaseException) -> bool:
    """Return whether an interruption caused this error.

    What a library makes of one within `remembered`, such as the ImportError of a module that was being loaded, is one.
    """
    return isinstance(error, KeyboardInterrupt) or (
        requested() is not None and any(isinstance(cause, KeyboardInterrupt) for cause in causes(error))
    )
