"""Work on designs that processes of the studio do. What is slow to load is loaded there, not by the server."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Iterator
from functools import cache

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.calls import Calls, beside, in_turn
from mirrorcam.core.processes.worker_process import WorkerProcess
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.studio.controls import change_text
from mirrorcam.studio.design_values import RefusedDesign, SolvedDesign, SuggestedRequest, ToleranceBars

PRELOAD = (
    "mirrorcam.studio.drawing",
    "mirrorcam.optics.design.optimise",
    "mirrorcam.optics.design.preview",
)
"""Modules that worker processes load in advance."""
MOST_REMEMBERED = 300
LOW_PRIORITY = 19


@cache
def _partner() -> WorkerProcess:
    """The process that this one shares the solution of a design with."""
    return WorkerProcess(preload=("mirrorcam.optics.design.optimise",))


def solve_in_two(spec: DesignSpec) -> SolvedDesign | RefusedDesign:
    """The exact design of a request, or why there is none, found by this process and another."""
    return solve(spec, beside(_partner()))


def solve(spec: DesignSpec, calls: Calls = in_turn) -> SolvedDesign | RefusedDesign:
    """The exact design of a request, or why there is none; `calls` as for `design`."""
    from mirrorcam.optics.design.optimise import design

    try:
        layout = design(spec, calls)
    except InfeasibleDesign as error:
        from mirrorcam.studio.drawing import violation_drawing

        where = None if error.where is None else violation_drawing(spec, error.where)
        return RefusedDesign(error.constraint, error.finding, where)
    except InputError as error:
        return RefusedDesign("", str(error))
    return described(layout.spec or spec, layout)


def described(spec: DesignSpec, layout: Layout) -> SolvedDesign:
    """A layout that was solved before, with its parabola and their drawings."""
    from mirrorcam.optics.design.optimise import assessed_parabola
    from mirrorcam.studio.drawing import design_drawing

    exact = design_drawing(layout, spec, "exact")
    try:
        parabola = assessed_parabola(spec)
    except InputError:  # the request has none
        return SolvedDesign(layout, exact, None, None)
    return SolvedDesign(layout, exact, parabola, design_drawing(parabola, spec, "parabola"))


_remembered: deque[Layout] = deque(maxlen=MOST_REMEMBERED)
"""Designs that this process makes previews from."""


def remember(layout: Layout) -> None:
    """Let later previews in this process lie between this design and others."""
    _remembered.append(layout)


def preview(spec: DesignSpec) -> str | None:
    """A drawing of about what a request leads to, from designs nearby or, without, its faceted parabola, as JSON."""
    from mirrorcam.optics.design.preview import preview as preview_layout
    from mirrorcam.optics.design.program.seeds import faceted_parabola
    from mirrorcam.studio.drawing import design_drawing

    layout = preview_layout(spec, list(_remembered))
    try:
        if layout is not None:
            return design_drawing(layout, spec, "preview").model_dump_json()
        return design_drawing(faceted_parabola(spec), spec, "parabola").model_dump_json()
    except InputError:
        return None  # such as where a working depth is nearer than the mirrors: nothing to show


def report(layout: Layout, parabola: Layout | None) -> str:
    """The report of a design as one HTML file, with a study of devices as built."""
    from mirrorcam.designs.design_report import design_pictures, design_report
    from mirrorcam.optics.design.assess.monte_carlo import study

    assert layout.spec is not None
    try:
        built, not_built = study(layout, Tolerances.hobby(), sorted(layout.spec.depths_mm)), ""
    except InputError as error:  # the report has all the rest
        built, not_built = None, str(error)
    return design_report(layout, parabola, design_pictures(layout, parabola, built), not_built=not_built)


_suggestions: list[Iterator[SuggestedRequest]] = []
"""The search that `next_suggestion` continues."""


def begin_suggestions(spec: DesignSpec, constraint: str, finding: str) -> None:
    """Begin to look for requests near one that was refused; this process answers `next_suggestion` from then on."""
    from mirrorcam.optics.design.suggestions import suggestions

    found = suggestions(spec, InfeasibleDesign(constraint, finding), beside(_partner()))
    _suggestions[:] = [
        (
            SuggestedRequest(text=change_text(spec, each.spec, each.parameter), spec=each.spec.model_dump(mode="json"))
            for each in found
        )
    ]


def next_suggestion() -> SuggestedRequest | None:
    """The next request that can be met; None where there is no other, or no search."""
    return next(_suggestions[0], None) if _suggestions else None


def tolerance(layout: Layout) -> ToleranceBars:
    """What devices built by hand can be expected to reach, by this process at low priority."""
    at_low_priority()
    from mirrorcam.studio.drawing import tolerance_bars

    return tolerance_bars(layout)


def at_low_priority() -> None:
    """Lower this process's priority below the processes that a person waits for."""
    if sys.platform != "win32":
        os.setpriority(os.PRIO_PROCESS, 0, LOW_PRIORITY)
