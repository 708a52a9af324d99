"""Designs that a page asks for: solved, kept and previewed by processes of their own."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.base.worker_process import WorkerDied, WorkerProcess
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio import design_work
from mirrorcam.studio.design_values import DesignDrawing, RefusedDesign, SolvedDesign
from mirrorcam.studio.tolerance_values import ToleranceBars

MOST_KEPT = 200


class Superseded(Exception):
    """A design that is no longer asked for: another was, before it was solved."""


class Designer:
    """Solves the newest request and previews others meanwhile; any thread may call.

    What was solved is kept, so that going back to it takes no time.
    """

    def __init__(self) -> None:
        self._solver = WorkerProcess(preload=design_work.PRELOAD)
        self._previewer = WorkerProcess(preload=design_work.PRELOAD)
        self._analyst = WorkerProcess(preload=design_work.PRELOAD)
        self._stored: dict[DesignSpec, Path] = {}
        self._lock = threading.Lock()
        self._turn = threading.Lock()
        self._newest = 0
        self._solving: DesignSpec | None = None
        self._kept: OrderedDict[DesignSpec, SolvedDesign | RefusedDesign] = OrderedDict()

    def start(self) -> None:
        """Start the processes ahead of the first request."""
        for process in (self._solver, self._previewer, self._analyst):
            process.start()

    def close(self) -> None:
        """End all processes."""
        for process in (self._solver, self._previewer, self._analyst):
            process.kill()

    def keep(self, spec: DesignSpec, layout: Layout) -> None:
        """Take a design that was solved before, such as that of a file."""
        found = self._previewer.call(design_work.described, spec, layout)
        with self._lock:
            self._kept[spec] = found

    def offer(self, stored: Mapping[DesignSpec, Path]) -> None:
        """Take the files of layouts that were solved before, such as of a sweep: each is read when it is asked for."""
        self._stored = dict(stored)

    def solve(self, spec: DesignSpec) -> SolvedDesign | RefusedDesign:
        """The exact design of a request; ends the solution of an earlier one, whose call raises Superseded."""
        with self._lock:
            kept = self._kept.get(spec)
            self._newest += 1
            mine = self._newest
            stale = self._solving is not None and self._solving != spec
        if kept is None and spec in self._stored:
            self.keep(spec, Layout.load(self._stored[spec]))
            kept = self._kept[spec]
        if kept is not None:
            return kept
        if stale:
            self._solver.kill()
        with self._turn:
            with self._lock:
                if mine != self._newest:
                    raise Superseded
                self._solving = spec
            try:
                found = self._solver.call(design_work.solve, spec)
            except WorkerDied:
                raise Superseded from None
            finally:
                with self._lock:
                    self._solving = None
        with self._lock:
            self._kept[spec] = found
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return found

    def preview(self, spec: DesignSpec) -> DesignDrawing | None:
        """A drawing of about what a request leads to, at once; None where nothing can be said."""
        with self._lock:
            kept = self._kept.get(spec)
            near = [found.layout for found in self._kept.values() if isinstance(found, SolvedDesign)]
        if isinstance(kept, SolvedDesign):
            return kept.drawing
        return self._previewer.call(design_work.preview, spec, near)

    def solved(self, spec: DesignSpec) -> SolvedDesign:
        """The design of a request that was solved. Raises InputError for another."""
        with self._lock:
            found = self._kept.get(spec)
        if not isinstance(found, SolvedDesign):
            raise InputError("this design is not solved, expected one that is")
        return found

    def tolerance(self, spec: DesignSpec) -> ToleranceBars:
        """What devices of a solved design can be expected to reach, which takes seconds.

        Raises InputError for a design that is not solved, or that cannot be built so.
        """
        return self._analyst.call(design_work.tolerance, self.solved(spec).layout)

    def report(self, spec: DesignSpec) -> str:
        """The report of a solved design. Raises InputError for one that is not."""
        found = self.solved(spec)
        return self._analyst.call(design_work.report, found.layout, found.parabola)
