"""The objective of a design for depth as smooth terms in CasADi: see `optics.design.assess.depth_sigma`."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from mirrorcam.optics.design.program.constraints import (
    REGION_CORNERS,
    given_grid_error,
    region_directions,
)
from mirrorcam.optics.design.program.mirror_variables import reflected, view_from_rig
from mirrorcam.optics.design.program.terms import Expression, Term, TermBuilder
from mirrorcam.optics.geometry.arrangement import Arrangement

ANGLES = 8
"""Directions in which the texture of a point is matched."""


def depth_information(
    centres: list[Expression],
    central: int,
    fold: Expression,
    point: Expression,
    nearness: Expression,
    blur: Expression,
) -> Expression:
    """What a window of the central view tells of the depth of a point (3), up to a factor.

    Views (3) and point in view axes, in scales. The bound for a texture with as much slope at each frequency: a view
    that shows |J| px per area, J px per length, weighs |J| / (s |J^-T u|)^2 in the direction u, with the variance s^2
    of its blur over that of a sharp picture, 1 + (blur (1 / z - nearness))^2.
    """
    turn = view_from_rig(fold)
    density, moves, steps, variances = [], [], [], []
    for centre in centres:
        image = turn.T @ reflected(point, centre)
        across = turn.T @ (ca.DM.eye(3) - 2.0 * centre @ centre.T / ca.sumsqr(centre))[:, :2]
        z = image[2]
        jacobian = (across[:2, :] * z - image[:2] @ across[2, :]) / z**2
        area = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
        adjoint = ca.blockcat([[jacobian[1, 1], -jacobian[1, 0]], [-jacobian[0, 1], jacobian[0, 0]]])
        density.append(ca.sqrt(area**2))
        steps.append(adjoint / area)
        variances.append(1.0 + (blur * (1.0 / z - nearness)) ** 2)
        moves.append((point[:2] - centre[:2]) / (point[2] - centre[2]))
    found: Expression = ca.SX(0.0)
    for angle in np.pi * (np.arange(ANGLES) + 0.5) / ANGLES:
        along = ca.DM([np.cos(angle), np.sin(angle)])
        weights = [n / (v * ca.sumsqr(step @ along)) for n, v, step in zip(density, variances, steps, strict=True)]
        moved = [ca.dot(move, along) for move in moves]
        mean = sum(w * m for w, m in zip(weights, moved, strict=True)) / sum(weights)
        found += sum(w * (m - mean) ** 2 for w, m in zip(weights, moved, strict=True))
    return found / density[central]


@lru_cache
def depth_sigma_term(count: int, central: int) -> Term:
    """The standard deviation of depth at a point, up to a factor.

    Unknowns: fold, virtual centres. Parameters: depth, the point as tangents (2) of angles from the one that views are
    aimed at (as corners of a region), 1 / focus, `blur`, weight.
    """
    term = TermBuilder()
    fold, centres = term.unknown(1), [term.unknown(3) for _ in range(count)]
    depth, tangents = term.parameter(), term.parameter(2)
    nearness, blur, weight = (term.parameter() for _ in range(3))
    point = ca.vertcat(view_from_rig(fold)[:2, 2] + tangents * (1.0 + depth), depth)
    term.minimise(weight / ca.sqrt(depth_information(centres, central, fold, point, nearness, blur)))
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
    term.require(term.parameter() ** 2 - given_grid_error(term, arrangement))
    return term.built()
