"""Work on designs that processes of the studio do: solving, previewing, evaluating. Each gives what the page draws."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.monte_carlo import study
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.studio.drawing import DesignDrawing, design_drawing

PRELOAD = ("mirrorcam.studio.design_work",)


@dataclass(frozen=True)
class SolvedDesign:
    """A design and, where its request has one, the faceted parabola, both with figures; and the drawings of the two."""

    layout: Layout
    drawing: DesignDrawing
    parabola: Layout | None
    parabola_drawing: DesignDrawing | None


@dataclass(frozen=True)
class RefusedDesign:
    """A request that no design meets: the constraint that cannot hold, and by how much it is missed."""

    constraint: str
    finding: str


def solve(spec: DesignSpec) -> SolvedDesign | RefusedDesign:
    """The exact design of a request, or why there is none."""
    try:
        layout = design(spec)
    except InfeasibleDesign as error:
        return RefusedDesign(error.constraint, error.finding)
    except InputError as error:
        return RefusedDesign("", str(error))
    return described(layout.spec or spec, layout)


def described(spec: DesignSpec, layout: Layout) -> SolvedDesign:
    """A layout that was solved before, with its parabola and their drawings."""
    parabola = parabola_of(spec)
    drawing = None if parabola is None else design_drawing(parabola, spec, "parabola")
    return SolvedDesign(layout, design_drawing(layout, spec, "exact"), parabola, drawing)


def parabola_of(spec: DesignSpec) -> Layout | None:
    """A request's faceted parabola with its figures; None where it has none."""
    try:
        layout = faceted_parabola(spec)
        figures = {"metrics": evaluate(layout, sorted(spec.depths_mm)), "verdict": verify(layout, spec)}
    except InputError:
        return None
    return layout.replaced(spec=spec, **figures)


def preview(spec: DesignSpec, solved: Sequence[Layout]) -> DesignDrawing | None:
    """A drawing of about what a request leads to, from designs nearby or, without, its faceted parabola."""
    layout = parabola_of(spec)
    return None if layout is None else design_drawing(layout, spec, "parabola")


def report(layout: Layout, parabola: Layout | None) -> str:
    """The report of a design as one HTML file, with a study of devices as built."""
    from mirrorcam.pages.design_report import design_report

    assert layout.spec is not None
    built = study(layout, Tolerances.hobby(), sorted(layout.spec.depths_mm))
    return design_report(layout, parabola, built)


def at_low_priority() -> None:
    """Let this process give way to those that a person waits for."""
    os.nice(10)
