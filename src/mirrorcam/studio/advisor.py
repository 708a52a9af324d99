"""Requests near refused ones, looked for by a process of its own until their pages have other requests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mirrorcam.core.processes.worker_process import WorkerDied, WorkerProcess
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio import design_work
from mirrorcam.studio.design_values import RefusedDesign, SuggestedRequest
from mirrorcam.studio.turns import Asker, Superseded, Turns


class Advisor:
    """Finds what can be asked for instead; any thread may call. Pages that search at the same time do so in turn."""

    def __init__(self) -> None:
        self._process = WorkerProcess(preload=design_work.PRELOAD)
        self._turns = Turns(self._process.kill)

    def suggestions(self, spec: DesignSpec, refused: RefusedDesign, asker: Asker) -> Iterator[SuggestedRequest]:
        """Requests near a refused one that can be met, as they are found, until the search is ended."""
        try:
            with self._turns.turn(asker, spec), self._searching():
                self._process.call(design_work.begin_suggestions, spec, refused.constraint, refused.finding)
                while not asker.gone and (found := self._process.call(design_work.next_suggestion)) is not None:
                    yield found
        except (Superseded, WorkerDied):
            return  # as the search was ended

    def end_search(self, asker: Asker) -> None:
        """End the search of a page, which has another request."""
        self._turns.give_up_earlier(asker, None)

    def leave(self, asker: Asker) -> None:
        """End a search that its page has ended."""
        self._turns.leave(asker)

    @contextmanager
    def _searching(self) -> Iterator[None]:
        """End the process where a search is not read to its end: it works ahead."""
        try:
            yield
        except GeneratorExit:
            self._process.kill()
            raise

    def close(self) -> None:
        """End at once, for good."""
        self._process.close()
