"""Terms of a nonlinear program: small functions shared by many mirrors, with derivatives made only once.

A program with n mirrors contains each kind of term many times, over different unknowns. All uses share the exact
derivatives of one small function, so building a program takes milliseconds, however many mirrors it has.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Expression = Any
"""A CasADi SX or MX matrix; CasADi ships no types."""

Indices = NDArray[np.int64]

ELASTIC = ("spacing", "seen gap", "occlusion", "body", "depth", "overlap", "size")
"""Families of constraints that a search for feasibility may violate; it minimises one slack per family.

A "seen gap" is the gap between two sub-images, as the spec's `seen_gap_mm`.
"""


@dataclass(frozen=True, eq=False)
class Term:
    """A function of a few unknowns x and parameters p, with first and second derivatives.

    Attributes
    ----------
    unknowns, parameters : number of unknowns and parameters.
    value : the term f of the objective and the constraints g (m,).
    gradient : the gradient of f.
    jacobian, rows, cols : the structural nonzeros of dg/dx, and their positions.
    hessian, upper_rows, upper_cols : the structural nonzeros of the upper half of the second derivative of w f + l.g,
        and their positions.
    equality : whether the constraints are g = 0, instead of g >= 0.
    family : index into ELASTIC of each constraint; -1 for none.
    """

    unknowns: int
    parameters: int
    value: ca.Function
    gradient: ca.Function
    jacobian: ca.Function
    rows: Indices
    cols: Indices
    hessian: ca.Function
    upper_rows: Indices
    upper_cols: Indices
    equality: bool
    family: Indices


class TermBuilder:
    """Collects the unknowns, parameters, constraints and objective of a term."""

    def __init__(self) -> None:
        self._unknowns: list[Expression] = []
        self._parameters: list[Expression] = []
        self._constraints: list[Expression] = []
        self._family: list[int] = []
        self._objective: Expression = ca.SX(0.0)

    def unknown(self, size: int) -> Expression:
        """Add a column of unknowns."""
        self._unknowns.append(ca.SX.sym(f"x{len(self._unknowns)}", size))
        return self._unknowns[-1]

    def parameter(self, size: int = 1) -> Expression:
        """Add a column of parameters, whose values are given with each use of the term."""
        self._parameters.append(ca.SX.sym(f"p{len(self._parameters)}", size))
        return self._parameters[-1]

    def require(self, expression: Expression, family: str | None = None) -> None:
        """Require that an expression of any shape is at least 0, or equals 0 in a term built for equality.

        A search for feasibility may violate the constraints of an elastic family.
        """
        column = ca.vec(ca.SX(expression))
        self._constraints.append(column)
        self._family += [ELASTIC.index(family) if family else -1] * column.numel()

    def minimise(self, expression: Expression) -> None:
        """Add a scalar expression to the objective."""
        self._objective += expression

    def built(self, *, equality: bool = False) -> Term:
        """Build the term with its derivatives."""
        x, p = ca.vertcat(*self._unknowns), ca.vertcat(ca.SX(0, 1), *self._parameters)
        f, g = self._objective, ca.vertcat(ca.SX(0, 1), *self._constraints)
        jacobian: Expression = ca.jacobian(g, x)
        weight, multipliers = ca.SX.sym("w"), ca.SX.sym("l", g.numel())
        hessian: Expression = ca.triu(ca.hessian(weight * f + ca.dot(multipliers, g), x)[0])
        rows, cols = jacobian.sparsity().get_triplet()
        upper_rows, upper_cols = hessian.sparsity().get_triplet()
        return Term(
            unknowns=x.numel(),
            parameters=p.numel(),
            value=ca.Function("value", [x, p], [f, g]),
            gradient=ca.Function("gradient", [x, p], [ca.densify(ca.gradient(f, x))]),
            jacobian=ca.Function("jacobian", [x, p], [_nonzeros(jacobian)]),
            rows=np.array(rows, dtype=np.int64),
            cols=np.array(cols, dtype=np.int64),
            hessian=ca.Function("hessian", [x, p, weight, multipliers], [_nonzeros(hessian)]),
            upper_rows=np.array(upper_rows, dtype=np.int64),
            upper_cols=np.array(upper_cols, dtype=np.int64),
            equality=equality,
            family=np.array(self._family, dtype=np.int64),
        )


def _nonzeros(matrix: Expression) -> Expression:
    """The structural nonzeros of an SX matrix as a dense column, in the order of its triplets."""
    return ca.SX(ca.Sparsity.dense(matrix.nnz(), 1), matrix.nz[:]) if matrix.nnz() else ca.SX(0, 1)
