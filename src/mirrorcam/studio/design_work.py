"""Work on designs that processes of the studio do: solving, previewing, evaluating. Each gives what the page draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.drawing import DesignDrawing, design_drawing

PRELOAD = ("mirrorcam.studio.design_work",)


@dataclass(frozen=True)
class SolvedDesign:
    """A design with its drawing and, where the request has one, that of its faceted parabola."""

    layout: Layout
    drawing: DesignDrawing
    parabola: DesignDrawing | None


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
    """A layout that was solved before, with its drawings."""
    return SolvedDesign(layout, design_drawing(layout, spec, "exact"), parabola(spec))


def parabola(spec: DesignSpec) -> DesignDrawing | None:
    """The drawing of a request's faceted parabola; None where it has none."""
    try:
        return design_drawing(faceted_parabola(spec), spec, "parabola")
    except InputError:
        return None


def preview(spec: DesignSpec, solved: Sequence[Layout]) -> DesignDrawing | None:
    """A drawing of about what a request leads to, from designs nearby or, without, its faceted parabola."""
    return parabola(spec)
