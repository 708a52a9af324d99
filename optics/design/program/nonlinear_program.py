"""A nonlinear program composed of terms, and its solution by IPOPT."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass
from io import StringIO
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.core.processes import interruption
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.terms import ELASTIC, Expression, Indices, Term

MAX_SLACK = 10.0

ANCHOR_WEIGHT = 1e-5
"""Weight of the squared distance from the start. It determines otherwise free unknowns, such as planes
between distant mirrors; IPOPT converges faster if no direction is free."""

MAX_ITERATIONS = 300
TOLERANCE = 1e-8
"""Largest scaled error of the optimality conditions at an optimum."""

IPOPT: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "calc_lam_p": False,
    "no_nlp_grad": True,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_pivot_order": 2,
    "ipopt.constr_viol_tol": 1e-7,
    "ipopt.acceptable_tol": 1e-6,
    "ipopt.mu_strategy": "adaptive",
    "ipopt.adaptive_mu_globalization": "never-monotone-mode",
}


class Program:
    """Collects unknowns and uses of terms. The first unknowns are the slacks of the elastic families."""

    def __init__(self) -> None:
        self._start: list[FloatArray] = []
        self._low: list[FloatArray] = []
        self._high: list[FloatArray] = []
        self.size = 0
        self._uses: dict[int, tuple[Term, list[Indices], list[FloatArray]]] = {}
        self.unknown(np.zeros(len(ELASTIC)), 0.0, 0.0)

    def unknown(self, start: ArrayLike, low: ArrayLike = -np.inf, high: ArrayLike = np.inf) -> Indices:
        """Add unknowns with start values (n,) and limits; returns their indices (n,)."""
        first = np.atleast_1d(np.asarray(start, dtype=np.float64))
        for column, values in ((self._start, first), (self._low, low), (self._high, high)):
            column.append(np.broadcast_to(np.asarray(values, dtype=np.float64), first.shape))
        self.size += first.size
        return np.arange(self.size - first.size, self.size)

    def add(self, term: Term, unknowns: Sequence[Indices], parameters: Sequence[ArrayLike] = ()) -> None:
        """Add a use of a term with the unknowns at given indices and the values of its parameters.

        Raises ValueError if their number differs from the term's.
        """
        indices = np.concatenate([np.ravel(part) for part in unknowns])
        numbers = np.concatenate([np.zeros(0), *(np.ravel(np.asarray(part, dtype=np.float64)) for part in parameters)])
        if indices.size != term.unknowns or numbers.size != term.parameters:
            raise ValueError(
                f"{indices.size} unknowns and {numbers.size} parameters, expected {term.unknowns} and {term.parameters}"
            )
        _, indices_of_uses, values_of_uses = self._uses.setdefault(id(term), (term, [], []))
        indices_of_uses.append(indices)
        values_of_uses.append(numbers)

    @property
    def uses(self) -> list[tuple[Term, Indices, FloatArray]]:
        """Each term with the indices of its unknowns (k, n) and its parameters (k, p) in its k uses."""
        return [(term, np.array(indices), np.array(numbers)) for term, indices, numbers in self._uses.values()]

    @property
    def start(self) -> FloatArray:
        """Start values of all unknowns."""
        return np.concatenate(self._start)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Minimum and maximum of all unknowns."""
        return np.concatenate(self._low), np.concatenate(self._high)


@dataclass(frozen=True)
class SolverOutcome:
    """Result of IPOPT.

    Attributes
    ----------
    values : values (n,) of all unknowns.
    objective : objective of the solved problem: the design's, or the violation in a search for feasibility.
    status : IPOPT's return status.
    solved : whether this is an optimum.
    iterations : number of iterations.
    """

    values: FloatArray
    objective: float
    status: str
    solved: bool
    iterations: int


class Assembled:
    """Objective, constraints and derivatives of a program in CasADi's MX, assembled from its terms."""

    def __init__(self, program: Program) -> None:
        self.uses = program.uses
        self.x = ca.MX.sym("x", program.size)
        self._size = program.size
        self._inputs = [
            (ca.reshape(self.x[indices.ravel().tolist()], term.unknowns, len(indices)), ca.DM(numbers.T))
            for term, indices, numbers in self.uses
        ]
        counts = [len(indices) * term.family.size for term, indices, _ in self.uses]
        self._offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self.family = np.concatenate([np.tile(term.family, len(indices)) for term, indices, _ in self.uses])
        self.equality = np.repeat([term.equality for term, _, _ in self.uses], counts)
        self._elastic = np.flatnonzero(self.family >= 0)
        self._start = program.start

    def _mapped(self, function: ca.Function, k: int, *more: Expression) -> list[Expression]:
        x, p = self._inputs[k]
        return list(function.map(x.shape[1]).call([x, p, *more]))

    def objective_and_constraints(self) -> tuple[Expression, Expression]:
        """The design's objective f, and the constraints g (m,) including slacks."""
        f: Expression = ca.MX(0.0)
        g: list[Expression] = []
        for k, (term, _, _) in enumerate(self.uses):
            values, constraints = self._mapped(term.value, k)
            f += ca.sum2(values)
            g.append(ca.vec(constraints))
        rows, cols = self._elastic, self.family[self._elastic]
        slack = ca.Sparsity.triplet(int(self._offsets[-1]), len(ELASTIC), rows.tolist(), cols.tolist())
        return f, ca.vertcat(*g) + ca.mtimes(ca.DM(slack, 1.0), self.x[: len(ELASTIC)])

    def squared_distance(self) -> Expression:
        """Squared distance of all unknowns except the slacks from the start."""
        return ca.sumsqr(self.x[len(ELASTIC) :] - ca.DM(self._start[len(ELASTIC) :]))

    def gradient(self) -> Expression:
        """Gradient (n) of the design's objective."""
        total = ca.MX(self._size, 1)
        for k, (term, indices, _) in enumerate(self.uses):
            (parts,) = self._mapped(term.gradient, k)
            scatter = ca.Sparsity.triplet(self._size, indices.size, indices.ravel().tolist(), list(range(indices.size)))
            total += ca.mtimes(ca.DM(scatter, 1.0), ca.vec(parts))
        return total

    def jacobian(self) -> Expression:
        """dg/dx (m, n)."""
        rows, cols = [self._elastic], [self.family[self._elastic]]
        values: list[Expression] = [ca.MX(ca.DM.ones(self._elastic.size))]
        for k, (term, indices, _) in enumerate(self.uses):
            (parts,) = self._mapped(term.jacobian, k)
            first = self._offsets[k] + np.arange(len(indices)) * term.family.size
            rows.append((first[:, None] + term.rows).ravel())
            cols.append(indices[:, term.cols].ravel())
            values.append(ca.vec(parts))
        return _summed((int(self._offsets[-1]), self._size), rows, cols, values)

    def hessian(self, weight: Expression, anchor: Expression, multipliers: Expression) -> Expression:
        """Upper half of the second derivative (n, n) of weight * f + anchor * squared distance + multipliers . g."""
        free = np.arange(len(ELASTIC), self._size)
        rows, cols = [free], [free]
        values: list[Expression] = [2.0 * anchor * ca.MX(ca.DM.ones(free.size))]
        for k, (term, indices, _) in enumerate(self.uses):
            term_multipliers = multipliers[int(self._offsets[k]) : int(self._offsets[k + 1])]
            per_use = ca.reshape(term_multipliers, term.family.size, len(indices))
            (parts,) = self._mapped(term.hessian, k, ca.repmat(weight, 1, len(indices)), per_use)
            i, j = indices[:, term.upper_rows].ravel(), indices[:, term.upper_cols].ravel()
            rows.append(np.minimum(i, j))
            cols.append(np.maximum(i, j))
            values.append(ca.vec(parts))
        return _summed((self._size, self._size), rows, cols, values)


def _summed(shape: tuple[int, int], rows: list[Indices], cols: list[Indices], values: list[Expression]) -> Expression:
    """A sparse MX matrix with entries at (rows, cols); entries at the same position are added."""
    i, j = np.concatenate(rows), np.concatenate(cols)
    indices, position = np.unique(j * shape[0] + i, return_inverse=True)
    sparsity = ca.Sparsity.triplet(*shape, (indices % shape[0]).tolist(), (indices // shape[0]).tolist())
    add = ca.Sparsity.triplet(indices.size, i.size, position.tolist(), list(range(i.size)))
    return ca.MX(sparsity, ca.mtimes(ca.DM(add, 1.0), ca.vertcat(*values)))


class Solver:
    """IPOPT for a program, with exact first and second derivatives.

    `optimise` minimises the objective subject to all constraints. `find_feasible` minimises the violation of the
    elastic families and otherwise stays near the start. `find_relaxed` combines both.
    """

    def __init__(
        self,
        program: Program,
        slack_weights: dict[str, float],
        max_iterations: int = MAX_ITERATIONS,
        tolerance: float = TOLERANCE,
    ) -> None:
        self.program = program
        assembled = Assembled(program)
        x, searching = assembled.x, ca.MX.sym("searching")
        f, g = assembled.objective_and_constraints()
        weights = ca.DM([slack_weights[family] for family in ELASTIC])
        violation = ca.dot(weights, x[: len(ELASTIC)])
        objective = (1.0 - searching) * f + searching * violation + ANCHOR_WEIGHT * assembled.squared_distance()
        extra_gradient = ca.vertcat(
            searching * weights, 2.0 * ANCHOR_WEIGHT * (x - ca.DM(program.start))[len(ELASTIC) :]
        )
        weight, multipliers = ca.MX.sym("w"), ca.MX.sym("l", g.numel())
        hessian = assembled.hessian(weight * (1.0 - searching), weight * ANCHOR_WEIGHT, multipliers)
        gradient, jacobian = (1.0 - searching) * assembled.gradient() + extra_gradient, assembled.jacobian()
        self._upper_limits = np.where(assembled.equality, 0.0, np.inf)
        names = {"x": x, "p": searching, "f": objective, "g": g}
        self.derivatives = {
            "grad_f": ca.Function("nlp_grad_f", [x, searching], [objective, gradient], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", [x, searching], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l",
                [x, searching, weight, multipliers],
                [hessian],
                ["x", "p", "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
            ),
        }
        limits = {"ipopt.max_iter": max_iterations, "ipopt.tol": tolerance}
        self._nlp = ca.nlpsol("design", "ipopt", names, IPOPT | self.derivatives | limits)

    def _solve(
        self,
        start: FloatArray,
        slack: tuple[float, float],
        searching: float,
        margin: float = 0.0,
        fixed: tuple[Indices, FloatArray] | None = None,
    ) -> SolverOutcome:
        low, high = (bound.copy() for bound in self.program.bounds)
        if fixed is not None:
            low[fixed[0]] = high[fixed[0]] = fixed[1]
        first = start.copy()
        low[: len(ELASTIC)] = -margin
        first[: len(ELASTIC)], high[: len(ELASTIC)] = slack
        with redirect_stderr(StringIO()) as errors_printed:
            result = self._nlp(
                x0=first, lbx=low, ubx=high, p=searching, lbg=np.zeros_like(self._upper_limits), ubg=self._upper_limits
            )
        interruption.check()  # on an interruption, CasADi only warns and returns
        sys.stderr.write(errors_printed.getvalue())
        stats = self._nlp.stats()
        return SolverOutcome(
            values=np.array(result["x"]).ravel(),
            objective=float(result["f"]),
            status=stats["return_status"],
            solved=bool(stats["success"]),
            iterations=int(stats["iter_count"]),
        )

    def optimise(
        self, start: FloatArray | None = None, fixed: tuple[Indices, FloatArray] | None = None
    ) -> SolverOutcome:
        """The optimum near the program's start values, the first of which `start` replaces.

        `fixed` gives unknowns by their indices and the values that they keep.
        """
        first = self.program.start
        if start is not None:
            first[: len(start)] = start
        return self._solve(first, (0.0, 0.0), 0.0, fixed=fixed)

    def find_feasible(self, start: FloatArray | None = None) -> tuple[SolverOutcome, dict[str, float]]:
        """The values with the smallest violation of the elastic families, and the violation of each family."""
        outcome = self._solve(self.program.start if start is None else start, (0.1, MAX_SLACK), 1.0)
        return outcome, dict(zip(ELASTIC, outcome.values[: len(ELASTIC)].tolist(), strict=True))

    def find_relaxed(self, margin: float) -> tuple[SolverOutcome, dict[str, float]]:
        """The smallest objective with the smallest violation of the elastic families, and the violation of each family.

        The violation takes precedence as long as it costs more than the objective gains. A family that can be met is
        met with the margin: its violation is then -margin.
        """
        outcome = self._solve(self.program.start, (0.1, MAX_SLACK), 0.5, margin)
        return outcome, dict(zip(ELASTIC, outcome.values[: len(ELASTIC)].tolist(), strict=True))
