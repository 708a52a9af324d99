"""Programs of terms: assembled derivatives against CasADi's and differences, and solutions of small problems."""

from __future__ import annotations

import os
import signal
import threading
from functools import cache

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.core.processes import interruption
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.chief_rays import blocked_light
from mirrorcam.optics.design.program import separation
from mirrorcam.optics.design.program.design_problem import SLACK_WEIGHTS, Problem, overlap_problem
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.design.program.nonlinear_program import ANCHOR_WEIGHT, Assembled, Program, Solver
from mirrorcam.optics.design.program.seeds import seed_of
from mirrorcam.optics.design.program.separation import neighbour_pairs
from mirrorcam.optics.design.program.terms import ELASTIC, Indices, Term, TermBuilder
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import hull_distance
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil
from tests.nightly import a_few
from tests.optics.design.program.seeded_mirrors import fold_of

BENT = Camera.c920().replaced(distortion=[0.05, -0.1, 0.001, 0.001, 0.0])
SPECS = [
    DesignSpec(rows=1, cols=2, camera=BENT, sides=5),
    DesignSpec(rows=2, cols=2, surface="second", thickness_mm=2.0, fold_deg=105.0, depths_mm=(400.0,)),
]


@cache
def problem(which: int) -> Problem:
    spec = SPECS[which]
    return overlap_problem(spec, seed_of(spec, 375.0), neighbour_pairs(spec.arrangement))


def nearby(solver: Solver, seed: int = 5) -> FloatArray:
    """Generic values of all unknowns, including slacks."""
    start = solver.program.start
    return start + np.random.default_rng(seed).normal(0.0, 2e-3, len(start))


def dense(matrix: ca.DM) -> FloatArray:
    return np.array(ca.densify(matrix))


def multipliers(solver: Solver) -> FloatArray:
    rows = solver.derivatives["jac_g"].size1_out(0)
    return np.random.default_rng(8).normal(0.0, 1.0, rows)


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("searching", [0.0, 1.0])
def test_derivatives_of_the_program_agree_with_differences(which: int, searching: float) -> None:
    solver = problem(which).solver
    at, rng = nearby(solver), np.random.default_rng(6)
    direction = rng.normal(0.0, 1.0, len(at))
    step = 1e-6 * direction
    gradients, jacobians, hessians = (solver.derivatives[name] for name in ("grad_f", "jac_g", "hess_lag"))

    def slope(values: list[FloatArray]) -> FloatArray:
        return (values[1] - values[0]) / 2e-6

    objective = [dense(gradients(at + sign * step, searching)[0]).ravel() for sign in (-1.0, 1.0)]
    gradient = dense(gradients(at, searching)[1]).ravel()
    assert_allclose([gradient @ direction], slope(objective), rtol=1e-6, atol=1e-8)
    limits = [dense(jacobians(at + sign * step, searching)[0]).ravel() for sign in (-1.0, 1.0)]
    jacobian = dense(jacobians(at, searching)[1])
    assert_allclose(jacobian @ direction, slope(limits), rtol=1e-6, atol=1e-7)

    weight, lam = 0.7, multipliers(solver)
    upper = dense(hessians(at, searching, weight, lam))
    assert not np.tril(upper, -1).any()
    lagrangian = [
        weight * dense(gradients(at + sign * step, searching)[1]).ravel()
        + dense(jacobians(at + sign * step, searching)[1]).T @ lam
        for sign in (-1.0, 1.0)
    ]
    assert_allclose((upper + np.triu(upper, 1).T) @ direction, slope(lagrangian), rtol=1e-5, atol=1e-6)
    assert np.abs(slope(lagrangian)).max() > 0.1


@pytest.mark.parametrize("which", a_few(1, [0, 1]))
@pytest.mark.parametrize("searching", [0.0, 1.0])
def test_derivatives_of_the_program_are_those_of_casadi(which: int, searching: float) -> None:
    solver = problem(which).solver
    # Written out as scalars, independently of the program's assembly.
    x = ca.SX.sym("x", solver.program.size)
    objective, _ = solver.derivatives["grad_f"].expand()(x, searching)
    limits, _ = solver.derivatives["jac_g"].expand()(x, searching)
    weight, lam = 0.7, multipliers(solver)
    lagrangian = weight * objective + ca.dot(ca.DM(lam), limits)
    automatic = ca.Function(
        "automatic", [x], [ca.gradient(objective, x), ca.jacobian(limits, x), ca.triu(ca.hessian(lagrangian, x)[0])]
    )
    at = nearby(solver)
    mine = (
        solver.derivatives["grad_f"](at, searching)[1],
        solver.derivatives["jac_g"](at, searching)[1],
        solver.derivatives["hess_lag"](at, searching, weight, lam),
    )
    for found, expected in zip(mine, automatic(at), strict=True):
        assert found.shape == expected.shape
        assert_allclose(dense(found), dense(expected), rtol=1e-9, atol=1e-10)


def test_a_search_asks_for_the_slacks_alone_and_to_stay_near() -> None:
    solver = problem(0).solver
    at = nearby(solver)
    count = len(ELASTIC)
    weights = np.array([SLACK_WEIGHTS[family] for family in ELASTIC])
    away = ANCHOR_WEIGHT * float(np.sum((at - solver.program.start)[count:] ** 2))
    assert float(solver.derivatives["grad_f"](at, 1.0)[0]) == pytest.approx(weights @ at[:count] + away)
    assembled = Assembled(solver.program)
    f, g = ca.Function("f", [assembled.x], list(assembled.objective_and_constraints()))(at)
    assert float(solver.derivatives["grad_f"](at, 0.0)[0]) == pytest.approx(float(f) + away)
    # A slack relaxes every limit of its family by the same amount, and no other limit.
    more = at.copy()
    more[ELASTIC.index("overlap")] += 0.25
    widened = ca.Function("g", [assembled.x], [assembled.objective_and_constraints()[1]])(more)
    assert_allclose(dense(widened - g).ravel(), 0.25 * (assembled.family == ELASTIC.index("overlap")), atol=1e-12)


def test_unknowns_keep_their_starts_and_bounds() -> None:
    program = Program()
    first = program.unknown([1.0, 2.0], -5.0, [3.0, 4.0])
    second = program.unknown(7.0)
    slacks = len(ELASTIC)
    assert first.tolist() == [slacks, slacks + 1]
    assert second.tolist() == [slacks + 2]
    assert program.size == slacks + 3
    low, high = program.bounds
    assert program.start[slacks:].tolist() == [1.0, 2.0, 7.0]
    assert low.tolist() == [0.0] * slacks + [-5.0, -5.0, -np.inf]
    assert high.tolist() == [0.0] * slacks + [3.0, 4.0, np.inf]


def square_term() -> Term:
    builder = TermBuilder()
    x, p = builder.unknown(2), builder.parameter()
    builder.minimise(ca.sumsqr(x - p))
    return builder.built()


def test_terms_are_used_over_unknowns_and_parameters_of_their_number() -> None:
    program, term = Program(), square_term()
    x = program.unknown([0.0, 1.0, 2.0])
    program.add(term, [x[[0, 2]]], [1.0])
    program.add(term, [x[:1], x[1:2]], [4.0])
    ((used, places, numbers),) = program.uses
    assert used is term
    assert places.tolist() == [x[[0, 2]].tolist(), x[:2].tolist()]
    assert numbers.tolist() == [[1.0], [4.0]]
    with pytest.raises(ValueError, match="3 unknowns and 1 parameters, expected 2 and 1"):
        program.add(term, [x], [1.0])
    with pytest.raises(ValueError, match="2 unknowns and 0 parameters, expected 2 and 1"):
        program.add(term, [x[:2]])


def test_uses_of_one_term_add_up() -> None:
    program, term = Program(), square_term()
    x = program.unknown([0.0, 0.0, 0.0])
    program.add(term, [x[:2]], [1.0])
    program.add(term, [x[1:]], [4.0])
    builder = TermBuilder()
    y = builder.unknown(1)
    builder.require(y - 3.0)
    fixed = builder.built(equality=True)
    program.add(fixed, [x[2:]])
    outcome = Solver(program, SLACK_WEIGHTS).optimise()
    assert outcome.solved
    # x0 = 1; x1 halfway between 1 and 4; x2 = 3 is requested. ANCHOR_WEIGHT shifts the optimum slightly.
    assert_allclose(outcome.values[x], [1.0, 2.5, 3.0], atol=1e-4)
    assert outcome.objective == pytest.approx(0.0 + 2 * 1.5**2 + 1.0, abs=1e-3)


def test_the_upper_half_of_the_hessian_holds_terms_used_in_any_order() -> None:
    builder = TermBuilder()
    x = builder.unknown(2)
    builder.minimise(x[0] ** 2 * x[1])
    program, term = Program(), builder.built()
    places = program.unknown([2.0, 3.0])
    program.add(term, [places[::-1]])
    solver = Solver(program, SLACK_WEIGHTS)
    upper = dense(solver.derivatives["hess_lag"](program.start, 0.0, 1.0, ca.DM(0, 1)))[len(ELASTIC) :, len(ELASTIC) :]
    # f = x1^2 x0 at (2, 3).
    assert_allclose(upper, np.array([[0.0, 6.0], [0.0, 4.0]]) + 2.0 * ANCHOR_WEIGHT * np.eye(2))


# Separated bodies.

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
ASIDE = np.array([0.0, 0.4, 0.3])


def cubes(gap: float) -> tuple[Solver, Indices]:
    """A fixed unit cube at the origin and one that may slide along x to 20, with a minimum gap and the target 0."""
    builder = TermBuilder()
    at, wanted = builder.unknown(1), builder.parameter()
    plane = separation.SeparatingPlane.unknown(builder)
    n, d = plane.normal, plane.offset
    for corner in CUBE:
        builder.require(d - ca.dot(n, ca.DM(corner)))
        moved = ca.DM(corner + ASIDE) + ca.vertcat(at, 0.0, 0.0)
        builder.require(ca.dot(n, moved) - d - wanted, "spacing")
    builder.minimise(at**2)
    program = Program()
    place = program.unknown([5.0], -20.0, 20.0)
    program.add(builder.built(), [place, program.unknown([1.0, 0.0, 0.0, 3.0], -30.0, 30.0)], [gap])
    return Solver(program, SLACK_WEIGHTS), place


def test_bodies_are_separated_by_exactly_the_requested_gap() -> None:
    solver, place = cubes(0.7)
    outcome = solver.optimise()
    assert outcome.solved
    body = CUBE + ASIDE + [outcome.values[place].item(), 0.0, 0.0]
    assert hull_distance(CUBE, body) == pytest.approx(0.7, abs=1e-4)


@pytest.mark.skipif(os.name == "nt", reason="a process does not get signals from itself there")
def test_an_interruption_ends_a_solution_without_a_word(capfd: pytest.CaptureFixture[str]) -> None:
    spec = DesignSpec(rows=4, cols=4)
    solver = overlap_problem(spec, seed_of(spec, 400.0), ()).solver
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGTERM))
    with interruption.remembered(), pytest.raises(KeyboardInterrupt):
        timer.start()
        solver.optimise()
    timer.join()
    assert capfd.readouterr().err == ""


def test_an_impossible_constraint_is_measured() -> None:
    solver, _ = cubes(22.0)
    assert not solver.optimise().solved
    feasible, missed = solver.find_feasible()
    assert feasible.solved
    # At x = 20 the cubes are 19 apart, 3 less than requested.
    assert missed["spacing"] == pytest.approx(3.0, abs=0.01)
    assert missed["overlap"] == pytest.approx(0.0, abs=1e-6)
    assert feasible.objective == pytest.approx(SLACK_WEIGHTS["spacing"] * missed["spacing"], abs=0.01)


def test_what_can_hold_is_found() -> None:
    solver, place = cubes(15.0)
    feasible, missed = solver.find_feasible()
    assert feasible.solved
    assert max(missed.values()) < 1e-6
    assert solver.optimise(feasible.values).values[place].item() == pytest.approx(16.0, abs=1e-3)


SCALE_MM = 80.0


def missed_by(
    mirrors: tuple[Mirror, Mirror], term: Term, family: str, parameters: list[float], pupil: Pupil = PINHOLE
) -> float:
    """The violation of a term by two fixed mirrors for the default fold, in scales; 0 if a plane satisfies it."""
    spec = DesignSpec()
    program = Program()
    places = []
    for mirror in mirrors:
        centre = mirror.apparent.virtual_centre_in_rig_mm @ spec.view_from_rig.T / SCALE_MM
        corners = mirror.apparent.outline_normalized.ravel()
        places += [program.unknown(values, values, values) for values in (centre, corners)]
    middles = [mirror.outline_in_rig_mm.mean(axis=0) @ spec.view_from_rig.T for mirror in mirrors]
    direction = (middles[1] - middles[0]) / np.linalg.norm(middles[1] - middles[0])
    start = [*direction, direction @ (middles[0] + middles[1]) / 2.0 / SCALE_MM]
    optics = [mirrors[0].thickness_mm / SCALE_MM, mirrors[0].refractive_index]
    optics += [pupil.radius_mm / SCALE_MM, SCALE_MM / pupil.focus_mm]
    fold = program.unknown(*[fold_of(spec)] * 3)
    program.add(term, [fold, *places, program.unknown(start, -5.0, 5.0)], [optics, parameters])
    outcome, missed = Solver(program, SLACK_WEIGHTS).find_feasible()
    assert outcome.solved
    return missed[family]


def as_second_surface(mirror: Mirror) -> Mirror:
    return Mirror.second_surface(
        mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=1.5, refractive_index=1.49
    )


@pytest.mark.parametrize("second_surface", [False, True])
@pytest.mark.parametrize(("i", "j"), [(0, 1), (1, 4), (0, 4), (3, 5)])
def test_gaps_are_those_of_the_solids(default_layout: Layout, i: int, j: int, second_surface: bool) -> None:
    mirrors = default_layout.mirrors[i], default_layout.mirrors[j]
    if second_surface:
        mirrors = as_second_surface(mirrors[0]), as_second_surface(mirrors[1])
    apart_mm = hull_distance(*(mirror.solid.corners_in_rig_mm for mirror in mirrors))
    assert apart_mm > 0.1
    term = separation.gap_term(Kind(4, False, second_surface))
    assert missed_by(mirrors, term, "spacing", [(apart_mm + 4.0) / SCALE_MM]) == pytest.approx(4.0 / SCALE_MM, abs=1e-5)
    assert missed_by(mirrors, term, "spacing", [(apart_mm - 0.05) / SCALE_MM]) == pytest.approx(0.0, abs=1e-6)


def slid(mirror: Mirror, along: float) -> Mirror:
    return mirror.replaced(
        virtual_centre_in_rig_mm=mirror.virtual_centre_in_rig_mm * along,
        outline_in_rig_mm=mirror.outline_in_rig_mm * along,
    )


@pytest.mark.parametrize("pupil", [PINHOLE, Pupil(1.8, 500.0), Pupil(12.0, 400.0)])
@pytest.mark.parametrize("leg", ["in", "out"])
def test_light_is_kept_free_just_where_rays_pass(default_layout: Layout, leg: str, pupil: Pupil) -> None:
    kind = Kind(4, False, False, pinhole=pupil == PINHOLE)
    term = separation.incoming_term(kind) if leg == "in" else separation.outgoing_term(kind)
    kept, lost = 0, 0
    for lit, occluder, along in ((4, 1, 1.0), (4, 1, 0.85), (1, 4, 0.85), (4, 5, 1.0), (4, 4, 0.8), (3, 5, 1.0)):
        mirrors = default_layout.mirrors[lit], slid(default_layout.mirrors[occluder], along)
        found = [one for one in blocked_light(mirrors, 1e5, pupil=pupil) if (one.mirror, one.leg) == (0, leg)]
        missed = missed_by(mirrors, term, "occlusion", [], pupil)
        if found:
            assert missed > 1e-3
            lost += 1
        else:
            # The outgoing beam of the pupil's centre is kept clear; it is wider than the beam of unvignetted pixels.
            spare = pupil.radius_mm / SCALE_MM if leg == "out" else 0.0
            assert missed == pytest.approx(0.0, abs=1e-6 + spare)
            kept += 1
    assert kept > 1
    assert lost > 0
