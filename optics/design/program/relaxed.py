"""Programs of a spec that may change: the smallest change of one parameter with which all constraints are met.

The numbers of such a program run linearly from those of one spec to those of another, and how far they go, the change,
is an unknown.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.nonlinear_program import Program
from mirrorcam.optics.design.program.terms import ELASTIC, Indices, Term, TermBuilder

CHANGE_COST = 0.01
"""Weight of the squared change: little beside any violation."""


@lru_cache
def changing(term: Term) -> Term:
    """The constraints of a term whose parameters change; it has no objective.

    Unknowns: those of the term, the change. Parameters: those of the term without a change, and what a change of 1 adds
    to them.
    """
    builder = TermBuilder()
    x, change = builder.unknown(term.unknowns), builder.unknown(1)
    numbers, added = builder.parameter(term.parameters), builder.parameter(term.parameters)
    _, constraints = term.value(x, numbers + change * added)
    for row, family in enumerate(term.family.tolist()):
        builder.require(constraints[row], None if family < 0 else ELASTIC[family])
    return builder.built(equality=term.equality)


@lru_cache
def distance_term() -> Term:
    """The weighted squared distance of a number from another one. Parameters: that one, the weight."""
    builder = TermBuilder()
    number, other, weight = builder.unknown(1), builder.parameter(), builder.parameter()
    builder.minimise(weight * (number - other) ** 2)
    return builder.built()


def relaxed_program(program: Program, changed: Program, first: float) -> Program:
    """A program whose numbers change; its last unknown is the change, from 0 to 1, whose square it minimises.

    Parameters
    ----------
    program, changed
        With a change of 0 and of 1: of the same terms and unknowns, from whose values at a change of 1 it starts.
    first
        The change that it starts with.
    """
    relaxed = _started_as(changed, *program.bounds)
    change = relaxed.unknown(first, 0.0, 1.0)
    for (term, places, numbers), (_, _, others) in zip(program.uses, changed.uses, strict=True):
        for where, now, then in zip(places, numbers, others, strict=True):
            relaxed.add(changing(term), [where, change], [now, then - now])
    relaxed.add(distance_term(), [change], [0.0, CHANGE_COST])
    return relaxed


def relaxed_fold(program: Program, fold: Indices, asked: float, least: float, most: float) -> Program:
    """A program whose fold, at its place, changes within a range, and comes as near as can be to the one asked for.

    Radians; it starts with the fold of the program.
    """
    low, high = program.bounds
    low[fold], high[fold] = least, most
    relaxed = _started_as(program, low, high)
    change = relaxed.unknown(0.0, 0.0, 0.0)
    for term, places, numbers in program.uses:
        for where, now in zip(places, numbers, strict=True):
            relaxed.add(changing(term), [where, change], [now, np.zeros_like(now)])
    relaxed.add(distance_term(), [fold], [asked, CHANGE_COST])
    return relaxed


def _started_as(program: Program, low: FloatArray, high: FloatArray) -> Program:
    """A program with the unknowns of another, and no terms."""
    begun = Program()
    kept = slice(len(ELASTIC), None)
    begun.unknown(program.start[kept], low[kept], high[kept])
    return begun
