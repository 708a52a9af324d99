"""Parts of a term: its objective, constraints by family, and derivatives where they can be nonzero."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program import constraints, separation
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.design.program.terms import ELASTIC, Expression, Indices, Term, TermBuilder
from mirrorcam.optics.geometry.arrangement import Arrangement
from tests.optics.design.program.seeded_mirrors import (
    KINDS,
    fold_of,
    lens_of,
    optics_of,
    seeded,
    spec_of,
)


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


MIRROR_NAMES = ("mirror", "rectangle", "region", "view", "tilted view", "grid", "mean")
NAMES = (*MIRROR_NAMES, "seen", "gap", "in", "out", "body gap", "body light")


def random_use(kind: Kind, name: str) -> tuple[Term, FloatArray, FloatArray]:
    """A term with generic unknowns and parameters."""
    spec = spec_of(kind, 105.0)
    rng = np.random.default_rng(11)
    centres, corners = seeded(spec)
    optics, lens = np.array(optics_of(spec)), lens_of(spec)
    plane = np.array([0.5, -0.7, 0.3, 0.6])
    fold, box = fold_of(spec), spec.keep_outs_in_rig_mm[0].ravel() / 80.0
    pair = [fold, centres[0], corners[0], centres[3], corners[3], plane]
    region = (constraints.region_directions() * [0.11, 0.08] + rng.normal(0.0, 0.01, (8, 2))).ravel()
    uses: dict[str, tuple[Term, list[FloatArray], list[FloatArray]]] = {
        "mirror": (
            constraints.mirror_term(kind),
            [fold, centres[1], corners[1]],
            [optics, *lens, np.array([0.1, 0.02, 4.0, 0.09, 0.7])],
        ),
        "rectangle": (
            constraints.rectangle_term(kind),
            [fold, centres[1], corners[1], np.array([0.3, 0.2])],
            [optics],
        ),
        "region": (
            constraints.region_term(),
            [np.array([0.02, -0.03]), region],
            [np.array([0.2, 0.12])],
        ),
        "view": (
            constraints.view_term(kind),
            [fold, centres[2], corners[2], region],
            [optics, *lens, np.array([5.0, 0.09, 0.8, 0.01])],
        ),
        "tilted view": (
            constraints.view_term(kind, tilted=True),
            [fold, centres[2], corners[2], region],
            [optics, *lens, np.array([5.0, 0.09, 0.8, 0.01, 0.02, -0.01])],
        ),
        "grid": (constraints.grid_term(Arrangement(2, 2)), [centres.ravel()], [np.array([3.0])]),
        "mean": (constraints.mean_term(2), [fold, centres[:2].ravel()], []),
        "seen": (
            separation.sub_image_gap_term(kind.sides),
            [corners[0], corners[3], np.array([0.5, -0.7, 0.3])],
            [np.array([0.02])],
        ),
        "gap": (separation.gap_term(kind), pair, [optics, np.array([0.02])]),
        "in": (separation.incoming_term(kind), pair, [optics]),
        "out": (separation.outgoing_term(kind), pair, [optics]),
        "body gap": (separation.body_gap_term(kind), [fold, centres[1], corners[1], plane], [optics, box]),
        "body light": (separation.body_light_term(kind), [fold, centres[1], corners[1], plane], [optics, box]),
    }
    term, unknowns, parameters = uses[name]
    return term, np.concatenate(unknowns), np.concatenate([np.zeros(0), *parameters])


def sparse(shape: tuple[int, int], rows: Indices, cols: Indices, values: Expression) -> FloatArray:
    matrix = np.zeros(shape)
    np.add.at(matrix, (rows, cols), np.array(values).ravel())
    return matrix


def central(function: Callable[[FloatArray], FloatArray], at: FloatArray, step: float = 1e-6) -> FloatArray:
    """Derivatives (m, n) of a function (n,) -> (m,) by central differences."""
    steps = step * np.eye(len(at))
    return np.array([(function(at + one) - function(at - one)) / (2.0 * step) for one in steps]).T


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_terms_agree_with_differences(kind: Kind, name: str) -> None:
    term, x, p = random_use(kind, name)
    assert x.shape == (term.unknowns,)
    assert p.shape == (term.parameters,)
    rng = np.random.default_rng(2)
    multipliers, weight = rng.normal(0.0, 1.0, term.family.size), 0.6

    def gradient(at: FloatArray) -> FloatArray:
        return np.array(term.gradient(at, p)).ravel()

    def jacobian(at: FloatArray) -> FloatArray:
        return sparse((term.family.size, term.unknowns), term.rows, term.cols, term.jacobian(at, p))

    def objective(at: FloatArray) -> FloatArray:
        return np.array(term.value(at, p)[0]).ravel()

    def limits(at: FloatArray) -> FloatArray:
        return np.array(term.value(at, p)[1]).ravel()

    def close(found: FloatArray, expected: FloatArray) -> None:
        assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * max(1.0, np.abs(expected).max()))

    close(gradient(x), central(objective, x)[0])
    close(jacobian(x), central(limits, x))
    upper = sparse((term.unknowns,) * 2, term.upper_rows, term.upper_cols, term.hessian(x, p, weight, multipliers))
    assert not np.tril(upper, -1).any()
    close(
        upper + np.triu(upper, 1).T,
        central(lambda at: weight * gradient(at) + jacobian(at).T @ multipliers, x),
    )
    # The comparison would be void if all differences were zero.
    assert np.abs(jacobian(x)).max() > 0.1
    assert np.abs(upper).max() > 0.1 or name == "region", "only that one is linear"


def test_a_mean_and_a_rectangle_are_equalities_and_the_rest_are_limits() -> None:
    kind = KINDS[0]
    for name in NAMES:
        assert random_use(kind, name)[0].equality == (name in ("mean", "rectangle"))


def test_each_elastic_family_has_its_terms() -> None:
    kind = Kind(4, False, True)
    families = {name: {ELASTIC[k] for k in random_use(kind, name)[0].family if k >= 0} for name in NAMES}
    assert families == {
        "mirror": {"size", "depth", "occlusion"},
        "rectangle": set(),
        "region": set(),
        "view": {"overlap"},
        "tilted view": {"overlap"},
        "grid": set(),
        "mean": set(),
        "seen": {"seen gap"},
        "gap": {"spacing"},
        "in": {"occlusion"},
        "out": {"occlusion"},
        "body gap": {"body"},
        "body light": {"body"},
    }
