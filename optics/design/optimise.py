"""Design of a layout: optimal virtual cameras and buildable mirrors for a spec, verified independently."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib.metadata import version

import numpy as np

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.design.assess.chief_rays import blocked_light
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.verify import require_passed, verify
from mirrorcam.optics.design.program.design_problem import (
    LEAST_EFFICIENCY,
    SLACK_WEIGHTS,
    PairConstraint,
    Problem,
    neighbour_pairs,
    problem_of,
)
from mirrorcam.optics.design.program.nonlinear_program import Solver, SolverOutcome
from mirrorcam.optics.design.program.seeds import layout_of, mirrors_of, seed_of
from mirrorcam.optics.design.program.terms import ELASTIC
from mirrorcam.optics.geometry.design_spec import FIRST_FOLD_DEG, GAVE_UP, DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import pairs_closer_than, seen_closer_than

MISSED, CLEARLY_MISSED = 1e-5, 1e-3
"""Violations, in scales, up to which a search for feasibility meets a limit and from which on it clearly misses it."""

MEETINGS = (1.0, 3.0)
"""Depths where chief rays of the seeds meet, in multiples of the working depth; the best optimum is kept."""

EASIER = (0.0, 0.3, 0.6, 0.8, 1.0)
"""Fractions of a spec's demands in the steps of a continuation."""


def _refusal(spec: DesignSpec, missed: dict[str, float]) -> InfeasibleDesign:
    """The error that names the constraint missed most."""
    worst = max(ELASTIC, key=lambda family: missed[family] * SLACK_WEIGHTS[family])
    by_mm = missed[worst] * spec.scale_mm
    depths = ", ".join(f"{depth:g}" for depth in spec.depths_mm)
    finding = {
        "spacing": f"mirrors cannot be {spec.spacing_mm:g} mm apart, they come {by_mm:.3g} mm too close",
        "seen gap": f"sub-images cannot be {spec.seen_gap_mm:g} mm apart, they come {by_mm:.3g} mm too close",
        "occlusion": f"mirrors of {spec.thickness_mm:g} mm reach {by_mm:.3g} mm into the light between pupil and scene",
        "body": f"mirrors or their light come {by_mm:.3g} mm too close to the camera, of whose body they are to stay "
        f"{spec.body_clearance_mm:g} mm clear",
        "depth": f"{min(spec.depths_mm):g} mm is nearer than the mirrors, they reach {by_mm:.3g} mm past it",
        "overlap": f"no region at {depths} mm that {LEAST_EFFICIENCY:.0%} of the sensor could see lies in all views, "
        f"it leaves some by {missed['overlap']:.0%} of a sub-image",
        "size": f"mirrors cannot have edges of {spec.min_edge_mm:g} mm and {spec.min_area_mm2:g} mm² on this sensor",
    }[worst]
    return InfeasibleDesign(worst, finding)


def _working_depth_mm(spec: DesignSpec) -> float:
    """The harmonic mean of the depths: the middle of their disparities."""
    return len(spec.depths_mm) / sum(1.0 / depth for depth in spec.depths_mm)


def _check_at_once(spec: DesignSpec) -> None:
    """Refuse a depth nearer than the middles of the seed's mirrors, and mirrors so thick that they reach the pupil."""
    seed = seed_of(spec, max(_working_depth_mm(spec), 2.0 * spec.scale_mm))
    middles_mm = seed.middles(spec.view_from_rig) * spec.scale_mm
    beyond_mm = float(middles_mm[:, 2].max()) - min(spec.depths_mm)
    if beyond_mm >= 0:
        raise _refusal(spec, dict.fromkeys(ELASTIC, 0.0) | {"depth": beyond_mm / spec.scale_mm})
    # The optical axis meets its mirror at 90 degrees less half the fold: its cosine is the sine of half the fold.
    cosine = float(np.sqrt((1.0 - spec.view_from_rig[2, 2]) / 2.0))
    before_mm = 0.0
    if spec.is_second_surface:
        before_mm = spec.thickness_mm * cosine / np.sqrt(spec.refractive_index**2 - 1.0 + cosine**2)
    past_mm = before_mm - spec.scale_mm * cosine
    if past_mm >= 0:
        raise InfeasibleDesign(
            "occlusion", f"mirrors of {spec.thickness_mm:g} mm reach {past_mm:.3g} mm past the pupil"
        )


def _easier(spec: DesignSpec, part: float) -> DesignSpec:
    """A spec with `part` of the demands of this one: gaps, thickness, sizes, nearness and trade-off."""
    return spec.replaced(
        spacing_mm=part * spec.spacing_mm,
        seen_gap_mm=part * spec.seen_gap_mm,
        body_clearance_mm=part * spec.body_clearance_mm,
        thickness_mm=max(part, 0.05) * spec.thickness_mm,
        min_edge_mm=part * spec.min_edge_mm,
        min_area_mm2=part * spec.min_area_mm2,
        depths_mm=tuple(depth * (2.0 - part) for depth in spec.depths_mm),
        tradeoff=part * spec.tradeoff + (1.0 - part) * 0.3,
    )


def _problem(spec: DesignSpec, pairs: tuple[PairConstraint, ...], meeting: float = MEETINGS[0]) -> Problem:
    return problem_of(spec, seed_of(spec, meeting * _working_depth_mm(spec)), pairs)


def _least(outcomes: Iterable[SolverOutcome]) -> SolverOutcome | None:
    """The best of those that are optima, the first of equals."""
    return min((outcome for outcome in outcomes if outcome.solved), key=lambda outcome: outcome.objective, default=None)


def _from_seeds(spec: DesignSpec, problem: Problem, pairs: tuple[PairConstraint, ...]) -> SolverOutcome | None:
    """The best of the optima near the seeds; where `problem` has none, the other seeds are not tried."""
    first = problem.solver.optimise()
    if not first.solved:
        return None
    return _least([first, *(_problem(spec, pairs, meeting).solver.optimise() for meeting in MEETINGS[1:])])


def _by_detours(spec: DesignSpec, pairs: tuple[PairConstraint, ...]) -> SolverOutcome:
    """The optimum near the nearest feasible points or, where there seem to be none, after a continuation.

    Raises InfeasibleDesign where both seeds lead to points that clearly violate a constraint, or no start leads to an
    optimum.
    """
    least: list[dict[str, float]] = []
    for solver, start in _searches(spec, pairs):
        feasible, missed = solver.find_feasible(start)
        if not feasible.solved:
            continue
        least.append(missed)
        if max(missed.values()) <= MISSED:
            outcome = solver.optimise(feasible.values)
            if outcome.solved:
                return outcome
        if len(least) == len(MEETINGS) and min(max(missed.values()) for missed in least) > CLEARLY_MISSED:
            break
    if not least or min(max(missed.values()) for missed in least) <= MISSED:
        raise InfeasibleDesign(GAVE_UP, "the search found no layout that meets them all")
    raise _refusal(spec, min(least, key=lambda missed: sum(missed[name] * SLACK_WEIGHTS[name] for name in ELASTIC)))


def _searches(spec: DesignSpec, pairs: tuple[PairConstraint, ...]) -> Iterator[tuple[Solver, FloatArray | None]]:
    """Starts of the search for a feasible point: each seed and then, which takes long, the end of a continuation."""
    for meeting in MEETINGS:
        yield _problem(spec, pairs, meeting).solver, None
    yield _problem(spec, pairs).solver, _continued(spec, pairs)


def _continued(spec: DesignSpec, pairs: tuple[PairConstraint, ...]) -> FloatArray | None:
    """Values of all unknowns at the last optimum of the continuation from an easy spec to this one."""
    values: FloatArray | None = None
    for part in EASIER:
        outcome = _problem(_easier(spec, part), pairs).solver.optimise(values)
        if outcome.solved:
            values = outcome.values
    return values


def _optimum(
    spec: DesignSpec, pairs: tuple[PairConstraint, ...], values: FloatArray | None
) -> tuple[tuple[Mirror, ...], FloatArray]:
    """Mirrors at the optimum under constraints on pairs, and the values of all unknowns.

    Starts from earlier values, if any, then from the seeds, then by detours.
    """
    problem = _problem(spec, pairs)
    outcome = None if values is None else _least([problem.solver.optimise(values)])
    if outcome is None:
        outcome = _from_seeds(spec, problem, pairs) or _by_detours(spec, pairs)
    centres, corners = problem.solution(outcome.values)
    return mirrors_of(spec, centres * spec.scale_mm, corners), outcome.values


def _stricter(
    spec: DesignSpec, mirrors: tuple[Mirror, ...], pairs: tuple[PairConstraint, ...]
) -> tuple[PairConstraint, ...]:
    """The constraints on pairs, followed by those that the mirrors violate."""
    found = {PairConstraint("gap", i, j) for i, j in pairs_closer_than(mirrors, spec.spacing_mm)}
    found |= {PairConstraint("seen", i, j) for i, j in seen_closer_than(mirrors, spec.seen_gap_mm / spec.scale_mm)}
    light = blocked_light(mirrors, max(spec.depths_mm), view_axis=spec.view_from_rig[2], pupil=spec.camera.pupil)
    found |= {PairConstraint(part.leg, part.mirror, part.occluder) for part in light}
    return pairs + tuple(sorted(found - set(pairs)))


def _with_best_fold(spec: DesignSpec, pairs: tuple[PairConstraint, ...]) -> tuple[DesignSpec, FloatArray | None]:
    """The spec with the fold at the optimum, in whole degrees, and the values of all unknowns there.

    Where no optimum with an unknown fold is found, that from which the search starts, and no values.
    """
    problem = _problem(spec, pairs)
    outcome = _from_seeds(spec, problem, pairs)
    if outcome is None:
        return spec.replaced(fold_deg=FIRST_FOLD_DEG), None
    found_deg = float(np.rad2deg(outcome.values[problem.fold[0]]).round())
    return spec.replaced(fold_deg=found_deg), outcome.values


def design(spec: DesignSpec) -> Layout:
    """Optimise a nominal layout, and verify it with code that shares nothing with the optimiser.

    Minimises tradeoff * (grid error / 0.25)^2 + (1 - tradeoff) * (1 - pixel efficiency), with the efficiency averaged
    over the depths, under the constraints of the spec (docs/design.md). The search starts from faceted ellipsoids and
    keeps the best optimum; where they lead to none, it first looks for any feasible layout, then continues from easier
    specs. Neighbours are kept apart from the start, other pairs of mirrors once they have come too close.

    Parameters
    ----------
    spec
        What is asked for; lengths in mm, depths from the pupil along view z.

    Returns
    -------
    Layout
        Nominal layout with `metrics` (its figures) and `verdict` (its checks with their limits); its spec states the
        fold that was found.

    Raises
    ------
    InfeasibleDesign
        Names the constraint that cannot hold and by how much it is missed, or "every" where the search found no layout
        and cannot say why.
    """
    _check_at_once(spec)
    pairs = neighbour_pairs(spec.arrangement)
    values: FloatArray | None = None
    if spec.fold_deg == "auto":
        spec, values = _with_best_fold(spec, pairs)
    while True:
        mirrors, values = _optimum(spec, pairs, values)
        stricter = _stricter(spec, mirrors, pairs)
        if stricter == pairs:
            break
        pairs = stricter
    made_by = {"made_by": "optics.design.optimise.design", "solver": f"IPOPT of CasADi {version('casadi')}"}
    layout = layout_of(spec, mirrors, made_by)
    verdict = verify(layout, spec)
    try:
        require_passed(verdict)
    except InfeasibleDesign as refusal:
        raise InfeasibleDesign(GAVE_UP, f"the layout found fails its check, {refusal.finding}") from None
    return layout.replaced(metrics=evaluate(layout, spec.depths_mm), verdict=verdict)
