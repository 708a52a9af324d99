"""Design of a layout: optimal virtual cameras and manufacturable mirrors for a spec, verified independently."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
from shapely import Polygon

from mirrorcam.core.arguments import check_type
from mirrorcam.core.processes.calls import Calls, in_turn
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.chief_rays import blocked_light
from mirrorcam.optics.design.assess.layout_metrics import evaluate, grid_error
from mirrorcam.optics.design.assess.verify import require_passed, verify
from mirrorcam.optics.design.program.design_problem import OverlapDesign, Problem, depth_problem, overlap_problem
from mirrorcam.optics.design.program.draft import DEVICES
from mirrorcam.optics.design.program.nonlinear_program import SolverOutcome
from mirrorcam.optics.design.program.seeds import faceted_parabola, layout_of, mirrors_of
from mirrorcam.optics.design.program.separation import PairConstraint, neighbour_pairs
from mirrorcam.optics.design.search import (
    CONVERGENCE_DEPTHS,
    best_from_seeds,
    best_of,
    best_via_feasible_points,
    check_obvious_infeasibility,
    converging_seed,
)
from mirrorcam.optics.geometry.design_spec import FIRST_FOLD_DEG, GAVE_UP, DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import pairs_closer_than, sub_images_closer_than
from mirrorcam.optics.geometry.sub_images import fields_of_view

NEAR_ITERATIONS = 120
"""Iteration limit of a search for an optimum near given values."""


@dataclass(frozen=True)
class _Optimum:
    """An optimum: the spec with its fold, the program, its constraints on pairs, and the values of all unknowns."""

    spec: DesignSpec
    problem: Problem
    pairs: tuple[PairConstraint, ...]
    values: FloatArray

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        centres, corners = self.problem.solution(self.values)
        return mirrors_of(self.spec, centres * self.spec.scale_mm, corners)

    @property
    def layout(self) -> Layout:
        made_by = {"made_by": "optics.design.optimise.design", "solver": f"IPOPT of CasADi {version('casadi')}"}
        return layout_of(self.spec, self.mirrors, made_by)


def design(spec: DesignSpec, calls: Calls = in_turn) -> Layout:
    """Optimise a nominal layout, and verify it with code that shares nothing with the optimiser.

    Minimises tradeoff * (grid error / 0.25)^2 + (1 - tradeoff) * (1 - pixel efficiency) under the constraints of the
    spec (docs/design.md). The efficiency is averaged over the depths and, if the spec has a tolerance, over devices as
    built. For the objective "depth", a second optimisation minimises the standard deviation of depth while keeping the
    pixels and the field of view of the first design.

    The search starts from faceted ellipsoids and keeps the best optimum. If they lead to no optimum, it looks for
    any feasible layout, then continues from easier specs. Neighbouring mirrors are kept apart from the start, other
    pairs once they come too close.

    Parameters
    ----------
    spec
        The requested design; lengths in mm, depths from the pupil along view z.
    calls
        Runs independent searches, in this process or with a worker of `in_parallel` in two. The layout is the same.

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
    check_obvious_infeasibility(spec)
    optimum = _for_overlap(spec, calls)
    if spec.objective == "depth":
        optimum = _for_depth(spec, optimum, calls)
    return _verified(optimum)


def design_near(spec: DesignSpec, start: FloatArray) -> Layout | None:
    """The design for overlap near the values of all unknowns of another design with the same counts.

    Ignores the spec's tolerances; optimises the fold if it is "auto". Returns a layout with figures and verdict, or
    None if the search finds no optimum or the layout fails a check.
    """
    pairs, values = neighbour_pairs(spec.arrangement), start
    if spec.fold_deg == "auto":
        problem = overlap_problem(spec, converging_seed(spec), pairs, max_iterations=NEAR_ITERATIONS)
        outcome = problem.solver.optimise(values)
        spec, values = spec.replaced(fold_deg=_fold_deg(problem, outcome.values)), outcome.values
    while True:
        problem = overlap_problem(spec, converging_seed(spec), pairs, max_iterations=NEAR_ITERATIONS)
        outcome = problem.solver.optimise(values)
        if not outcome.solved:
            return None
        optimum = _Optimum(spec, problem, pairs, outcome.values)
        pairs, values = _stricter(optimum), outcome.values
        if pairs == optimum.pairs:
            try:
                return _verified(optimum)
            except InfeasibleDesign:
                return None


def _verified(optimum: _Optimum) -> Layout:
    """The layout with its figures and its verdict. Raises InfeasibleDesign if it fails a check."""
    spec, layout = optimum.spec, optimum.layout
    verdict = verify(layout, spec)
    try:
        require_passed(verdict)
    except InfeasibleDesign as refusal:
        raise InfeasibleDesign(GAVE_UP, f"the optimised layout fails verification: {refusal.finding}") from None
    return layout.replaced(metrics=evaluate(layout, spec.depths_mm), verdict=verdict)


def _for_overlap(spec: DesignSpec, calls: Calls) -> _Optimum:
    pairs = neighbour_pairs(spec.arrangement)
    values: FloatArray | None = None
    if spec.fold_deg == "auto":
        spec, values = _with_best_fold(spec, pairs, calls)
    while True:
        optimum = _optimum(spec, pairs, values, calls)
        stricter, values = _stricter(optimum), optimum.values
        if stricter == pairs and spec.robust_tilt_deg > 0.0:
            optimum = _as_built(optimum)
            stricter = _stricter(optimum)
        if stricter == pairs:
            return optimum
        pairs = stricter


def _optimum(spec: DesignSpec, pairs: tuple[PairConstraint, ...], values: FloatArray | None, calls: Calls) -> _Optimum:
    """The optimum under constraints on pairs: from earlier values, if any, else from seeds or via feasible points."""
    problem = overlap_problem(spec, converging_seed(spec), pairs)
    outcome = None if values is None else best_of([problem.solver.optimise(values)])
    if outcome is None:
        outcome = best_from_seeds(spec, pairs, calls) or best_via_feasible_points(spec, pairs, calls)
    return _Optimum(spec, problem, pairs, outcome.values)


def _with_best_fold(
    spec: DesignSpec, pairs: tuple[PairConstraint, ...], calls: Calls
) -> tuple[DesignSpec, FloatArray | None]:
    """The spec with the optimal fold, rounded to degrees, and the values of all unknowns at the optimum.

    Without an optimum, the spec gets the fold from which the search starts, and there are no values.
    """
    problem = overlap_problem(spec, converging_seed(spec), pairs)
    outcome = best_from_seeds(spec, pairs, calls)
    if outcome is None:
        return spec.replaced(fold_deg=FIRST_FOLD_DEG), None
    return spec.replaced(fold_deg=_fold_deg(problem, outcome.values)), outcome.values


def _fold_deg(problem: Problem, values: FloatArray) -> float:
    return float(np.rad2deg(values[problem.fold[0]]).round())


def _stricter(optimum: _Optimum) -> tuple[PairConstraint, ...]:
    """The constraints on pairs, extended by those that the mirrors violate."""
    spec, mirrors = optimum.spec, optimum.mirrors
    violated = {PairConstraint("gap", i, j) for i, j in pairs_closer_than(mirrors, spec.spacing_mm)}
    violated |= {
        PairConstraint("seen", i, j) for i, j in sub_images_closer_than(mirrors, spec.seen_gap_mm / spec.scale_mm)
    }
    light = blocked_light(mirrors, max(spec.depths_mm), view_axis=spec.view_from_rig[2], pupil=spec.camera.pupil)
    violated |= {PairConstraint(occlusion.leg, occlusion.mirror, occlusion.occluder) for occlusion in light}
    return optimum.pairs + tuple(sorted(violated - set(optimum.pairs)))


def _as_built(nominal: _Optimum) -> _Optimum:
    """The optimum over devices as built, started from the optimum for the exact device."""
    spec = nominal.spec
    problem = overlap_problem(spec, converging_seed(spec), nominal.pairs, DEVICES)
    outcome = problem.solver.optimise(nominal.values)
    if not outcome.solved:
        tilted = f"mirrors tilted by {spec.robust_tilt_deg:g}°"
        raise InfeasibleDesign(GAVE_UP, f"the search found no optimum over devices with {tilted}")
    return _Optimum(spec, problem, nominal.pairs, outcome.values)


def _for_depth(spec: DesignSpec, overlap: _Optimum, calls: Calls) -> _Optimum:
    """The optimum for depth, started from the design for overlap and from the seeds; the fold may be "auto".

    Raises InfeasibleDesign if no start leads to an optimum.
    """
    target, pairs = _target(overlap), overlap.pairs
    starts: list[tuple[float, FloatArray | None]] = [(convergence, None) for convergence in CONVERGENCE_DEPTHS]
    starts.append((CONVERGENCE_DEPTHS[0], overlap.values))
    while True:
        outcome = best_of(calls([(_depth_optimum, (spec, start, pairs, target)) for start in starts]))
        if outcome is None:
            raise InfeasibleDesign(GAVE_UP, "the search for the minimum standard deviation of depth found no optimum")
        problem = depth_problem(spec, converging_seed(spec), pairs, target)
        optimum = _Optimum(spec, problem, pairs, outcome.values)
        starts = [(CONVERGENCE_DEPTHS[0], outcome.values)]
        if spec.fold_deg == "auto":
            spec = spec.replaced(fold_deg=_fold_deg(optimum.problem, outcome.values))
            continue
        stricter = _stricter(optimum)
        if stricter == pairs:
            return optimum
        pairs = stricter


def _depth_optimum(
    spec: DesignSpec,
    start: tuple[float, FloatArray | None],
    pairs: tuple[PairConstraint, ...],
    target: OverlapDesign,
) -> SolverOutcome:
    """The optimum for depth near earlier values if there are any, else near a seed."""
    convergence, values = start
    return depth_problem(spec, converging_seed(spec, convergence), pairs, target).solver.optimise(values)


def _target(overlap: _Optimum) -> OverlapDesign:
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
