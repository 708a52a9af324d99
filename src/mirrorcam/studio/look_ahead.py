"""Solve designs that a page may request next."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from mirrorcam.core.processes.worker_process import WorkerProcess
from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio import design_work
from mirrorcam.studio.design_values import DesignResult

MAX_MIRRORS = 25
"""Designs with more mirrors take too long to be solved speculatively."""


SCALES = (("scale_mm", 1.3, 0.0), ("scale_mm", 1 / 1.3, 0.0))
STEPS = (
    *((name, 1, step) for step in (1, -1) for name in ("rows", "cols")),
    *SCALES,
    *(("tradeoff", 1, step) for step in (0.2, -0.2)),
    *(("fold_deg", 1, step) for step in (10.0, -10.0)),
)
"""Steps of the controls, likeliest first: a field, and what it is multiplied by and increased by."""


def nearby_requests(spec: DesignSpec) -> dict[DesignSpec, str]:
    """Return requests near this one, likeliest first, for designs that solve in a few seconds.

    First those that are one step of a control away, with its name, then those that differ by a step of the scale, too.
    """
    single = {other: step[0] for step in STEPS for other in _changed(spec, *step)}
    double = [other for first in single for step in SCALES for other in _changed(first, *step)]
    return {other: single.get(other, "") for other in (*single, *double) if other != spec}


def _changed(spec: DesignSpec, name: str, factor: float, difference: float) -> Iterator[DesignSpec]:
    """Yield the request with a changed field, unless it has no such number or is outside the limits of a request."""
    if (spec.pattern is not None and name in ("rows", "cols")) or spec.fold_deg == "auto" == getattr(spec, name):
        return
    value = getattr(spec, name) * factor + difference
    try:
        other = spec.replaced(**{name: round(value) if name == "scale_mm" else round(value, 3)})
    except InvalidValue:
        return  # such as no rows
    if len(other.arrangement.steps) <= MAX_MIRRORS:
        yield other


_log = logging.getLogger(__name__)


class LookAhead:
    """Solves requests speculatively, in order; thread-safe.

    A request that fails is logged as an error.

    Parameters
    ----------
    is_solved
        Returns whether a request is solved already.
    keep
        Called with the solution of a request, in a thread of this object.
    solve
        A module-level function, which can be sent to a process.
    """

    def __init__(
        self,
        is_solved: Callable[[DesignSpec], bool],
        keep: Callable[[DesignSpec, DesignResult], None],
        solve: Callable[[DesignSpec], DesignResult] = design_work.solve,
    ) -> None:
        self._is_solved, self._keep, self._solve = is_solved, keep, solve
        self._process = WorkerProcess(preload=design_work.PRELOAD)
        self._changed = threading.Condition()
        self._pending: list[DesignSpec] = []
        self._pauses = 0
        self._closed = False

    def start(self) -> None:
        """Start the thread."""
        threading.Thread(target=self._work, daemon=True, name="look ahead").start()

    def solve_next(self, specs: Sequence[DesignSpec]) -> None:
        """Replace the requests to solve, in order; the one in progress is finished."""
        with self._changed:
            self._pending = list(specs)
            self._changed.notify_all()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Start no request within the block, nor afterwards until the next `solve_next`."""
        with self._changed:
            self._pauses += 1
        try:
            yield
        finally:
            with self._changed:
                self._pauses -= 1

    def close(self) -> None:
        """End at once."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._process.close()

    def _work(self) -> None:
        while (spec := self._next()) is not None:
            try:
                self._process.call(design_work.at_low_priority)
                self._keep(spec, self._process.call(self._solve, spec))
            except Exception:  # logged: without this design a click only takes longer, and the thread must go on
                if not self._closed:
                    _log.exception("this request is not solved ahead: %r", spec)

    def _next(self) -> DesignSpec | None:
        """Wait for the first unsolved request; None at the end."""
        with self._changed:
            while not self._closed:
                while self._pending and not self._pauses:
                    spec = self._pending.pop(0)
                    if not self._is_solved(spec):
                        return spec
                self._changed.wait()
        return None
