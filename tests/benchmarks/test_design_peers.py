"""The program as SciPy gets it: derivatives, violations, and when a solver has reached the optimum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.design_peers import HELD, Question, Trace, first_problem
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.design_spec import DesignSpec

SMALL = DesignSpec(rows=1, cols=2)


@pytest.fixture(scope="module")
def question() -> Question:
    return Question(SMALL, first_problem(SMALL))


def _finite_differences(function: Callable[[FloatArray], Any], x: FloatArray, step: float = 1e-6) -> FloatArray:
    columns = [(function(x + d) - function(x - d)) / (2.0 * step) for d in step * np.eye(len(x))]
    return np.stack(columns, axis=-1)


def test_derivatives_handed_to_scipy_are_those_of_the_functions(question: Question) -> None:
    x = question.start + 0.003 * np.random.default_rng(0).standard_normal(len(question.start))
    np.testing.assert_allclose(question.gradient(x), _finite_differences(question.value, x), atol=1e-7)
    found = question.jacobian(x).toarray()
    np.testing.assert_allclose(found, _finite_differences(question.constraints, x), atol=1e-6)
    multipliers = np.random.default_rng(1).standard_normal(len(question.equal))

    def slope(at: FloatArray) -> FloatArray:
        return 0.7 * question.gradient(at) + question.jacobian(at).T @ multipliers

    expected = _finite_differences(slope, x)
    np.testing.assert_allclose(question.hessian(x, 0.7, multipliers).toarray(), expected, atol=1e-5)


def test_what_is_missed_counts_bounds_and_both_kinds_of_constraints(question: Question) -> None:
    optimum = first_problem(SMALL).solver.optimise().values[question.kept]
    assert question.missed(optimum) < 1e-6
    narrower = Question(SMALL, first_problem(SMALL))
    narrower.low = optimum - 0.1
    narrower.low[3] = optimum[3] + 0.25
    assert narrower.missed(optimum) == pytest.approx(0.25)
    narrower.low, narrower.high = optimum - 0.1, optimum - 0.2
    assert narrower.missed(optimum) == pytest.approx(0.2)
    g = question.constraints(question.start)
    assert question.equal.sum() == 3
    assert question.missed(question.start) >= np.abs(g[question.equal]).max()


def test_a_solver_is_near_only_when_it_also_holds_the_constraints() -> None:
    trace = Trace((1.0, 2.0, 3.0), (0.1, 0.2005, 0.2), (0.5, HELD, 0.0), "done")
    assert trace.reached_s(0.2) == 2.0
    assert trace.reached_s(0.19) is None
