"""The search for the optimum of a design's program: starts, continuation from easier specs, and reasons for failure."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from mirrorcam.core.processes.calls import Calls
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.least_violation import least_violation, past_the_pupil
from mirrorcam.optics.design.program.design_problem import MIN_EFFICIENCY, SLACK_WEIGHTS, overlap_problem
from mirrorcam.optics.design.program.draft import SAFE_SIGMAS
from mirrorcam.optics.design.program.nonlinear_program import SolverOutcome
from mirrorcam.optics.design.program.seeds import Seed, seed_of, sensor_bounds
from mirrorcam.optics.design.program.separation import PairConstraint
from mirrorcam.optics.design.program.terms import ELASTIC
from mirrorcam.optics.geometry.design_spec import GAVE_UP, DesignSpec, InfeasibleDesign

MET, CLEARLY_MISSED = 1e-5, 1e-3
"""Violations, in scales, up to which a limit counts as met, and beyond which it counts as clearly missed."""

MEETINGS = (1.0, 3.0)
"""Depths where the chief rays of the seeds meet, relative to the working depth; the best optimum is kept."""

CONTINUATION = (0.0, 0.3, 0.6, 0.8, 1.0)
"""Fractions of a spec's demands in the steps of a continuation."""


def _refusal(
    spec: DesignSpec,
    missed: dict[str, float],
    mirrors: tuple[FloatArray, FloatArray],
    regions: FloatArray | None = None,
) -> InfeasibleDesign:
    """The error that names the constraint with the largest violation and, by `least_violation`, its location."""
    worst = max(ELASTIC, key=lambda family: missed[family] * SLACK_WEIGHTS[family])
    by_mm = missed[worst] * spec.scale_mm
    depths = ", ".join(f"{depth:g}" for depth in spec.depths_mm)
    finding = {
        "spacing": f"mirrors cannot be {spec.spacing_mm:g} mm apart, they come {by_mm:.3g} mm too close",
        "seen gap": f"sub-images cannot be {_seen_gap_text(spec)} apart, they come {by_mm:.3g} mm too close",
        "occlusion": f"mirrors of {spec.thickness_mm:g} mm reach {by_mm:.3g} mm into the light between pupil and scene",
        "body": f"mirrors or their light come {by_mm:.3g} mm too close to the camera's body, which needs a clearance "
        f"of {spec.body_clearance_mm:g} mm",
        "depth": f"{min(spec.depths_mm):g} mm is nearer than the mirrors, they reach {by_mm:.3g} mm past it",
        "overlap": f"the views share no region at {depths} mm that {MIN_EFFICIENCY:.0%} of the sensor sees, "
        f"the best region exceeds some views by {missed['overlap']:.0%} of a sub-image",
        "size": f"mirrors cannot have edges of {spec.min_edge_mm:g} mm and {spec.min_area_mm2:g} mm² on this sensor",
    }[worst]
    return InfeasibleDesign(worst, finding, least_violation(spec, worst, mirrors, regions))


def _seen_gap_text(spec: DesignSpec) -> str:
    if spec.robust_tilt_deg == 0.0 == spec.robust_offset_mm:
        return f"{spec.seen_gap_mm:g} mm"
    moved = f"tilts of {spec.robust_tilt_deg:g}° and offsets of {spec.robust_offset_mm:g} mm"
    return f"{spec.seen_gap_mm:g} mm and {SAFE_SIGMAS:g} sigma of {moved}"


def _working_depth_mm(spec: DesignSpec) -> float:
    """Harmonic mean of the depths, the depth of the mean disparity."""
    return len(spec.depths_mm) / sum(1.0 / depth for depth in spec.depths_mm)


def check_at_once(spec: DesignSpec) -> None:
    """Raise InfeasibleDesign for specs that are infeasible without a search.

    These have a depth nearer than the centres of the seed's mirrors, gaps wider than the sensor, or mirrors so thick
    that they reach the pupil.
    """
    seed = seed_of(spec, max(_working_depth_mm(spec), 2.0 * spec.scale_mm))
    start = (seed.centres, seed.corners)
    points_mm = seed.chief_points(spec.view_from_rig) * spec.scale_mm
    beyond_mm = float(points_mm[:, 2].max()) - min(spec.depths_mm)
    if beyond_mm >= 0:
        raise _refusal(spec, dict.fromkeys(ELASTIC, 0.0) | {"depth": beyond_mm / spec.scale_mm}, start)
    low, high = sensor_bounds(spec.camera)
    beyond = spec.seen_gap_mm / spec.scale_mm - float(np.linalg.norm(high - low))
    if beyond >= 0:
        raise _refusal(spec, dict.fromkeys(ELASTIC, 0.0) | {"seen gap": beyond}, start)
    # The angle of incidence of the optical axis is 90 degrees minus half the fold.
    cosine = float(np.sqrt((1.0 - spec.view_from_rig[2, 2]) / 2.0))
    before_mm = 0.0
    if spec.is_second_surface:
        before_mm = spec.thickness_mm * cosine / np.sqrt(spec.refractive_index**2 - 1.0 + cosine**2)
    past_mm = before_mm - spec.scale_mm * cosine
    if past_mm >= 0:
        where = past_the_pupil(spec, seed, past_mm)
        raise InfeasibleDesign(
            "occlusion", f"mirrors of {spec.thickness_mm:g} mm reach {past_mm:.3g} mm past the pupil", where
        )


def _easier(spec: DesignSpec, fraction: float) -> DesignSpec:
    """An easier spec: scales gaps, thickness, sizes, nearness, trade-off and tolerances by a fraction from 0 to 1."""
    return spec.replaced(
        spacing_mm=fraction * spec.spacing_mm,
        seen_gap_mm=fraction * spec.seen_gap_mm,
        body_clearance_mm=fraction * spec.body_clearance_mm,
        thickness_mm=max(fraction, 0.05) * spec.thickness_mm,
        min_edge_mm=fraction * spec.min_edge_mm,
        min_area_mm2=fraction * spec.min_area_mm2,
        depths_mm=tuple(depth * (2.0 - fraction) for depth in spec.depths_mm),
        tradeoff=fraction * spec.tradeoff + (1.0 - fraction) * 0.3,
        robust_tilt_deg=fraction * spec.robust_tilt_deg,
        robust_offset_mm=fraction * spec.robust_offset_mm,
    )


def seed_meeting(spec: DesignSpec, meeting: float = MEETINGS[0]) -> Seed:
    """The seed whose chief rays meet at a multiple of the working depth."""
    return seed_of(spec, meeting * _working_depth_mm(spec))


def best_of(outcomes: Iterable[SolverOutcome]) -> SolverOutcome | None:
    """The best of the outcomes that are optima; None if there is none."""
    return min((outcome for outcome in outcomes if outcome.solved), key=lambda outcome: outcome.objective, default=None)


def optimum_from(spec: DesignSpec, meeting: float, pairs: tuple[PairConstraint, ...]) -> SolverOutcome:
    """The optimum near the seed whose chief rays meet at a multiple of the working depth."""
    return overlap_problem(spec, seed_meeting(spec, meeting), pairs).solver.optimise()


def best_from_seeds(spec: DesignSpec, pairs: tuple[PairConstraint, ...], calls: Calls) -> SolverOutcome | None:
    """The best of the optima near the seeds; None without trying the others if the first seed leads to none."""
    with closing(calls([(optimum_from, (spec, meeting, pairs)) for meeting in MEETINGS])) as outcomes:
        first: SolverOutcome = next(outcomes)
        return best_of([first, *outcomes]) if first.solved else None


@dataclass(frozen=True)
class _Detour:
    """The values with the least violation near a start, by family; without violation, also the optimum near them."""

    feasible: SolverOutcome
    missed: dict[str, float]
    optimum: SolverOutcome | None
    mirrors: tuple[FloatArray, FloatArray]
    regions: FloatArray


def detour_from(
    spec: DesignSpec, meeting: float, pairs: tuple[PairConstraint, ...], start: FloatArray | None = None
) -> _Detour:
    """Minimise the violation near given values, or near the seed whose chief rays meet at a relative depth."""
    problem = overlap_problem(spec, seed_meeting(spec, meeting), pairs)
    feasible, missed = problem.solver.find_feasible(start)
    met = feasible.solved and max(missed.values()) <= MET
    optimum = problem.solver.optimise(feasible.values) if met else None
    mirrors, regions = problem.solution(feasible.values), problem.outlines(spec, feasible.values)
    return _Detour(feasible, missed, optimum, mirrors, regions)


def best_from_detours(spec: DesignSpec, pairs: tuple[PairConstraint, ...], calls: Calls) -> SolverOutcome:
    """The optimum near the nearest feasible points or, if there seem to be none, after a continuation.

    Raises InfeasibleDesign if both seeds lead to points that clearly violate a constraint, or no start leads to an
    optimum.
    """
    found: list[_Detour] = []
    with closing(_detours(spec, pairs, calls)) as detours:
        for detour in detours:
            if not detour.feasible.solved:
                continue
            found.append(detour)
            if detour.optimum is not None and detour.optimum.solved:
                return detour.optimum
            if len(found) == len(MEETINGS) and _violated(found) > CLEARLY_MISSED:
                break
    if not found or _violated(found) <= MET:
        raise InfeasibleDesign(GAVE_UP, "the search found no layout that meets all constraints")
    best = min(found, key=lambda detour: sum(detour.missed[name] * SLACK_WEIGHTS[name] for name in ELASTIC))
    raise _refusal(spec, best.missed, best.mirrors, best.regions)


def _violated(detours: Iterable[_Detour]) -> float:
    """The largest violation of the best of the detours."""
    return min(max(detour.missed.values()) for detour in detours)


def _detours(spec: DesignSpec, pairs: tuple[PairConstraint, ...], calls: Calls) -> Generator[_Detour, None, None]:
    """Search for feasible points from each seed, then from the end of a continuation, which takes long."""
    with closing(calls([(detour_from, (spec, meeting, pairs)) for meeting in MEETINGS])) as near_seeds:
        yield from near_seeds
    yield detour_from(spec, MEETINGS[0], pairs, _continued(spec, pairs))


def _continued(spec: DesignSpec, pairs: tuple[PairConstraint, ...]) -> FloatArray | None:
    """Values of all unknowns at the last optimum of a continuation from an easy spec to this one."""
    values: FloatArray | None = None
    for fraction in CONTINUATION:
        easier = _easier(spec, fraction)
        outcome = overlap_problem(easier, seed_meeting(easier), pairs).solver.optimise(values)
        if outcome.solved:
            values = outcome.values
    return values
