"""The optimum of a design's nonlinear program: starts, continuation from easier specs, and reasons for failure."""

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
from mirrorcam.optics.design.program.nonlinear_program import TOLERANCE, SolverOutcome
from mirrorcam.optics.design.program.seeds import Seed, seed_of, sensor_bounds
from mirrorcam.optics.design.program.separation import PairConstraint
from mirrorcam.optics.design.program.terms import ELASTIC
from mirrorcam.optics.geometry.design_spec import GAVE_UP, DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.rectangle_sizes import FREE

MAX_VIOLATION, CLEAR_VIOLATION = 1e-5, 1e-3
"""Violations, in units of the design scale, up to which a constraint is met, and beyond which it clearly is not."""

CONVERGENCE_DEPTHS = (1.0, 3.0)
"""Depths at which the chief rays of the seeds converge, in units of the working depth; the best optimum is kept."""

MIN_DEPTH_TO_SCALE = 0.05
"""Ratio of the farthest depth to the scale below which the depths must be in metres: the scene would be at the lens."""

OVERSIZE = 4.0
"""Ratio of the area of a size that is sold to a seed's largest mirror beyond which no layout has space for it."""

ROUGH_TOLERANCE = 1e-6
"""Tolerance of an optimum whose fold or sizes are rounded: the last iterations hardly change it."""

CONTINUATION = (0.0, 0.3, 0.6, 0.8, 1.0)
"""Fractions of a spec's demands in the steps of a continuation."""


def _infeasibility(
    spec: DesignSpec,
    violations: dict[str, float],
    mirrors: tuple[FloatArray, FloatArray],
    regions: FloatArray | None = None,
) -> InfeasibleDesign:
    """The error that names the constraint with the largest violation and, by `least_violation`, its location."""
    worst = max(ELASTIC, key=lambda family: violations[family] * SLACK_WEIGHTS[family])
    excess_mm = violations[worst] * spec.scale_mm
    depths = ", ".join(f"{depth:g}" for depth in spec.depths_mm)
    finding = {
        "spacing": f"mirrors cannot be {spec.spacing_mm:g} mm apart: they come {excess_mm:.3g} mm too close",
        "seen gap": f"sub-images cannot be {_gap_text(spec)} apart: they come {excess_mm:.3g} mm too close",
        "occlusion": f"mirrors of {spec.thickness_mm:g} mm reach {excess_mm:.3g} mm into light between pupil and scene",
        "body": f"mirrors or their ray cones come {excess_mm:.3g} mm too close to the camera's body, which needs "
        f"a clearance of {spec.body_clearance_mm:g} mm",
        "depth": f"{min(spec.depths_mm):g} mm is nearer than the mirrors: they reach {excess_mm:.3g} mm past it",
        "overlap": f"the views share no region at {depths} mm that {MIN_EFFICIENCY:.0%} of the sensor sees: "
        f"the best region exceeds some views by {violations['overlap']:.0%} of a sub-image",
        "size": f"mirrors cannot have edges of {spec.min_edge_mm:g} mm and {spec.min_area_mm2:g} mm² on this sensor",
    }[worst]
    return InfeasibleDesign(worst, finding, least_violation(spec, worst, mirrors, regions))


def _gap_text(spec: DesignSpec) -> str:
    if spec.robust_tilt_deg == 0.0 == spec.robust_offset_mm:
        return f"{spec.seen_gap_mm:g} mm"
    tolerances = f"tilts of {spec.robust_tilt_deg:g}° and offsets of {spec.robust_offset_mm:g} mm"
    return f"{spec.seen_gap_mm:g} mm and {SAFE_SIGMAS:g} sigma of {tolerances}"


def _working_depth_mm(spec: DesignSpec) -> float:
    """Harmonic mean of the depths, the depth of the mean disparity."""
    return len(spec.depths_mm) / sum(1.0 / depth for depth in spec.depths_mm)


def check_obvious_infeasibility(spec: DesignSpec) -> None:
    """Raise InfeasibleDesign for specs that are clearly infeasible, without a search.

    These have depths in metres or one nearer than the seed's mirrors, sub-image gaps wider than the sensor, mirrors so
    thick that they reach the pupil, or only sizes far larger than the seed's mirrors.
    """
    if max(spec.depths_mm) < MIN_DEPTH_TO_SCALE * spec.scale_mm:
        depths = ", ".join(f"{depth:g}" for depth in spec.depths_mm)
        raise InfeasibleDesign(
            "depth",
            f"{depths} mm is less than {MIN_DEPTH_TO_SCALE:.0%} of the scale, {spec.scale_mm:g} mm, expected depths in "
            "mm",
        )
    seed = seed_of(spec, max(_working_depth_mm(spec), 2.0 * spec.scale_mm))
    start = (seed.centres, seed.corners)
    points_mm = seed.chief_points(spec.view_from_rig) * spec.scale_mm
    excess_mm = float(points_mm[:, 2].max()) - min(spec.depths_mm)
    if excess_mm >= 0:
        raise _infeasibility(spec, dict.fromkeys(ELASTIC, 0.0) | {"depth": excess_mm / spec.scale_mm}, start)
    low, high = sensor_bounds(spec.camera)
    excess = spec.seen_gap_mm / spec.scale_mm - float(np.linalg.norm(high - low))
    if excess >= 0:
        raise _infeasibility(spec, dict.fromkeys(ELASTIC, 0.0) | {"seen gap": excess}, start)
    sizes, sides_mm = spec.rectangle_sizes, seed.edges(spec.view_from_rig) * spec.scale_mm
    largest = sides_mm[sides_mm.prod(axis=1).argmax()]
    if sizes is not None and sizes.is_stock and sizes.stock_mm.prod(axis=1).min() > OVERSIZE * largest.prod():
        width, height = sizes.stock_mm[sizes.stock_mm.prod(axis=1).argmin()]
        raise InfeasibleDesign(
            "size",
            f"no mirror at scale {spec.scale_mm:g} mm has space for the smallest size, {width:g} x {height:g} mm: the "
            f"largest would have about {largest[0]:.0f} x {largest[1]:.0f} mm",
        )
    # The angle of incidence of the optical axis is 90 degrees minus half the fold angle.
    cosine = float(np.sqrt((1.0 - spec.view_from_rig[2, 2]) / 2.0))
    glass_mm = 0.0
    if spec.is_second_surface:
        glass_mm = spec.thickness_mm * cosine / np.sqrt(spec.refractive_index**2 - 1.0 + cosine**2)
    excess_mm = glass_mm - spec.scale_mm * cosine
    if excess_mm >= 0:
        violation = past_the_pupil(spec, seed, excess_mm)
        raise InfeasibleDesign(
            "occlusion", f"mirrors of {spec.thickness_mm:g} mm reach {excess_mm:.3g} mm past the pupil", violation
        )


def _easier(spec: DesignSpec, fraction: float) -> DesignSpec:
    """An easier spec: fraction 1 keeps gaps, thickness, sizes, depths, trade-off and tolerances, 0 relaxes them."""
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


def converging_seed(spec: DesignSpec, convergence: float = CONVERGENCE_DEPTHS[0]) -> Seed:
    """The seed whose chief rays converge at a multiple of the working depth."""
    return seed_of(spec, convergence * _working_depth_mm(spec))


def best_of(outcomes: Iterable[SolverOutcome]) -> SolverOutcome | None:
    """The best of the outcomes that are optima; None if there is none."""
    return min((outcome for outcome in outcomes if outcome.solved), key=lambda outcome: outcome.objective, default=None)


def optimum_from(spec: DesignSpec, convergence: float, pairs: tuple[PairConstraint, ...]) -> SolverOutcome:
    """The optimum near the seed whose chief rays converge at a multiple of the working depth."""
    is_rounded = spec.fold_deg == "auto" or spec.rectangle_sizes is not None
    tolerance = ROUGH_TOLERANCE if is_rounded else TOLERANCE
    return overlap_problem(spec, converging_seed(spec, convergence), pairs, tolerance=tolerance).solver.optimise()


def best_from_seeds(spec: DesignSpec, pairs: tuple[PairConstraint, ...], calls: Calls) -> SolverOutcome | None:
    """The best of the optima near the seeds; None, without trying the others, if the first seed leads to no optimum."""
    with closing(calls([(optimum_from, (spec, convergence, pairs)) for convergence in CONVERGENCE_DEPTHS])) as outcomes:
        first: SolverOutcome = next(outcomes)
        return best_of([first, *outcomes]) if first.solved else None


@dataclass(frozen=True)
class _FeasibilityResult:
    """The point of least violation near a start, its violation by constraint family, and an optimum near it, if any."""

    feasible: SolverOutcome
    violations: dict[str, float]
    optimum: SolverOutcome | None
    mirrors: tuple[FloatArray, FloatArray]
    regions: FloatArray


def feasibility_from(
    spec: DesignSpec, convergence: float, pairs: tuple[PairConstraint, ...], start: FloatArray | None = None
) -> _FeasibilityResult:
    """Minimise the violation near given values, or near the seed whose chief rays converge at a relative depth."""
    problem = overlap_problem(spec, converging_seed(spec, convergence), pairs)
    feasible, violations = problem.solver.find_feasible(start)
    is_met = feasible.solved and max(violations.values()) <= MAX_VIOLATION
    optimum = problem.solver.optimise(feasible.values) if is_met else None
    mirrors, regions = problem.solution(feasible.values), problem.outlines(spec, feasible.values)
    return _FeasibilityResult(feasible, violations, optimum, mirrors, regions)


def best_via_feasible_points(spec: DesignSpec, pairs: tuple[PairConstraint, ...], calls: Calls) -> SolverOutcome:
    """The optimum near the feasible points closest to the seeds or, if there seem to be none, after a continuation.

    Raises InfeasibleDesign if both seeds lead to points that clearly violate a constraint, or no start leads to an
    optimum.
    """
    candidates: list[_FeasibilityResult] = []
    with closing(_feasibility_results(spec, pairs, calls)) as results:
        for result in results:
            if not result.feasible.solved:
                continue
            candidates.append(result)
            if result.optimum is not None and result.optimum.solved:
                return result.optimum
            if len(candidates) == len(CONVERGENCE_DEPTHS) and _violation(candidates) > CLEAR_VIOLATION:
                break
    if not candidates or _violation(candidates) <= MAX_VIOLATION:
        if spec.rectangle_sizes is not None:
            # Free outlines contain the rectangles: a constraint that these cannot meet is named, too.
            best_via_feasible_points(spec.replaced(shape=FREE, same_size=False), pairs, calls)
            raise InfeasibleDesign(
                GAVE_UP,
                f"the search found no mirrors of the shape {spec.shape} that meet all constraints; free ones do",
            )
        raise InfeasibleDesign(GAVE_UP, "the search found no layout that meets all constraints")
    best = min(candidates, key=lambda result: sum(result.violations[name] * SLACK_WEIGHTS[name] for name in ELASTIC))
    raise _infeasibility(spec, best.violations, best.mirrors, best.regions)


def _violation(results: Iterable[_FeasibilityResult]) -> float:
    """The minimum, over the results, of the largest violation of a constraint."""
    return min(max(result.violations.values()) for result in results)


def _feasibility_results(
    spec: DesignSpec, pairs: tuple[PairConstraint, ...], calls: Calls
) -> Generator[_FeasibilityResult, None, None]:
    """Search for feasible points from each seed, then from the end of a continuation, which takes longest."""
    with closing(
        calls([(feasibility_from, (spec, convergence, pairs)) for convergence in CONVERGENCE_DEPTHS])
    ) as near_seeds:
        yield from near_seeds
    yield feasibility_from(spec, CONVERGENCE_DEPTHS[0], pairs, _continued(spec, pairs))


def _continued(spec: DesignSpec, pairs: tuple[PairConstraint, ...]) -> FloatArray | None:
    """Values of all unknowns at the last optimum of a continuation from an easy spec to this one."""
    values: FloatArray | None = None
    for fraction in CONTINUATION:
        easier = _easier(spec, fraction)
        outcome = overlap_problem(easier, converging_seed(easier), pairs).solver.optimise(values)
        if outcome.solved:
            values = outcome.values
    return values
