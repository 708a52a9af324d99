"""Work on designs in the studio's processes, so that the server need not load slow modules."""

from __future__ import annotations

import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.calls import Calls, in_parallel, in_turn
from mirrorcam.core.processes.worker_process import WorkerProcess
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.studio.controls import change_text
from mirrorcam.studio.design_values import (
    FigureText,
    FoundDesign,
    RefusedDesign,
    SolvedDesign,
    SuggestedRequest,
    TargetResult,
    ToleranceBars,
)

if TYPE_CHECKING:
    from mirrorcam.designs.target import Target, TargetDesign

PRELOAD = (
    "mirrorcam.studio.drawing",
    "mirrorcam.optics.design.optimise",
    "mirrorcam.optics.design.preview",
)
"""Modules that worker processes load in advance."""
MAX_LAYOUTS = 300
LOW_PRIORITY = 19


@cache
def _partner() -> WorkerProcess:
    """The process that solves each design together with this one."""
    return WorkerProcess(preload=("mirrorcam.optics.design.optimise",))


def solve(spec: DesignSpec, calls: Calls = in_turn, progress: Progress = no_progress) -> SolvedDesign | RefusedDesign:
    """Solve a request exactly; return the design, or why there is none. `calls` and `progress` as for `design`."""
    from mirrorcam.optics.design.optimise import design

    try:
        layout = design(spec, calls=calls, progress=progress)
    except InfeasibleDesign as error:
        from mirrorcam.studio.drawing import violation_drawing

        drawing = None if error.violation is None else violation_drawing(spec, error.violation)
        return RefusedDesign(error.constraint, error.finding, drawing)
    except InputError as error:
        return RefusedDesign("", str(error))
    return solved_design(layout)


def solved_design(layout: Layout) -> SolvedDesign:
    """Return a solved layout with its drawing."""
    from mirrorcam.studio.drawing import compared_values, design_drawing

    drawing = design_drawing(layout, layout.designed_spec, "exact")
    return SolvedDesign(layout, drawing, compared_values(drawing.figures))


def stored_values(paths: Sequence[Path]) -> list[dict[str, float | None]]:
    """Return the values to compare of designs in files, at low priority."""
    at_low_priority()
    from mirrorcam.studio.drawing import compared_values, device_figures, grouped_figures

    layouts = map(Layout.load, paths)
    return [compared_values(grouped_figures(layout.metrics) | {"device": device_figures(layout)}) for layout in layouts]


_known_layouts: deque[Layout] = deque(maxlen=MAX_LAYOUTS)
"""Designs from which this process interpolates previews."""


def remember(layout: Layout) -> None:
    """Add a design to those from which previews are interpolated."""
    _known_layouts.append(layout)


def preview(spec: DesignSpec) -> str | None:
    """Return an approximate drawing as JSON: interpolated from similar designs, or else of the faceted parabola."""
    from mirrorcam.optics.design.preview import preview as preview_layout
    from mirrorcam.optics.design.program.seeds import faceted_parabola
    from mirrorcam.studio.drawing import design_drawing

    layout = preview_layout(spec, list(_known_layouts))
    try:
        if layout is not None:
            return design_drawing(layout, spec, "preview").model_dump_json()
        return design_drawing(faceted_parabola(spec), spec, "parabola").model_dump_json()
    except InputError:
        return None  # for example, a working depth nearer than the mirrors


def report(layout: Layout) -> str:
    """Render the report of a design as one HTML file, with its faceted parabola and a study of devices as built."""
    from mirrorcam.designs.design_report import design_pictures, design_report
    from mirrorcam.optics.design.assess.monte_carlo import study
    from mirrorcam.optics.design.optimise import assessed_parabola

    spec = layout.designed_spec
    try:
        parabola = assessed_parabola(spec)
    except InputError:  # the request has none
        parabola = None
    try:
        built, not_built = study(layout, Tolerances.hobby(), sorted(spec.depths_mm)), ""
    except InputError as error:  # the report is written without the study
        built, not_built = None, str(error)
    return design_report(layout, parabola, design_pictures(layout, parabola, built), not_built=not_built)


_search: list[Iterator[Any]] = []
"""The search that `next_found` continues."""


def next_found() -> Any:
    """Return what the search finds next; None at its end, or without a search."""
    return next(_search[0], None) if _search else None


def begin_suggestions(spec: DesignSpec, constraint: str, finding: str) -> None:
    """Begin a search for feasible requests near a refused one, each a `SuggestedRequest`."""
    from mirrorcam.optics.design.suggestions import suggestions

    alternatives = suggestions(spec, InfeasibleDesign(constraint, finding), in_parallel(_partner()))
    _search[:] = [
        (
            SuggestedRequest(text=change_text(spec, item.spec, item.parameter), spec=item.spec.model_dump(mode="json"))
            for item in alternatives
        )
    ]


def begin_design(spec: DesignSpec) -> None:
    """Begin to solve a request exactly in two processes: shares of the searches done, then the `DesignResult`."""
    calls = in_parallel(_partner())
    _search[:] = [_in_thread(lambda progress: solve(spec, calls, progress))]


def begin_target(terms: str, spec: DesignSpec, known: Sequence[Layout] = ()) -> None:
    """Begin a search for designs that meet a target: shares of the search done, then the `TargetResult`.

    Designs that are `known` are candidates, too.
    """
    from mirrorcam.designs.target_search import designs_for

    calls = in_parallel(_partner())

    def search(progress: Progress) -> TargetResult:
        try:
            found = designs_for(terms, spec, known=known, calls=calls, progress=progress)
        except InputError as error:
            return TargetResult(refusal=str(error))
        solved = tuple(solved_design(design.layout) for design in found.designs)
        designs = zip(solved, found.designs, strict=True)
        return TargetResult(tuple(_found_design(each, design, found.target) for each, design in designs), solved)

    _search[:] = [_in_thread(search)]


def _in_thread(search: Callable[[Progress], Any]) -> Iterator[Any]:
    """Run a search in a thread, and yield the share that is done as it grows, then the result."""
    found = SimpleQueue[Any]()

    def run() -> None:
        try:
            found.put(search(lambda done, total: found.put(done / total)))
        except Exception as error:  # raised again where the progress is read
            found.put(error)

    threading.Thread(target=run, daemon=True, name="search").start()
    while isinstance(share := found.get(), float):
        yield share
    if isinstance(share, Exception):
        raise share
    yield share


def misses(terms: str, layouts: Sequence[Layout]) -> list[list[str]]:
    """Return the kinds of the terms of a target that each design misses. Raises InputError for an invalid target."""
    from mirrorcam.designs.target import Target, measure

    target = Target.of(terms)
    reached = [measure(layout, target).reached for layout in layouts]
    return [[term.kind for term in target.terms if not figures[term.text].passed] for figures in reached]


def _found_design(solved: SolvedDesign, found: TargetDesign, target: Target) -> FoundDesign:
    from mirrorcam.optics.geometry.mirror_stock import mirrors_text

    terms = [
        FigureText(
            name=term.kind,
            label=term.text,
            text=term.figure_text(metric.value),
            value=metric.value if metric.known else None,
            reason=metric.reason,
            limit=term.text,
            passed=metric.passed,
            lower_is_better=metric.lower_is_better,
        )
        for term, metric in zip(target.terms, found.reached.values(), strict=True)
    ]
    return FoundDesign(
        title=solved.drawing.title,
        spec=solved.drawing.spec,
        terms=terms,
        mirrors=mirrors_text(solved.layout.designed_spec),
        device=found.estimate.text,
    )


def tolerance(layout: Layout) -> ToleranceBars:
    """Compute expected figures of devices built by hand, at low priority."""
    at_low_priority()
    from mirrorcam.studio.drawing import tolerance_bars

    return tolerance_bars(layout)


def at_low_priority() -> None:
    """Lower the priority of this process below the user's requests."""
    if sys.platform != "win32":
        os.setpriority(os.PRIO_PROCESS, 0, LOW_PRIORITY)
