"""The program of a spec: constraints on neighbours, stable indices of unknowns, and the objective of the metrics."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.program.design_problem import (
    REFERENCE_GRID_ERROR,
    SLACK_WEIGHTS,
    overlap_problem,
    relaxed_fold,
    relaxed_program,
    relaxed_term,
)
from mirrorcam.optics.design.program.draft import TIE_BREAK
from mirrorcam.optics.design.program.nonlinear_program import Assembled, Program, Solver
from mirrorcam.optics.design.program.seeds import layout_of, mirrors_of, seed_of
from mirrorcam.optics.design.program.separation import PairConstraint, neighbour_pairs
from mirrorcam.optics.design.program.terms import Term, TermBuilder
from mirrorcam.optics.geometry.arrangement import Arrangement
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.nightly import a_few


def test_appended_constraints_keep_the_indices_of_a_solution() -> None:
    spec = DesignSpec(rows=1, cols=3)
    seed = seed_of(spec, 375.0)
    pairs = neighbour_pairs(Arrangement(1, 3))
    fewer, more = (overlap_problem(spec, seed, kept) for kept in (pairs, (*pairs, PairConstraint("in", 0, 2))))
    assert (fewer.centres == more.centres).all()
    assert (fewer.corners == more.corners).all()
    assert_allclose(more.solver.program.start[: fewer.solver.program.size], fewer.solver.program.start)
    assert more.solver.program.size == fewer.solver.program.size + 4
    found = fewer.solver.optimise()
    assert more.solver.optimise(found.values).objective == pytest.approx(found.objective, rel=1e-4)


@pytest.mark.parametrize(
    "changes",
    a_few(
        2,
        [
            {},
            {"fold_deg": 110.0, "sides": 6},
            {"surface": "second", "thickness_mm": 3.0, "fold_deg": 90.0},
            {"camera": Camera.c920().replaced(distortion=[-0.1, 0.02, 0.001, -0.001, 0.0], cx_px=940.0)},
        ],
    ),
    ids=["plain", "fold", "second surface", "distorted"],
)
def test_the_objective_is_that_of_the_metrics(changes: dict[str, object]) -> None:
    spec = DesignSpec.model_validate({"rows": 2, "cols": 2, **changes})
    seed = seed_of(spec, 375.0)
    made = overlap_problem(spec, seed, neighbour_pairs(spec.arrangement))
    outcome = made.solver.optimise()
    assert outcome.solved
    centres, corners = made.solution(outcome.values)
    layout = layout_of(spec, mirrors_of(spec, centres * spec.scale_mm, corners), {})
    assembled = Assembled(made.solver.program)
    f = float(ca.Function("f", [assembled.x], [assembled.objective_and_constraints()[0]])(outcome.values))
    metrics = evaluate(layout, spec.depths_mm)
    grid = spec.tradeoff * (metrics["grid_error"].value / REFERENCE_GRID_ERROR) ** 2
    x, y = np.moveaxis(corners, -1, 0)
    areas = 0.5 * np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1)
    filled = float(np.mean(areas)) / (4.0 * float(np.prod(seed.half_tile)))
    efficiency = (grid - TIE_BREAK * filled - f) / (1.0 - spec.tradeoff + TIE_BREAK)
    measured = np.mean([metrics[f"usable_efficiency_{depth:g}mm"].value for depth in spec.depths_mm])
    # The region of the program has eight corners and lies inside the one that all views share.
    assert efficiency <= measured + 1e-6
    assert efficiency >= 0.98 * measured


def apart() -> Term:
    """Two numbers: the second exceeds the first by at least p, and its square is at most 4."""
    builder = TermBuilder()
    x, p = builder.unknown(2), builder.parameter()
    builder.require(x[1] - x[0] - p, "spacing")
    builder.require(4.0 - x[1] ** 2)
    builder.minimise(100.0 * x[0])
    return builder.built()


def program(term: Term, gap: float, low: float = 0.0) -> Program:
    begun = Program()
    begun.add(term, [begun.unknown([0.5, 1.0], low, 10.0)], [gap])
    return begun


def test_numbers_run_from_one_program_to_the_other() -> None:
    term = relaxed_term(apart())
    for change, gap in ((0.0, 5.0), (0.25, 4.0), (1.0, 1.0)):
        f, g = term.value([0.5, 1.0, change], [5.0, -4.0])
        assert float(f) == 0.0
        assert np.array(g).ravel() == pytest.approx([0.5 - gap, 3.0])
    jacobian = np.zeros((2, 3))
    jacobian[term.rows, term.cols] = np.array(term.jacobian([0.5, 1.0, 0.3], [5.0, -4.0])).ravel()
    assert jacobian == pytest.approx(np.array([[-1.0, 1.0, 4.0], [0.0, -2.0, 0.0]]))
    assert term.family.tolist() == apart().family.tolist()


@pytest.mark.parametrize("margin", [0.0, 0.01])
def test_the_smallest_change_is_found(margin: float) -> None:
    term = apart()
    # At most 2 apart: 5 - 4 change = 2 - margin.
    relaxed = relaxed_program(program(term, 5.0), program(term, 1.0), 0.9)
    outcome, missed = Solver(relaxed, SLACK_WEIGHTS).find_relaxed(margin)
    assert outcome.solved
    assert outcome.values[-1] == pytest.approx((3.0 + margin) / 4.0, abs=1e-3)
    assert missed["spacing"] == pytest.approx(-margin, abs=1e-6)


def test_where_no_change_is_enough_something_is_missed() -> None:
    term = apart()
    outcome, missed = Solver(relaxed_program(program(term, 5.0), program(term, 3.0), 0.9), SLACK_WEIGHTS).find_relaxed(
        0.0
    )
    assert outcome.values[-1] == pytest.approx(1.0, abs=1e-3)
    assert missed["spacing"] == pytest.approx(1.0, abs=1e-3)


def test_what_is_feasible_stays_as_it_is() -> None:
    term = apart()
    outcome, missed = Solver(relaxed_program(program(term, 1.5), program(term, 1.0), 0.9), SLACK_WEIGHTS).find_relaxed(
        0.0
    )
    assert outcome.values[-1] == pytest.approx(0.0, abs=1e-2)
    assert max(missed.values()) < 1e-6


def test_a_fold_comes_as_near_as_can_be() -> None:
    builder = TermBuilder()
    fold = builder.unknown(1)
    builder.require(1.2 - fold, "body")
    begun = Program()
    place = begun.unknown(0.5, 0.5, 0.5)
    begun.add(builder.built(), [place])
    outcome, missed = Solver(relaxed_fold(begun, place, 2.0, 0.1, 2.5), SLACK_WEIGHTS).find_relaxed(0.0)
    assert outcome.values[place] == pytest.approx([1.2], abs=1e-3)
    assert max(missed.values()) < 1e-6
