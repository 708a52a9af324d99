"""Text of a command line, which values convert to numbers; from Python and files, text is no number."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_READING: ContextVar[bool] = ContextVar("reading_command_text", default=False)


def reading_command_text() -> bool:
    """Whether a command line is being read."""
    return _READING.get()


@contextmanager
def command_text() -> Iterator[None]:
    """Let values convert text to numbers while a command line is read."""
    token = _READING.set(True)
    try:
        yield
    finally:
        _READING.reset(token)
