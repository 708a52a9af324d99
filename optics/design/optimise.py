"""Design of a layout: optimal virtual cameras and manufacturable mirrors for a spec, verified independently."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from shapely import Polygon

from mirrorcam.core.arguments import check_callable, check_type
from mirrorcam.core.processes.calls import Calls, counted, in_turn
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.layout_metrics import evaluate, grid_error
from mirrorcam.optics.design.assess.verify import require_passed, verify
from mirrorcam.optics.design.optimum import Goal, Optimum
from mirrorcam.optics.design.program.design_problem import OverlapDesign
from mirrorcam.optics.design.program.draft import DEVICES
from mirrorcam.optics.design.program.nonlinear_program import SolverOutcome
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.design.program.separation import neighbour_pairs
from mirrorcam.optics.design.search import (
    CONVERGENCE_DEPTHS,
    best_from_seeds,
    best_of,
    best_via_feasible_points,
    check_obvious_infeasibility,
)
from mirrorcam.optics.design.size_search import expected_searches, with_allowed_sizes
from mirrorcam.optics.geometry.design_spec import FIRST_FOLD_DEG, GAVE_UP, DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import fields_of_view

NEAR_ITERATIONS = 120
"""Iteration limit of a search for an optimum near given values."""


def design(spec: DesignSpec, *, calls: Calls = in_turn, progress: Progress = no_progress) -> Layout:
    """Optimise a nominal layout, and verify it with code that shares nothing with the optimiser.

    Minimises tradeoff * (grid error / 0.25)^2 + (1 - tradeoff) * (1 - pixel efficiency) under the constraints of the
    spec (docs/design_method.md). The efficiency is averaged over the depths and, if the spec has a tolerance, over
    devices as built. For the objective "depth", a second optimisation minimises the standard deviation of depth while
    keeping the pixels and the field of view of the first design.

    The search starts from faceted ellipsoids and keeps the best optimum. If they lead to no optimum, it looks for
    any feasible layout, then continues from easier specs. Neighbouring mirrors are kept apart from the start, other
    pairs once they come too close. Rectangles first get free sides, then allowed ones.

    Parameters
    ----------
    spec
        The requested design; lengths in mm, depths from the pupil along view z.
    calls
        Runs independent searches, in this process or with a worker of `in_parallel` in two. The layout is the same.
    progress
        Called with the number of searches done and the number expected, which grows if a search shows that others are
        needed. An exception that it raises ends the design.

    Returns
    -------
    Layout
        Nominal layout with `metrics` (its figures) and `verdict` (its checks with their limits). Its spec states the
        fold found by the search.

    Raises
    ------
    InfeasibleDesign
        Names the constraint that cannot be met and the violation, or "every" if the search found no layout for an
        unknown reason.
    """
    check_type("spec", spec, DesignSpec)
    check_callable("progress", progress)
    check_obvious_infeasibility(spec)
    expected, is_sized = len(CONVERGENCE_DEPTHS) + expected_searches(spec), spec.rectangle_sizes is not None
    if spec.objective == "depth":  # both stages again, each also from the design for overlap
        expected += expected + 1 + is_sized
    calls = counted(calls, progress, expected)
    overlap = with_allowed_sizes(_for_overlap(spec, calls), calls)
    if spec.objective == "overlap":
        return _verified(overlap)
    return _verified(with_allowed_sizes(_for_depth(spec, overlap, calls), calls, overlap))


def design_near(spec: DesignSpec, start: FloatArray) -> Layout | None:
    """The design for overlap near the values of all unknowns of another design with the same counts.

    Ignores the spec's tolerances; optimises the fold if it is "auto". Returns a layout with figures and verdict, or
    None if the search finds no optimum or the layout fails a check.
    """
    goal = Goal(spec, neighbour_pairs(spec.arrangement), max_iterations=NEAR_ITERATIONS)
    if spec.fold_deg == "auto":
        nearest = _near(goal, start)
        goal, start = replace(goal, spec=spec.replaced(fold_deg=nearest.fold_deg)), nearest.values
    while (optimum := _near(goal, start)).outcome.solved:
        if (stricter := optimum.stricter) is goal:
            try:
                return _verified(with_allowed_sizes(optimum, in_turn))
            except InfeasibleDesign:
                return None
        goal, start = stricter, optimum.values
    return None


def _near(goal: Goal, values: FloatArray | None) -> Optimum:
    """The optimum of a goal near values, or what the solver found instead."""
    problem = goal.problem()
    return Optimum(goal, problem, problem.solver.optimise(values))


def _verified(optimum: Optimum) -> Layout:
    """The layout with its figures and its verdict. Raises InfeasibleDesign if it fails a check."""
    spec, layout = optimum.spec, optimum.layout
    verdict = verify(layout, spec)
    try:
        require_passed(verdict)
    except InfeasibleDesign as refusal:
        raise InfeasibleDesign(GAVE_UP, f"the optimised layout fails verification: {refusal.finding}") from None
    return layout.replaced(metrics=evaluate(layout, spec.depths_mm), verdict=verdict)


def _for_overlap(spec: DesignSpec, calls: Calls) -> Optimum:
    goal, values = Goal(spec, neighbour_pairs(spec.arrangement)), None
    if spec.fold_deg == "auto":
        goal, values = _with_best_fold(goal, calls)
    while True:
        optimum = _optimum(goal, values, calls)
        stricter, values = optimum.stricter, optimum.values
        if stricter is goal and spec.robust_tilt_deg > 0.0:
            optimum = _as_built(optimum)
            stricter = optimum.stricter
        if stricter is optimum.goal:
            return optimum
        goal = replace(stricter, devices=0)


def _optimum(goal: Goal, values: FloatArray | None, calls: Calls) -> Optimum:
    """The optimum under constraints on pairs: from earlier values, if any, else from seeds or via feasible points."""
    if values is not None and (optimum := _near(goal, values)).outcome.solved:
        return optimum
    outcome = best_from_seeds(goal.spec, goal.pairs, calls) or best_via_feasible_points(goal.spec, goal.pairs, calls)
    return Optimum(goal, goal.problem(), outcome)


def _with_best_fold(goal: Goal, calls: Calls) -> tuple[Goal, FloatArray | None]:
    """The goal with the optimal fold, rounded to degrees, and the values of all unknowns at the optimum.

    Without an optimum, the spec gets the fold from which the search starts, and there are no values.
    """
    outcome = best_from_seeds(goal.spec, goal.pairs, calls)
    if outcome is None:
        return replace(goal, spec=goal.spec.replaced(fold_deg=FIRST_FOLD_DEG)), None
    optimum = Optimum(goal, goal.problem(), outcome)
    return replace(goal, spec=goal.spec.replaced(fold_deg=optimum.fold_deg)), outcome.values


def _as_built(nominal: Optimum) -> Optimum:
    """The optimum over devices as built, started from the optimum for the exact device."""
    optimum = _near(replace(nominal.goal, devices=DEVICES), nominal.values)
    if not optimum.outcome.solved:
        tilted = f"mirrors tilted by {nominal.spec.robust_tilt_deg:g}°"
        raise InfeasibleDesign(GAVE_UP, f"the search found no optimum over devices with {tilted}")
    return optimum


def _for_depth(spec: DesignSpec, overlap: Optimum, calls: Calls) -> Optimum:
    """The optimum for depth, started from the design for overlap and from the seeds; the fold may be "auto".

    Raises InfeasibleDesign if no start leads to an optimum.
    """
    goal = Goal(spec, overlap.goal.pairs, target=_target(overlap))
    starts: list[tuple[float, FloatArray | None]] = [(convergence, None) for convergence in CONVERGENCE_DEPTHS]
    starts.append((CONVERGENCE_DEPTHS[0], overlap.values))
    while True:
        outcome = best_of(calls([(_depth_optimum, (goal, *start)) for start in starts]))
        if outcome is None:
            raise InfeasibleDesign(GAVE_UP, "the search for the minimum standard deviation of depth found no optimum")
        optimum = Optimum(goal, goal.problem(), outcome)
        starts = [(CONVERGENCE_DEPTHS[0], outcome.values)]
        if goal.spec.fold_deg == "auto":
            goal = replace(goal, spec=goal.spec.replaced(fold_deg=optimum.fold_deg))
            continue
        if (stricter := optimum.stricter) is goal:
            return optimum
        goal = stricter


def _depth_optimum(goal: Goal, convergence: float, values: FloatArray | None) -> SolverOutcome:
    """The optimum for depth near earlier values if there are any, else near a seed."""
    return goal.problem(convergence).solver.optimise(values)


def _target(overlap: Optimum) -> OverlapDesign:
    """The properties of the design for overlap that a design for depth must keep."""
    spec, layout = overlap.spec, overlap.layout
    views = fields_of_view(layout, spec.camera.pupil)
    regions = overlap.problem.outlines(spec, overlap.values) * spec.scale_mm
    return OverlapDesign(
        fold=float(np.deg2rad(spec.fold_deg)),
        centres=layout.virtual_centres_in_view_mm.reshape(-1, 3) / spec.scale_mm,
        fractions=np.array(
            [
                views.pixel_fractions(Polygon(region), depth)
                for region, depth in zip(regions, spec.depths_mm, strict=True)
            ]
        ),
        regions=overlap.values[overlap.problem.regions].reshape(len(spec.depths_mm), -1, 2),
        fields=overlap.problem.fields(spec, overlap.values),
        grid_error=grid_error(layout),
    )


def assessed_parabola(spec: DesignSpec) -> Layout:
    """The faceted parabola of a specification, with its metrics and its verdict, which may fail.

    Raises InputError if the specification has none, or a working depth is nearer than its mirrors.
    """
    layout = faceted_parabola(spec)
    return layout.replaced(spec=spec, metrics=evaluate(layout, spec.depths_mm), verdict=verify(layout, spec))
