"""Designs requested by pages: solutions, previews, studies and feasible alternatives, in worker processes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Generator, Hashable, Iterator, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_process import WorkerDied, WorkerProcess
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_stock import STOCK_FIELDS, mirrors_text
from mirrorcam.studio import design_work
from mirrorcam.studio.controls import change_text, control_groups
from mirrorcam.studio.design_values import (
    DesignPoint,
    DesignResult,
    Neighbourhood,
    RefusedDesign,
    SolvedDesign,
    SuggestedRequest,
    TargetResult,
)
from mirrorcam.studio.look_ahead import LookAhead, nearby_requests
from mirrorcam.studio.turns import PageRequest, Superseded, Turns

Result = TypeVar("Result")


class Search:
    """Makes searches that find one result after the other; any thread may call. Searches of several pages take turns.

    Pages take `turns` on its process: a search whose page is dropped there ends.
    """

    def __init__(self) -> None:
        self.process = WorkerProcess(preload=design_work.PRELOAD)
        self.turns = Turns(self.process.kill)

    def results(
        self, page_request: PageRequest, begin: Callable[..., None], *arguments: Hashable
    ) -> Generator[Any, None, None]:
        """Begin a search, and yield its results until it ends or its page has a new request."""
        try:
            with self.turns.turn(page_request, arguments):
                yield from self.found(page_request, begin, *arguments)
        except (Superseded, WorkerDied):
            return  # the search was ended

    def found(self, page_request: PageRequest, begin: Callable[..., None], *arguments: Hashable) -> Iterator[Any]:
        """Yield the results of a search whose turn it is. Raises WorkerDied if the process ends."""
        try:
            self.process.call(begin, *arguments)
            while not page_request.dropped and (found := self.process.call(design_work.next_found)) is not None:
                yield found
        except GeneratorExit:  # abandoned, but the process works ahead
            self.process.kill()
            raise


MAX_RESULTS = 300


TITLED = ("rows", "cols", "pattern", "scale_mm", "fold_deg", "tradeoff", *STOCK_FIELDS, "shape")
"""Fields that the title of a design states; it states others only if they differ from the request's."""


def _title(spec: DesignSpec, other: DesignSpec) -> str:
    fold = other.fold_deg if other.fold_deg == "auto" else f"{other.fold_deg:g}\N{DEGREE SIGN}"
    first = f"{other.arrangement.text}, {other.scale_mm:g} mm, fold {fold}, trade-off {other.tradeoff:g}"
    differing = (control for group in control_groups(other) for control in group.controls if control.name not in TITLED)
    changes = [
        change_text(spec, other, control.name)
        for control in differing
        if getattr(other, control.name) != getattr(spec, control.name)
    ]
    return ", ".join((first, mirrors_text(other), *changes))


def _changes(spec: DesignSpec, other: DesignSpec) -> dict[str, Any]:
    """Return the fields of `other` that differ, as JSON values."""
    written = other.model_dump(mode="json")
    names = [name for name in DesignSpec.model_fields if getattr(other, name) != getattr(spec, name)]
    return {name: written.get(name, getattr(other, name)) for name in names}


class Designer:
    """Solves the newest request of each page in turn, and previews others meanwhile; any thread may call.

    Solved designs are kept: returning to one is immediate, and previews interpolate between them. While idle, a
    low-priority process solves the last preview, then requests near the newest.
    """

    def __init__(self) -> None:
        self._stored: dict[DesignSpec, Path] = {}
        self._stored_values: dict[DesignSpec, dict[str, float | None]] = {}
        self._reading = threading.Lock()
        self._results: OrderedDict[DesignSpec, DesignResult] = OrderedDict()
        self._misses: dict[tuple[str, str], list[str]] = {}
        """The kinds of missed terms, by the identity of a layout and the newest target."""
        self._previewer, self._painter = WorkerProcess(preload=design_work.PRELOAD), WorkerProcess()
        self._solver, self._studies, self._advisor, self._finder = Search(), Search(), Search(), Search()
        self._look_ahead = LookAhead(self._results.__contains__, self._keep)
        self._lock = threading.Lock()
        self._closed = False

    @property
    def _searches(self) -> tuple[Search, ...]:
        return self._solver, self._studies, self._advisor, self._finder

    def start(self, *, at_once: bool = True) -> None:
        """Start; with `at_once`, start the processes for the first request in advance, others when needed."""
        for process in (self._previewer, self._solver.process) if at_once else ():
            process.start()
        self._look_ahead.start()

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            self._closed = True
        self._look_ahead.close()
        for process in (*(search.process for search in self._searches), self._previewer, self._painter):
            process.close()

    def keep(self, spec: DesignSpec, layout: Layout) -> None:
        """Add a solved design, such as an opened file's."""
        self._keep(spec, self._previewer.call(design_work.solved_design, layout))

    def offer(self, stored: Mapping[DesignSpec, Path]) -> None:
        """Add files of solved layouts, such as a sweep's; each is read when it is requested."""
        self._stored = dict(stored)

    def solve(self, spec: DesignSpec, page_request: PageRequest | None = None) -> Iterator[float | DesignResult]:
        """Solve a request exactly when its page has its turn: yield the share of the searches done, then the result.

        A page's new request ends the solution of its earlier one, which then has no result.
        """
        page_request = page_request or PageRequest()
        if spec in self._stored and spec not in self._results:
            try:
                self.keep(spec, Layout.load(self._stored[spec]))
            except InputError as error:
                yield RefusedDesign("", str(error))
                return
        self._advisor.turns.drop_earlier(page_request, None)  # for an abandoned request
        result = self._results.get(spec)
        if result is None:
            result = yield from self._solve_in_turn(spec, page_request)
        else:
            self._solver.turns.drop_earlier(page_request, spec)
        if result is not None:
            self._look_ahead.solve_next(list(nearby_requests(spec)))
            yield result

    def leave(self, page_request: PageRequest) -> None:
        """Cancel a request that its page abandoned."""
        for search in self._searches:
            search.turns.leave(page_request)

    def _solve_in_turn(
        self, spec: DesignSpec, page_request: PageRequest
    ) -> Generator[float, None, DesignResult | None]:
        try:
            with self._solver.turns.turn(page_request, spec), self._look_ahead.paused():
                result = self._results.get(spec)
                if result is None:
                    for found in self._solver.found(page_request, design_work.begin_design, spec):
                        if isinstance(found, float):
                            yield found
                        else:
                            result = found
                            self._keep(spec, result)
                return result
        except Superseded:
            return None
        except WorkerDied as death:
            if page_request.dropped or self._closed:
                return None
            return RefusedDesign("", f"the process that solved it ended {death}: change something, or try again")

    def _keep(self, spec: DesignSpec, result: DesignResult) -> None:
        with self._lock:
            self._results[spec] = result
            while len(self._results) > MAX_RESULTS:
                self._results.popitem(last=False)
        if isinstance(result, SolvedDesign):
            self._previewer.call(design_work.remember, result.layout)

    def preview(self, spec: DesignSpec) -> str | None:
        """An immediate, approximate drawing of a request's design, as JSON; None without a preview."""
        result = self._results.get(spec)
        if isinstance(result, SolvedDesign):
            return result.drawing.model_dump_json()
        drawing: str | None = self._previewer.call(design_work.preview, spec)
        self._look_ahead.solve_next([spec])
        return drawing

    def solved(self, spec: DesignSpec) -> SolvedDesign:
        """The design of a solved request. Raises InputError for others."""
        result = self._results.get(spec)
        if not isinstance(result, SolvedDesign):
            raise InputError("this design is not solved yet, expected a solved one")
        return result

    def studied(self, work: Callable[[Layout], Result], spec: DesignSpec, page_request: PageRequest) -> Result:
        """The result of slow work on a solved design, such as `design_work.report`.

        Raises InputError for a design that is not solved, and as the work does; Superseded or WorkerDied if the page
        has another request meanwhile.
        """
        layout = self.solved(spec).layout
        with self._studies.turns.turn(page_request, (work, spec)):
            result: Result = self._studies.process.call(work, layout)
            return result

    def nearby(self, spec: DesignSpec, terms: str = "") -> Neighbourhood:
        """All solved designs for the camera and the depths of a request, such as those one step of a control away.

        With the `terms` of a target, designs state which of them they miss. Raises InputError for an invalid target.
        """
        steps = nearby_requests(spec)
        with self._reading:
            if self._stored and not self._stored_values:
                found = self._studies.process.call(design_work.stored_values, list(self._stored.values()))
                self._stored_values = dict(zip(self._stored, found, strict=True))
        with self._lock:
            results = {other: result for other, result in self._results.items() if isinstance(result, SolvedDesign)}
            pending = sum(other not in self._results for other in steps)
        solved = {other: result.values for other, result in results.items()}
        shown = {
            other: values
            for other, values in (self._stored_values | solved).items()
            if (other.camera, other.depths_mm) == (spec.camera, spec.depths_mm)
        }
        misses = self._missed(terms, {other: results[other].layout for other in shown if other in results})
        points = [
            DesignPoint(
                title=_title(spec, other),
                changes=_changes(spec, other),
                step=steps.get(other, ""),
                values=values,
                misses=misses.get(other),
            )
            for other, values in shown.items()
        ]
        return Neighbourhood(points=points, pending=pending)

    def _missed(self, terms: str, layouts: Mapping[DesignSpec, Layout]) -> dict[DesignSpec, list[str]]:
        """The kinds of the terms of a target that designs miss, measured once for each design."""
        if not terms:
            return {}
        with self._reading:
            self._misses = {key: found for key, found in self._misses.items() if key[1] == terms}
            new = [layout for layout in layouts.values() if (layout.identity, terms) not in self._misses]
            found = self._previewer.call(design_work.misses, terms, new)
            self._misses |= {(layout.identity, terms): kinds for layout, kinds in zip(new, found, strict=True)}
            return {spec: self._misses[layout.identity, terms] for spec, layout in layouts.items()}

    def suggestions(self, spec: DesignSpec, page_request: PageRequest | None = None) -> Iterator[SuggestedRequest]:
        """Yield feasible requests near a refused one until its page has a new request.

        Raises InputError for a request that was not refused.
        """
        refused = self._results.get(spec)
        if not isinstance(refused, RefusedDesign) or not refused.constraint:
            raise InputError("this design was not refused, expected a refused one")
        begin, why = design_work.begin_suggestions, (refused.constraint, refused.finding)
        return self._advisor.results(page_request or PageRequest(), begin, spec, *why)

    def target(
        self, terms: str, spec: DesignSpec, page_request: PageRequest | None = None
    ) -> Iterator[float | TargetResult]:
        """Search designs that meet a target, such as "0.3mm@400mm 90EUR": yield the share done, then the result.

        Designs solved before for the same camera are candidates, too.
        """
        with self._lock:
            layouts = [result.layout for result in self._results.values() if isinstance(result, SolvedDesign)]
        known = [layout for layout in layouts if layout.camera == spec.camera]
        begin = partial(design_work.begin_target, known=known)
        with (
            self._look_ahead.paused(),
            closing(self._finder.results(page_request or PageRequest(), begin, terms, spec)) as results,
        ):
            for found in results:
                for solved in found.solved if isinstance(found, TargetResult) else ():
                    self._keep(DesignSpec.model_validate(solved.drawing.spec), solved)
                yield found

    def sight(self, work: Callable[..., Result], spec: DesignSpec, *arguments: Any) -> Result:
        """The result of a function of `sight_work` for a solved design. Raises InputError as it does."""
        result: Result = self._painter.call(work, self.solved(spec).layout, *arguments)
        return result
