"""Parts of a term: its objective, constraints by family, and derivatives where they can be nonzero."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.optics.design.program.terms import ELASTIC, Term, TermBuilder


def example() -> Term:
    """f = p x0^2 x2; g = (x0 + x1, x1 x2 - p, x2^3), the last two elastic."""
    builder = TermBuilder()
    first, second, p = builder.unknown(2), builder.unknown(1), builder.parameter()
    builder.require(first[0] + first[1])
    builder.require(first[1] * second - p, "depth")
    builder.require(second**3, "size")
    builder.minimise(p * first[0] ** 2 * second)
    return builder.built()


def test_values_are_those_written_down() -> None:
    f, g = example().value([2.0, 3.0, 5.0], [7.0])
    assert float(f) == 7.0 * 4.0 * 5.0
    assert_allclose(np.array(g).ravel(), [5.0, 8.0, 125.0])


def test_derivatives_are_exact_and_stand_where_they_can_be_nonzero() -> None:
    term = example()
    assert (term.unknowns, term.parameters) == (3, 1)
    assert_allclose(np.array(term.gradient([2.0, 3.0, 5.0], [7.0])).ravel(), [140.0, 0.0, 28.0])
    jacobian = dict(
        zip(
            zip(term.rows.tolist(), term.cols.tolist(), strict=True),
            np.array(term.jacobian([2.0, 3.0, 5.0], [7.0])).ravel().tolist(),
            strict=True,
        )
    )
    assert jacobian == {(0, 0): 1.0, (0, 1): 1.0, (1, 1): 5.0, (1, 2): 3.0, (2, 2): 75.0}
    values = np.array(term.hessian([2.0, 3.0, 5.0], [7.0], 0.5, [1.0, 10.0, 100.0])).ravel().tolist()
    upper = dict(zip(zip(term.upper_rows.tolist(), term.upper_cols.tolist(), strict=True), values, strict=True))
    # w f: 7 x2 at (0, 0) and 7 * 2 x0 / 2 at (0, 2); l.g: 10 at (1, 2) and 100 * 6 x2 at (2, 2).
    assert upper == {(0, 0): 35.0, (0, 2): 14.0, (1, 2): 10.0, (2, 2): 3000.0}


def test_families_are_kept_by_constraint() -> None:
    assert example().family.tolist() == [-1, ELASTIC.index("depth"), ELASTIC.index("size")]
    builder = TermBuilder()
    builder.require(ca.horzcat(builder.unknown(2), builder.unknown(2)), "overlap")
    assert builder.built().family.tolist() == [ELASTIC.index("overlap")] * 4


def test_a_family_that_no_search_knows_is_refused() -> None:
    builder = TermBuilder()
    with pytest.raises(ValueError, match="not in tuple"):
        builder.require(builder.unknown(1), "colour")


def test_a_term_may_have_no_limits_or_nothing_to_minimise() -> None:
    builder = TermBuilder()
    builder.minimise(builder.unknown(1) ** 2)
    term = builder.built()
    assert (term.family.size, term.rows.size, term.parameters) == (0, 0, 0)
    assert np.array(term.jacobian([3.0], [])).size == 0
    builder = TermBuilder()
    builder.require(builder.unknown(1) * 2.0)
    term = builder.built(equality=True)
    assert term.equality
    assert np.array(term.gradient([3.0], [])).ravel().tolist() == [0.0]
    assert np.array(term.hessian([3.0], [], 1.0, [1.0])).size == 0
