"""Relaxed programs: derivatives of terms whose numbers change, and nearest values beside closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.design.program.design_problem import SLACK_WEIGHTS
from mirrorcam.optics.design.program.nonlinear_program import Program, Solver
from mirrorcam.optics.design.program.relaxed import changing, relaxed_fold, relaxed_program
from mirrorcam.optics.design.program.terms import Term, TermBuilder


def apart() -> Term:
    """Two numbers of which the second is at least p larger than the first, and its square at most 4."""
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
    term = changing(apart())
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
    outcome, missed = Solver(relaxed, SLACK_WEIGHTS).mend(margin)
    assert outcome.solved
    assert outcome.values[-1] == pytest.approx((3.0 + margin) / 4.0, abs=1e-3)
    assert missed["spacing"] == pytest.approx(-margin, abs=1e-6)


def test_where_no_change_is_enough_something_is_missed() -> None:
    term = apart()
    outcome, missed = Solver(relaxed_program(program(term, 5.0), program(term, 3.0), 0.9), SLACK_WEIGHTS).mend(0.0)
    assert outcome.values[-1] == pytest.approx(1.0, abs=1e-3)
    assert missed["spacing"] == pytest.approx(1.0, abs=1e-3)


def test_what_is_feasible_stays_as_it_is() -> None:
    term = apart()
    outcome, missed = Solver(relaxed_program(program(term, 1.5), program(term, 1.0), 0.9), SLACK_WEIGHTS).mend(0.0)
    assert outcome.values[-1] == pytest.approx(0.0, abs=1e-2)
    assert max(missed.values()) < 1e-6


def test_a_fold_comes_as_near_as_can_be() -> None:
    builder = TermBuilder()
    fold = builder.unknown(1)
    builder.require(1.2 - fold, "body")
    begun = Program()
    place = begun.unknown(0.5, 0.5, 0.5)
    begun.add(builder.built(), [place])
    outcome, missed = Solver(relaxed_fold(begun, place, 2.0, 0.1, 2.5), SLACK_WEIGHTS).mend(0.0)
    assert outcome.values[place] == pytest.approx([1.2], abs=1e-3)
    assert max(missed.values()) < 1e-6
