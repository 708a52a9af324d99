"""The optimiser: virtual cameras near a rectangular grid, looking at the same thing, with buildable mirrors."""

from __future__ import annotations

from importlib.metadata import version
from itertools import combinations

import casadi as ca
import numpy as np

from optics.design.errors import InfeasibleDesign
from optics.design.light import blocked_light
from optics.design.metrics import evaluate, hull_distance, sheet_in_rig_mm
from optics.design.problem import LEAST_EFFICIENCY, Start, neighbours, problem_of, start_of
from optics.design.program import ELASTIC, Outcome, Solver
from optics.design.seeds import layout_of, mirrors_of
from optics.design.verify import require_passed, verify
from optics.layout import Layout
from optics.mirror import Mirror
from optics.spec import DesignSpec
from optics.values import FloatArray

SLACK_WEIGHTS = {"spacing": 1.0, "occlusion": 3.0, "depth": 1.0, "overlap": 10.0}
"""What it costs, in a search for feasibility, to miss a limit by one scale (overlap: by a whole sub-image)."""

MISSED = 1e-5


def _refusal(spec: DesignSpec, missed: dict[str, float]) -> InfeasibleDesign:
    """The constraint that is missed most, in words."""
    worst = max(ELASTIC, key=lambda family: missed[family] * SLACK_WEIGHTS[family])
    by_mm = missed[worst] * spec.scale_mm
    depths = ", ".join(f"{depth:g}" for depth in spec.depths_mm)
    finding = {
        "spacing": f"mirrors cannot be {spec.spacing_mm:g} mm apart, they come {by_mm:.3g} mm too close",
        "occlusion": f"sheets of {spec.thickness_mm:g} mm reach {by_mm:.3g} mm into the light between pupil and scene",
        "depth": f"{min(spec.depths_mm):g} mm is nearer than the mirrors, they reach {by_mm:.3g} mm past it",
        "overlap": f"no region at {depths} mm that {LEAST_EFFICIENCY:.0%} of the sensor could see lies in all views, "
        f"it leaves some by {missed['overlap']:.0%} of a sub-image",
    }[worst]
    return InfeasibleDesign(worst, finding)


def _check_depth(spec: DesignSpec, start: Start) -> None:
    """Refuse at once a depth that even the middles of the mirrors would lie beyond."""
    nearest_mm, reach_mm = min(spec.depths_mm), float(start.middles[:, 1].max()) * spec.scale_mm
    if nearest_mm <= reach_mm:
        raise _refusal(spec, dict.fromkeys(ELASTIC, 0.0) | {"depth": (reach_mm - nearest_mm) / spec.scale_mm})


def _solved(solver: Solver, spec: DesignSpec, start: Start, values: FloatArray | None) -> Outcome:
    """The optimum from earlier values, from the start or, where those lead nowhere, from the nearest feasible point."""
    if values is not None:
        outcome = solver.optimise(values)
        if outcome.solved:
            return outcome
    if not start.crowded:
        outcome = solver.optimise()
        if outcome.solved:
            return outcome
    feasible, missed = solver.find_feasible()
    if not feasible.solved:
        raise InfeasibleDesign("every", f"IPOPT came near to no layout that meets them all ({feasible.status})")
    if max(missed.values()) > MISSED:
        raise _refusal(spec, missed)
    outcome = solver.optimise(feasible.values)
    if not outcome.solved:
        raise InfeasibleDesign("every", f"IPOPT found no layout that meets them all at once ({outcome.status})")
    return outcome


def _optimum(
    spec: DesignSpec, start: Start, pairs: list[tuple[int, int]], values: FloatArray | None
) -> tuple[tuple[Mirror, ...], FloatArray]:
    """Mirrors at the optimum when `pairs` of them are kept out of each other's way, and the values of all unknowns."""
    problem = problem_of(spec, start, pairs)
    outcome = _solved(Solver(problem.program, problem.objective, SLACK_WEIGHTS), spec, start, values)
    solution = ca.Function("solution", [problem.program.unknowns], [problem.centres, problem.corners])
    centres, corners = (np.array(part) for part in solution(outcome.values))
    return mirrors_of(spec, centres * spec.scale_mm, corners.reshape(len(centres), -1, 2)), outcome.values


def _conflicts(spec: DesignSpec, mirrors: tuple[Mirror, ...], pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Pairs of mirrors in each other's way that nothing has kept apart so far."""
    blocked = {(found.light_of, found.sheet_of) for found in blocked_light(mirrors, max(spec.depths_mm))}
    close = {
        (i, j)
        for i, j in combinations(range(len(mirrors)), 2)
        if hull_distance(sheet_in_rig_mm(mirrors[i]), sheet_in_rig_mm(mirrors[j])) < spec.spacing_mm
    }
    return sorted((close | {(min(pair), max(pair)) for pair in blocked}) - set(pairs))


def design(spec: DesignSpec) -> Layout:
    """The optimised nominal layout of a spec, verified by code that shares nothing with the optimiser.

    Minimises tradeoff * (grid error / 0.25)^2 + (1 - tradeoff) * (1 - pixel efficiency), the efficiency averaged over
    the depths. Starts from the faceted ellipsoid; where that leads nowhere, looks for any layout that meets the
    constraints and goes on from there. Neighbours are kept out of each other's way from the start, other mirrors once
    they have come into it. Raises InfeasibleDesign, which names the constraint that cannot hold and by how much it is
    missed.
    """
    start = start_of(spec)
    _check_depth(spec, start)
    pairs = neighbours(spec)
    mirrors, values = _optimum(spec, start, pairs, None)
    while more := _conflicts(spec, mirrors, pairs):
        pairs += more
        mirrors, values = _optimum(spec, start, pairs, values)
    made_by = {"made_by": "optics.design.optimise.design", "solver": f"IPOPT of CasADi {version('casadi')}"}
    layout = layout_of(spec, mirrors, made_by)
    verdict = verify(layout, spec)
    require_passed(verdict)
    return layout.replaced(metrics=evaluate(layout, spec.depths_mm), verdict=verdict)
