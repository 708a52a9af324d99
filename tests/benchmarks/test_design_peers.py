"""The program as SciPy gets it: derivatives, violations, and when a solver has reached the optimum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.design_peers import FEASIBLE, ScipyProblem, SolverRun, first_problem
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.design_spec import DesignSpec

SMALL = DesignSpec(rows=1, cols=2, shape="free")


@pytest.fixture(scope="module")
def program() -> ScipyProblem:
    return ScipyProblem(SMALL, first_problem(SMALL))


def _finite_differences(function: Callable[[FloatArray], Any], x: FloatArray, step: float = 1e-6) -> FloatArray:
    columns = [(function(x + d) - function(x - d)) / (2.0 * step) for d in step * np.eye(len(x))]
    return np.stack(columns, axis=-1)


def test_derivatives_handed_to_scipy_are_those_of_the_functions(program: ScipyProblem) -> None:
    x = program.start + 0.003 * np.random.default_rng(0).standard_normal(len(program.start))
    np.testing.assert_allclose(program.gradient(x), _finite_differences(program.value, x), atol=1e-7)
    found = program.jacobian(x).toarray()
    np.testing.assert_allclose(found, _finite_differences(program.constraints, x), atol=1e-6)
    multipliers = np.random.default_rng(1).standard_normal(len(program.equal))

    def slope(at: FloatArray) -> FloatArray:
        return 0.7 * program.gradient(at) + program.jacobian(at).T @ multipliers

    expected = _finite_differences(slope, x)
    np.testing.assert_allclose(program.hessian(x, 0.7, multipliers).toarray(), expected, atol=1e-5)


def test_what_is_missed_counts_bounds_and_both_kinds_of_constraints(program: ScipyProblem) -> None:
    optimum = first_problem(SMALL).solver.optimise().values[program.free]
    assert program.violation(optimum) < 1e-6
    narrower = ScipyProblem(SMALL, first_problem(SMALL))
    narrower.low = optimum - 0.1
    narrower.low[3] = optimum[3] + 0.25
    assert narrower.violation(optimum) == pytest.approx(0.25)
    narrower.low, narrower.high = optimum - 0.1, optimum - 0.2
    assert narrower.violation(optimum) == pytest.approx(0.2)
    g = program.constraints(program.start)
    assert program.equal.sum() == 3
    assert program.violation(program.start) >= np.abs(g[program.equal]).max()


def test_a_solver_is_near_only_when_it_also_holds_the_constraints() -> None:
    trace = SolverRun((1.0, 2.0, 3.0), (0.1, 0.2005, 0.2), (0.5, FEASIBLE, 0.0), "done")
    assert trace.time_to_s(0.2) == 2.0
    assert trace.time_to_s(0.19) is None
