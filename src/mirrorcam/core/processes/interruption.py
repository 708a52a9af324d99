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
SAME_SIGNAL_S = 1.0
"""Signals within this time count as one: `timeout`, for example, signals the process and its group."""

_remembering = False
_requested: signal.Signals | None = None
_raised_s = float("-inf")
_deferrals = 0
_is_pending = False


def _on_signal(number: int, frame: FrameType | None) -> None:
    global _requested, _is_pending
    _requested = _requested or signal.Signals(number)
    if _deferrals:
        _is_pending = True
    else:
        _interrupt()


def _interrupt() -> None:
    global _raised_s
    now = time.monotonic()
    if now - _raised_s > SAME_SIGNAL_S:
        _raised_s = now
        raise KeyboardInterrupt


@contextmanager
def remembered() -> Iterator[None]:
    """Record Ctrl-C and SIGTERM within the block, and raise KeyboardInterrupt for either.

    A signal that the process ignores, as background jobs of a script ignore Ctrl-C, stays ignored, and a signal with
    another handler keeps it. Only for the main thread.
    """
    global _remembering, _requested, _raised_s, _is_pending
    _remembering, _requested, _raised_s, _is_pending = True, None, float("-inf"), False
    defaults = (signal.SIG_DFL, signal.default_int_handler)
    previous = {number: signal.getsignal(number) for number in SIGNALS}
    handled = [number for number in SIGNALS if previous[number] in defaults]
    for number in handled:
        signal.signal(number, _on_signal)
    try:
        yield
    finally:
        _remembering = False
        for number in handled:
            signal.signal(number, previous[number])


@contextmanager
def deferred() -> Iterator[None]:
    """Defer a `remembered` interruption until the block ends: for short, indivisible work."""
    global _deferrals, _is_pending
    _deferrals += 1
    try:
        yield
    finally:
        _deferrals -= 1
    if _is_pending and not _deferrals:
        _is_pending = False
        _interrupt()


def requested() -> signal.Signals | None:
    """Return the first signal that requested an end since `remembered` was entered; None without one."""
    return _requested


def check() -> None:
    """Raise KeyboardInterrupt if a signal requested an end, even if a library swallowed it.

    Has no effect outside `remembered`.
    """
    if _remembering and _requested:
        raise KeyboardInterrupt


def caused(error: BaseException) -> bool:
    """Return whether an interruption caused this error.

    Within `remembered`, this includes errors that a library raises instead, such as ImportError while a module loads.
    """
    return isinstance(error, KeyboardInterrupt) or (
        requested() is not None and any(isinstance(cause, KeyboardInterrupt) for cause in causes(error))
    )
