"""A nonlinear program: unknowns with bounds, constraints by family, and how IPOPT is asked to solve it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from optics.values import FloatArray

Expression = Any
"""A CasADi SX matrix; CasADi ships no types."""

ELASTIC = ("spacing", "occlusion", "depth", "overlap")
"""Families whose constraints a search for feasibility may miss, each by one slack that it drives to zero."""

LARGEST_SLACK = 10.0

HOLD = 1e-5
"""Weight of the squared distance from the start: unknowns that nothing else decides, such as planes between mirrors
far apart, stay where they were; IPOPT converges faster when no direction is free."""

IPOPT: dict[str, Any] = {
    "expand": True,
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.acceptable_tol": 1e-6,
    "ipopt.mu_strategy": "adaptive",
    "ipopt.max_iter": 400,
}


class Program:
    """Unknowns and constraints as they are collected; all lengths in units of the design's scale."""

    def __init__(self) -> None:
        self.slack: dict[str, Expression] = {family: ca.SX.sym(f"slack_{family}") for family in ELASTIC}
        self._symbols: list[Expression] = list(self.slack.values())
        self._start: list[float] = [0.0] * len(ELASTIC)
        self._low: list[float] = [0.0] * len(ELASTIC)
        self._high: list[float] = [0.0] * len(ELASTIC)
        self._at_least: list[Expression] = []
        self._zero: list[Expression] = []

    def unknown(self, start: ArrayLike, low: ArrayLike = -np.inf, high: ArrayLike = np.inf) -> Expression:
        """A new column vector of unknowns, started at `start` (n,) and kept between `low` and `high`."""
        values = np.atleast_1d(np.asarray(start, dtype=np.float64))
        symbol = ca.SX.sym(f"x{len(self._symbols)}", values.size)
        self._symbols.append(symbol)
        self._start.extend(values)
        self._low.extend(np.broadcast_to(np.asarray(low, dtype=np.float64), values.shape))
        self._high.extend(np.broadcast_to(np.asarray(high, dtype=np.float64), values.shape))
        return symbol

    def require(self, expression: Expression, family: str | None = None) -> None:
        """The expression (any shape) must be at least 0; one of an elastic family may be missed in a search."""
        column = ca.vec(expression)
        self._at_least.append(column + self.slack[family] if family else column)

    def require_zero(self, expression: Expression) -> None:
        """The expression (any shape) must be 0."""
        self._zero.append(ca.vec(expression))

    @property
    def start(self) -> FloatArray:
        """Where all unknowns start."""
        return np.array(self._start)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest values of all unknowns."""
        return np.array(self._low), np.array(self._high)

    @property
    def constraints(self) -> Expression:
        """All constraints, one column: first those that must be at least 0, then those that must be 0."""
        return ca.vertcat(*self._at_least, *self._zero)

    @property
    def upper_limits(self) -> FloatArray:
        """Greatest values of `constraints`; the least are 0."""
        return np.repeat([np.inf, 0.0], [sum(part.numel() for part in parts) for parts in (self._at_least, self._zero)])

    @property
    def unknowns(self) -> Expression:
        """All unknowns, one column."""
        return ca.vertcat(*self._symbols)


@dataclass(frozen=True)
class Outcome:
    """Where IPOPT stopped: values of all unknowns (n,), its own word for it, and whether that is an optimum."""

    values: FloatArray
    status: str
    solved: bool
    iterations: int


class Solver:
    """IPOPT over a program, with exact first and second derivatives.

    The same program answers two questions. `optimise` minimises the objective with every constraint held;
    `find_feasible` minimises by how much the elastic families are missed, and stays near the start otherwise.
    """

    def __init__(self, program: Program, objective: Expression, slack_weights: dict[str, float]) -> None:
        unknowns = program.unknowns
        self._start, self._bounds, self._upper_limits = program.start, program.bounds, program.upper_limits
        missed = sum(slack_weights[family] * slack for family, slack in program.slack.items())
        nearby = ca.sumsqr(unknowns[len(ELASTIC) :] - ca.DM(self._start[len(ELASTIC) :]))
        searching = ca.SX.sym("searching")
        self._nlp = ca.nlpsol(
            "design",
            "ipopt",
            {
                "x": unknowns,
                "p": searching,
                "f": (1 - searching) * objective + searching * missed + HOLD * nearby,
                "g": program.constraints,
            },
            IPOPT,
        )
        self._slacks = ca.Function("slacks", [unknowns], [ca.vertcat(*program.slack.values())])

    def _solve(self, start: FloatArray, slack_limit: float, searching: float) -> Outcome:
        low, high = (bound.copy() for bound in self._bounds)
        high[: len(ELASTIC)] = slack_limit
        result = self._nlp(
            x0=start,
            lbx=low,
            ubx=high,
            p=searching,
            lbg=np.zeros_like(self._upper_limits),
            ubg=self._upper_limits,
        )
        stats = self._nlp.stats()
        return Outcome(
            values=np.array(result["x"]).ravel(),
            status=stats["return_status"],
            solved=bool(stats["success"]),
            iterations=int(stats["iter_count"]),
        )

    def optimise(self, start: FloatArray | None = None) -> Outcome:
        """The best values with all constraints held, from the program's own start or, as far as it goes, `start`."""
        first = self._start.copy()
        if start is not None:
            first[: len(start)] = start
        return self._solve(first, 0.0, 0.0)

    def find_feasible(self) -> tuple[Outcome, dict[str, float]]:
        """The values that miss the elastic families least, and by how much each family is missed."""
        start = self._start.copy()
        start[: len(ELASTIC)] = 0.1
        outcome = self._solve(start, LARGEST_SLACK, 1.0)
        missed = np.array(self._slacks(outcome.values)).ravel()
        return outcome, dict(zip(ELASTIC, missed.tolist(), strict=True))
