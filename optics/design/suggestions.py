"""Changes that make an infeasible spec feasible: the nearest value of each parameter for which a design exists."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np

from mirrorcam.core.bounds import FOLD_DEG, MIRRORS
from mirrorcam.core.processes.calls import Call, Calls, in_turn
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.optimise import design, design_near
from mirrorcam.optics.design.program.design_problem import SLACK_WEIGHTS, overlap_draft, relaxed_fold, relaxed_program
from mirrorcam.optics.design.program.nonlinear_program import Solver, SolverOutcome
from mirrorcam.optics.design.program.separation import neighbour_pairs
from mirrorcam.optics.design.search import (
    CONVERGENCE_DEPTHS,
    MAX_VIOLATION,
    check_obvious_infeasibility,
    converging_seed,
    optimum_from,
)
from mirrorcam.optics.geometry.design_spec import GAVE_UP, DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout

DIGITS = 3
"""Significant digits of a suggested value."""

INTERIOR = 2e-3
"""Margin, in units of the scale, of the nearest value in all constraints: the solver needs space around an optimum."""

OVERSHOOTS = (0.002, 0.1, 0.3)
"""Fractions of the change by which to exceed the nearest value, tried in order until a design is found."""

FIRST_CHANGE = 0.9
"""Start of the search for the smallest change, where a design is likely."""

EASY_FOLD_DEG = 100.0
SCALE_FACTOR, DEPTH_FACTOR, SUFFICIENT_DEPTH = 4.0, 4.0, 4.0
"""Maximum factors of scale and depths to try; nearest depth, relative to the scale, that leaves enough room."""

NEGLIGIBLE, LARGE_SCALE = 0.02, 60.0
"""Negligible fraction of a thickness; scale, relative to gaps and thicknesses, at which these are small."""

MAX_ITERATIONS = 220
"""Iteration limit of the search for the nearest value."""


@dataclass(frozen=True)
class Suggestion:
    """A feasible spec that differs in one parameter from an infeasible one, and its design.

    `change` is the relative size of the change: for lengths, relative to the larger value; for the fold, to its range;
    for rows and columns, to their number.
    """

    parameter: str
    spec: DesignSpec
    layout: Layout
    change: float


@dataclass(frozen=True)
class _Parameter:
    """A parameter that may change up to a limit.

    Attributes
    ----------
    name : field of the spec.
    relieves : constraints that its change relieves.
    limit : its limit for a spec.
    inverse : whether the numbers of a design's program depend linearly on its inverse, instead of on its value.
    """

    name: str
    relieves: frozenset[str]
    limit: Callable[[DesignSpec], float | tuple[float, ...]]
    inverse: bool = False

    def changed(self, spec: DesignSpec, change: float) -> FloatArray:
        """The value or values of the parameter between the spec's (change 0) and the limit (change 1)."""
        current, limit = np.atleast_1d(getattr(spec, self.name)), np.atleast_1d(self.limit(spec))
        if self.inverse:
            return np.asarray(1.0 / ((1.0 - change) / current + change / limit))
        return np.asarray((1.0 - change) * current + change * limit)


def _larger_scale_mm(spec: DesignSpec) -> float:
    """Maximum scale to try; gaps and glass are small in comparison."""
    return max(SCALE_FACTOR * spec.scale_mm, LARGE_SCALE * max(spec.spacing_mm, spec.seen_gap_mm, spec.thickness_mm))


def _smaller_scale_mm(spec: DesignSpec) -> float:
    return min(spec.scale_mm, *spec.depths_mm) / SUFFICIENT_DEPTH


def _farther_mm(spec: DesignSpec) -> tuple[float, ...]:
    factor = max(DEPTH_FACTOR, SUFFICIENT_DEPTH * spec.scale_mm / min(spec.depths_mm))
    return tuple(factor * depth_mm for depth_mm in spec.depths_mm)


ALL = frozenset({"spacing", "seen gap", "occlusion", "body", "depth", "overlap", "size"})

PARAMETERS = (
    _Parameter("spacing_mm", frozenset({"spacing"}), lambda spec: 0.0),
    _Parameter("seen_gap_mm", frozenset({"seen gap"}), lambda spec: 0.0),
    _Parameter("body_clearance_mm", frozenset({"body"}), lambda spec: 0.0),
    _Parameter("min_edge_mm", frozenset({"size"}), lambda spec: 0.0),
    _Parameter("min_area_mm2", frozenset({"size"}), lambda spec: 0.0),
    _Parameter("depths_mm", frozenset({"depth", "overlap"}), _farther_mm),
    _Parameter("scale_mm", ALL - {"depth"}, _larger_scale_mm, inverse=True),
    _Parameter("scale_mm", frozenset({"depth"}), _smaller_scale_mm, inverse=True),
    _Parameter("thickness_mm", frozenset({"spacing", "occlusion"}), lambda spec: NEGLIGIBLE * spec.thickness_mm),
)
"""Parameters, sorted by how directly they relieve a constraint."""

FOLD_RELIEVES = frozenset({"spacing", "occlusion", "body", "overlap"})
FEWER_RELIEVES = ALL - {"depth"}


def nearest_feasible(spec: DesignSpec, refusal: InfeasibleDesign, calls: Calls = in_turn) -> list[Suggestion]:
    """The `suggestions` for a spec, sorted by increasing change."""
    return sorted(suggestions(spec, refusal, calls), key=lambda suggestion: suggestion.change)


def suggestions(
    spec: DesignSpec, refusal: InfeasibleDesign, calls: Calls = in_turn
) -> Generator[Suggestion, None, None]:
    """Yield, for each single parameter that can make a spec feasible, the spec with the nearest value and its design.

    The value is an unknown of the design's program, which minimises its change under all constraints. It is rounded
    to three digits, away from the original value, and the design with it is solved and verified; for rectangles, it is
    the one that `design` finds. Only parameters that relieve the violated constraint are tried. The search is local: a
    nearer value may exist, or a value may exist where none is found. For free outlines, tolerances of devices as built
    are ignored.

    Parameters
    ----------
    spec
        The infeasible spec.
    refusal
        The error that `design` raised for it.
    calls
        Runs the independent searches, one per parameter.
    """
    violated = ALL if refusal.constraint == GAVE_UP else {refusal.constraint}
    searches: list[Call] = [
        (_with_one_changed, (spec, index))
        for index, parameter in enumerate(PARAMETERS)
        if violated & parameter.relieves
    ]
    if violated & FEWER_RELIEVES:
        searches += [(_with_fewer, (spec, name)) for name in _reducible_counts(spec)]
    if spec.fold_deg != "auto" and violated & FOLD_RELIEVES:
        searches.append((_with_fold, (spec,)))
    with closing(calls(searches)) as results:
        for suggestion in results:
            if suggestion is not None:
                yield suggestion


def _reducible_counts(spec: DesignSpec) -> Iterator[str]:
    if spec.pattern is None:
        for name, count, other_count in (("rows", spec.rows, spec.cols), ("cols", spec.cols, spec.rows)):
            if count > MIRRORS.min and (count - 1) * other_count > 1:
                yield name


def _with_fewer(spec: DesignSpec, name: str) -> Suggestion | None:
    """The suggestion of one row or column fewer."""
    fewer = spec.replaced(**{name: getattr(spec, name) - 1})
    outcome = optimum_from(fewer, CONVERGENCE_DEPTHS[0], neighbour_pairs(fewer.arrangement))
    layout = _designed(fewer, outcome.values) if outcome.solved else None
    return None if layout is None else Suggestion(name, fewer, layout, 1.0 / getattr(spec, name))


def _with_one_changed(spec: DesignSpec, index: int) -> Suggestion | None:
    """The suggestion for one of the `PARAMETERS`; None if changing it alone does not help."""
    parameter, current = PARAMETERS[index], np.atleast_1d(getattr(spec, PARAMETERS[index].name))
    limit = parameter.changed(spec, 1.0)
    if (limit == current).all():
        return None
    easy = _with_value(spec, parameter.name, limit)
    seed, pairs = converging_seed(easy), neighbour_pairs(spec.arrangement)
    program, changed = (overlap_draft(end, seed, pairs)[0].program for end in (spec, easy))
    outcome = _nearest(Solver(relaxed_program(program, changed, FIRST_CHANGE), SLACK_WEIGHTS, MAX_ITERATIONS))
    if outcome is None:
        return None
    for overshoot in OVERSHOOTS:
        value = _rounded(current, parameter.changed(spec, min(float(outcome.values[-1]) * (1.0 + overshoot), 1.0)))
        relaxed = _with_value(spec, parameter.name, value)
        layout = _designed(relaxed, outcome.values[:-1])
        if layout is not None:
            change = float((np.abs(value - current) / np.maximum(value, current)).max())
            return Suggestion(parameter.name, relaxed, layout, change)
    return None


def _with_fold(spec: DesignSpec) -> Suggestion | None:
    """The suggestion of a different fold, to a tenth of a degree; None if changing it alone does not help."""
    requested = float(spec.fold_deg)
    easy = spec.replaced(fold_deg=EASY_FOLD_DEG)
    draft, _ = overlap_draft(easy, converging_seed(easy), neighbour_pairs(spec.arrangement))
    fold = np.deg2rad([requested, FOLD_DEG.min, FOLD_DEG.max])
    outcome = _nearest(Solver(relaxed_fold(draft.program, draft.fold, *fold), SLACK_WEIGHTS, MAX_ITERATIONS))
    if outcome is None:
        return None
    nearest = float(np.rad2deg(outcome.values[draft.fold[0]]))
    for overshoot in OVERSHOOTS:
        target = requested + (nearest - requested) * (1.0 + overshoot)
        rounded = ceil if target > requested else floor
        relaxed = spec.replaced(fold_deg=min(max(rounded(target * 10.0) / 10.0, FOLD_DEG.min), FOLD_DEG.max))
        layout = _designed(relaxed, outcome.values[:-1])
        if layout is not None:
            change = abs(target - requested) / (FOLD_DEG.max - FOLD_DEG.min)
            return Suggestion("fold_deg", relaxed, layout, change)
    return None


def _designed(spec: DesignSpec, values: FloatArray) -> Layout | None:
    """The design near given values; None if there is none, or `design` refuses the spec.

    With fixed sizes, optima are isolated, and `design` may miss the one near the values.
    """
    try:
        check_obvious_infeasibility(spec)
        layout = design_near(spec, values)
        return layout if layout is None or spec.rectangle_sizes is None else design(spec)
    except InfeasibleDesign:
        return None


def _nearest(solver: Solver) -> SolverOutcome | None:
    """The smallest change that meets all constraints; None if the search finds none."""
    outcome, violations = solver.find_relaxed(INTERIOR)
    return outcome if outcome.solved and max(violations.values()) <= MAX_VIOLATION else None


def _with_value(spec: DesignSpec, parameter: str, value: FloatArray) -> DesignSpec:
    """The spec with the value or values (k,) of a parameter replaced."""
    numbers = tuple(float(number) for number in value)
    return spec.replaced(**{parameter: numbers if isinstance(getattr(spec, parameter), tuple) else numbers[0]})


def _rounded(current: FloatArray, values: FloatArray) -> FloatArray:
    """Round values to three significant digits, away from the current ones."""
    rounded = []
    for old, value in zip(current, values, strict=True):
        unit = 10.0 ** (floor(log10(value)) + 1 - DIGITS) if value > 0.0 else 1.0
        steps = ceil(value / unit) if value > old else floor(value / unit)
        rounded.append(float(f"{steps * unit:.{DIGITS}g}"))
    return np.array(rounded)
