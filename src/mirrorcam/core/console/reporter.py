"""Reporters of work in several steps: one that prints on a terminal, and a silent one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.progress import Progress, no_progress


class Reporter(Protocol):
    """Receives the progress of work in several steps: the start and progress of each step, and remarks."""

    def note(self, title: str, text: str) -> None:
        """Report a remark about the step `title`."""

    def work(self, title: str, doing: str, unit: str = "") -> AbstractContextManager[Progress]:
        """Report the start of a step; the context returns its `advance(done, total)` and ends with the step."""


class Terminal:
    """Prints steps and remarks on standard output."""

    def note(self, title: str, text: str) -> None:
        say(title, text)

    def work(self, title: str, doing: str, unit: str = "") -> AbstractContextManager[Progress]:
        return long_work(title, doing, unit)


class Silent:
    """A reporter that prints nothing."""

    def note(self, title: str, text: str) -> None:
        pass

    @contextmanager
    def work(self, title: str, doing: str, unit: str = "") -> Iterator[Progress]:
        yield no_progress


TERMINAL, SILENT = Terminal(), Silent()
