"""The objective of a design for depth as smooth terms in CasADi: see `optics.design.assess.depth_sigma`."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from mirrorcam.optics.design.program.constraints import (
    LEAST_GRID_SPACING,
    REGION_CORNERS,
    region_directions,
    squared_grid_error,
)
from mirrorcam.optics.design.program.mirror_variables import reflected, view_from_rig
from mirrorcam.optics.design.program.terms import Expression, Term, TermBuilder
from mirrorcam.optics.geometry.arrangement import Arrangement


def depth_information(
    centres: list[Expression], fold: Expression, depth: Expression, nearness: Expression, blur: Expression
) -> Expression:
    """What views (3, view axes, in scales) tell of a depth where the folded optical axis meets it, up to a factor.

    The bound for a texture with as much slope at each frequency. At the distance D from a view along the view axis, and
    z along the axis of the camera, there are f^2 D / z^3 px per area; the view weighs (D / z^3)^2 / s^2, with the
    variance s^2 of its blur over that of a sharp picture, 1 + (blur (1 / z - nearness))^2. Pixels count as equally fine
    in all directions.
    """
    turn = view_from_rig(fold)
    aim = turn[:2, 2]
    point = ca.vertcat(aim, depth)
    weights, moves = [], []
    for centre in centres:
        away = depth - centre[2]
        z = ca.dot(turn[:, 2], reflected(point, centre))
        weights.append((away / z**3) ** 2 / (1.0 + (blur * (1.0 / z - nearness)) ** 2))
        moves.append((aim - centre[:2]) / away)
    total: Expression = sum(weights[1:], start=weights[0])
    mean: Expression = sum((w * m for w, m in zip(weights, moves, strict=True)), start=ca.SX.zeros(2)) / total
    return sum((w * ca.sumsqr(m - mean) for w, m in zip(weights, moves, strict=True)), start=ca.SX(0.0))


@lru_cache
def depth_sigma_term(count: int) -> Term:
    """The standard deviation of depth over that of a reference.

    Unknowns: fold, virtual centres. Parameters: depth, 1 / focus, `blur`, the reference's information, weight.
    """
    term = TermBuilder()
    fold, centres = term.unknown(1), [term.unknown(3) for _ in range(count)]
    depth, nearness, blur, reference, weight = (term.parameter() for _ in range(5))
    term.minimise(weight * ca.sqrt(reference / depth_information(centres, fold, depth, nearness, blur)))
    return term.built()


def field_of_view(corners: Expression, centres: list[Expression], depth: Expression) -> Expression:
    """Size (2) of a region as tangents from the mean virtual centre, across and down.

    Between the means of the two corners on either side; `corners` are those of a region's term.
    """
    mean_z = sum(centre[2] for centre in centres) / len(centres)
    sides = []
    for axis in range(2):
        along = region_directions()[:, axis]
        ahead, behind = (np.flatnonzero(sign * along > 0.7).tolist() for sign in (1.0, -1.0))
        sides.append(sum(corners[2 * k + axis] for k in ahead) / 2.0 - sum(corners[2 * k + axis] for k in behind) / 2.0)
    return ca.vertcat(*sides) * (1.0 + depth) / (depth - mean_z)


@lru_cache
def field_of_view_term(count: int) -> Term:
    """A region at least as large. Unknowns: its corners, virtual centres. Parameters: depth, least size (2)."""
    term = TermBuilder()
    corners, centres = term.unknown(2 * REGION_CORNERS), [term.unknown(3) for _ in range(count)]
    depth, least = term.parameter(), term.parameter(2)
    term.require(field_of_view(corners, centres, depth) - least)
    return term.built()


@lru_cache
def grid_limit_term(arrangement: Arrangement) -> Term:
    """Virtual centres at most so far from a grid or pattern, whose spacings are positive. Parameter: largest error."""
    term = TermBuilder()
    centres, most = [term.unknown(3) for _ in arrangement.names], term.parameter()
    error, spacings = squared_grid_error(centres, arrangement)
    for spacing in spacings:
        term.require(spacing - LEAST_GRID_SPACING)
    term.require(most**2 - error)
    return term.built()
