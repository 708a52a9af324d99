"""Requests near a refused one, looked for by a process of its own until another request comes."""

from __future__ import annotations

import threading
from collections.abc import Iterator

from mirrorcam.optics.base.worker_process import WorkerDied, WorkerProcess
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio import design_work
from mirrorcam.studio.design_values import RefusedDesign, SuggestedRequest


class Advisor:
    """Finds what can be asked for instead; any thread may call."""

    def __init__(self) -> None:
        self._process = WorkerProcess(preload=design_work.PRELOAD)
        self._lock = threading.Lock()
        self._searches = 0
        self._ended = 0

    def suggestions(self, spec: DesignSpec, refused: RefusedDesign) -> Iterator[SuggestedRequest]:
        """Requests near a refused one that can be met, as they are found, until the search is ended."""
        with self._lock:
            self._searches += 1
            mine = self._ended
        try:
            self._process.call(design_work.begin_suggestions, spec, refused.constraint, refused.finding)
            while mine == self._ended and (found := self._process.call(design_work.next_suggestion)) is not None:
                yield found
        except WorkerDied:
            return  # as the search was ended
        finally:
            with self._lock:
                self._searches -= 1

    def end_searches(self) -> None:
        """End what is searched; a later search begins anew."""
        with self._lock:
            self._ended += 1
            if self._searches:
                self._process.kill()

    def close(self) -> None:
        """End at once, for good."""
        self._process.close()
