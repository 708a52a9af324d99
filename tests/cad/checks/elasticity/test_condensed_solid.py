"""A bar by finite elements, against beams in closed form and a direct solution."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.cad.checks.elasticity.condensed_solid import LOADS, POISSON, Carried, Solid, rigid_motions
from mirrorcam.cad.checks.elasticity.tetrahedra import Tetrahedra
from mirrorcam.core.errors import InputError

LENGTH, SIDE = 60.0, 6.0
AREA, INERTIA = SIDE**2, SIDE**4 / 12.0
FIRST, LAST = np.array([0.0, 3.0, 3.0]), np.array([LENGTH, 3.0, 3.0])


def ends(solid: Solid) -> list[NDArray[np.int64]]:
    return [np.flatnonzero(np.abs(solid.nodes[:, 0] - x) < 1e-6) for x in (0.0, LENGTH)]


def test_without_strain_there_is_no_force_and_all_weight_reaches_the_screws(bar: Tetrahedra) -> None:
    solid = Solid(bar)
    condensed = solid.condensed(ends(solid), np.array([FIRST, LAST]), {})
    rigid = np.vstack([np.vstack([rigid_motions(p[None]), np.eye(6)[3:]]) for p in (FIRST, LAST)])
    assert np.abs(condensed.stiffness @ rigid).max() < 1e-8 * np.abs(condensed.stiffness).max()
    weight = condensed.forces[:, :3].reshape(2, 6, 3)[:, :3].sum(axis=0)
    np.testing.assert_allclose(weight, LENGTH * AREA * np.eye(3), atol=1e-6)
    # Fixed at both ends, it exerts E A e on each.
    push = condensed.forces[:, 6].reshape(2, 6)[:, 0]
    np.testing.assert_allclose(push, [-AREA, AREA], rtol=0.06)


def test_a_bar_is_timoshenkos_cantilever(bar: Tetrahedra) -> None:
    solid = Solid(bar)
    condensed = solid.condensed(ends(solid), np.array([FIRST, LAST]), {})
    free = np.linalg.inv(condensed.stiffness[6:, 6:])
    shear = 1.0 / (2.0 * (1.0 + POISSON)) * 5.0 / 6.0 * AREA
    # Its rigid ends do not contract, which makes it slightly stiffer.
    assert free[0, 0] == pytest.approx(LENGTH / AREA, rel=0.05)
    for axis in (1, 2):
        assert free[axis, axis] == pytest.approx(LENGTH**3 / 3.0 / INERTIA + LENGTH / shear, rel=0.03)
    assert free[4, 4] == pytest.approx(LENGTH / INERTIA, rel=0.02)
    # Torsion of a square: J = .1406 a^4.
    assert free[3, 3] == pytest.approx(LENGTH * 2.0 * (1.0 + POISSON) / (0.1406 * SIDE**4), rel=0.05)


def test_a_carried_body_sinks_and_follows_the_expansion_of_the_solid(bar: Tetrahedra) -> None:
    solid = Solid(bar)
    first, last = ends(solid)
    beyond = LAST + np.array([10.0, 0.0, 0.0])
    condensed = solid.condensed([first], FIRST[None], {"mass": Carried(last, LAST, 2.0, beyond)})
    per_load = condensed.per_load["mass"]
    assert per_load.shape == (6, LOADS)
    # A weight of 2 N, 10 mm past the end: a force and a moment there.
    assert per_load[2, 5] == pytest.approx(2.0 * (LENGTH**3 / 3.0 + 10.0 * LENGTH**2 / 2.0) / INERTIA, rel=0.02)
    assert per_load[4, 5] == pytest.approx(-2.0 * (LENGTH**2 / 2.0 + 10.0 * LENGTH) / INERTIA, rel=0.02)
    # Its own weight: a uniform load.
    assert per_load[2, 2] == pytest.approx(AREA * LENGTH**4 / 8.0 / INERTIA, rel=0.02)
    np.testing.assert_allclose(per_load[:3, 6], [LENGTH, 0.0, 0.0], atol=0.02 * LENGTH)
    # It follows the screw as a rigid body.
    np.testing.assert_allclose(condensed.per_screws["mass"][:3], rigid_motions((LAST - FIRST)[None]), atol=1e-6)


def test_loads_in_any_direction_are_sums(bar: Tetrahedra) -> None:
    """For oblique gravity, solved directly with all elements: rotated axes give rotated motions."""
    solid = Solid(bar)
    gravity = np.array([0.36, -0.48, 0.8])
    across = np.array([0.8, 0.6, 0.0])
    turn = np.column_stack([gravity, across, np.cross(gravity, across)])
    first, last = ends(solid)
    carried = {"mass": Carried(last, LAST, 1.0, LAST)}
    superposed = solid.condensed([first], FIRST[None], carried).per_load["mass"][:, :3] @ gravity
    turned = Solid(Tetrahedra(bar.points @ turn, bar.corners))
    there = {"mass": Carried(last, LAST @ turn, 1.0, LAST @ turn)}
    direct = turned.condensed([first], (FIRST @ turn)[None], there).per_load["mass"][:, 0]
    np.testing.assert_allclose(np.kron(np.eye(2), turn) @ direct, superposed, rtol=1e-6, atol=1e-6)


def test_screws_that_hold_too_little_or_the_same_are_refused(bar: Tetrahedra) -> None:
    solid = Solid(bar)
    first, _ = ends(solid)
    with pytest.raises(InputError, match="fewer than 3 nodes"):
        solid.condensed([first[:2]], FIRST[None], {})
    with pytest.raises(ValueError, match="share nodes"):
        solid.condensed([first, first], np.array([FIRST, FIRST]), {})


def test_a_stiff_strip_glued_to_a_bar_stretches_it_as_volkersen_says(bar: Tetrahedra) -> None:
    """A rigid strip that expands by e under a bar, in glue of k N/mm3: E A u'' = k b (u - e x), free at both ends.

    Hence u = e (x - sinh(l x) / (l cosh(l L / 2))), l^2 = k b / (E A), with x from the middle. Normal to the strip the
    glue holds the bar flat. The bar's own shear, h / 3 G, is in series with it.
    """
    solid, strain, stiff = Solid(bar), 1e-3, 0.02
    middle = np.array([LENGTH / 2.0, 0.0, 0.0])
    under = np.flatnonzero(np.abs(solid.nodes[:, 1]) < 1e-6)
    # Uniform glue on the quadratic nodes: half the share for nodes on an edge, a quarter at corners.
    share = np.ones(len(under))
    for axis, end in ((0, LENGTH), (2, SIDE)):
        share *= np.where((solid.nodes[under, axis] < 1e-6) | (solid.nodes[under, axis] > end - 1e-6), 0.5, 1.0)
    area = LENGTH * SIDE * share / share.sum()
    glue = area[:, None, None] * np.diag([stiff, 10.0, stiff])
    ends_at = ends(solid)
    carried = {
        "strip": Carried(under, middle, 1.0, middle, glue),
        "end": Carried(ends_at[1], LAST, 0.0, LAST),
        "other": Carried(ends_at[0], FIRST, 0.0, FIRST),
    }
    # In one plane across the bar, which can expand to both sides.
    in_middle = np.abs(solid.nodes[:, 0] - LENGTH / 2.0) < 1e-6
    held = np.flatnonzero(in_middle & (np.linalg.norm(solid.nodes[:, 1:] - 3.0, axis=1) < 1.6))
    condensed = solid.condensed([held], np.array([[LENGTH / 2.0, 3.0, 3.0]]), carried)
    longer = strain * (condensed.per_load["end"][0, 7] - condensed.per_load["other"][0, 7])
    in_series = 1.0 / (1.0 / stiff + SIDE * 2.0 * (1.0 + POISSON) / 3.0)
    rate = np.sqrt(in_series * SIDE / AREA)
    half = rate * LENGTH / 2.0
    assert longer == pytest.approx(strain * LENGTH * (1.0 - np.tanh(half) / half), rel=0.02)
    # If both expand equally, the glue is not strained, and the bar expands by as much.
    alike = [condensed.per_load[name][0, 6:].sum() for name in ("end", "other")]
    assert alike[0] - alike[1] == pytest.approx(LENGTH, rel=0.01)


def test_a_softly_glued_body_follows_its_seat_and_sinks_in_its_glue(bar: Tetrahedra) -> None:
    solid = Solid(bar)
    first, last = ends(solid)
    glue = np.tile(0.1 * np.eye(3), (len(last), 1, 1))
    condensed = solid.condensed([first], FIRST[None], {"mass": Carried(last, LAST, 2.0, LAST, glue)})
    plain = solid.condensed([first], FIRST[None], {"mass": Carried(last, LAST, 2.0, LAST)})
    np.testing.assert_allclose(condensed.per_screws["mass"], plain.per_screws["mass"], atol=1e-6)
    sunk = condensed.per_load["mass"][2, 5] - plain.per_load["mass"][2, 5]
    assert sunk == pytest.approx(2.0 / (0.1 * len(last)), rel=0.1)
