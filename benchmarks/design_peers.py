"""The program that `design` hands to IPOPT, handed to SciPy's SLSQP and trust-constr; part of `benchmarks.design`."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import scipy.optimize
import scipy.sparse
from numpy.typing import NDArray

from benchmarks.records import TIMES, Table, table
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.design_problem import Problem, overlap_problem
from mirrorcam.optics.design.program.seeds import seed_of
from mirrorcam.optics.design.program.separation import neighbour_pairs
from mirrorcam.optics.geometry.design_spec import DesignSpec

PEER_COUNTS = ((1, 2), (2, 2), (3, 3))
PEERS = ("SLSQP", "trust-constr")
NEAR, HELD = 0.01, 1e-6
ASKED_RATIO = 10.0


def seconds_of(action: Callable[[], Any]) -> float:
    started = time.perf_counter()
    action()
    return time.perf_counter() - started


def first_problem(spec: DesignSpec) -> Problem:
    """The first program that `design` solves."""
    working_mm = len(spec.depths_mm) / sum(1.0 / depth for depth in spec.depths_mm)
    return overlap_problem(spec, seed_of(spec, working_mm), neighbour_pairs(spec.arrangement))


class Question:
    """A problem as SciPy takes it: f and g (at least 0, or 0) with exact derivatives, bounds and start.

    Without the slacks, which are zero when a design is optimised, and with equalities apart. `objective` adds what the
    program leaves out, so that 0 is a perfect design.
    """

    def __init__(self, spec: DesignSpec, problem: Problem) -> None:
        solver = problem.solver
        low, high = solver.program.bounds
        self.kept = np.flatnonzero(high > low)
        self.fixed = solver.program.start
        self.start, self.low, self.high = self.fixed[self.kept], low[self.kept], high[self.kept]
        self._functions = solver.derivatives
        self._rest = 1.0 - spec.tradeoff
        self.equal = np.concatenate(
            [np.full(len(places) * term.family.size, term.equality) for term, places, _ in solver.program.uses]
        )
        sparsity = self._functions["hess_lag"].sparsity_out(0)
        rows, cols = (np.array(part) for part in sparsity.get_triplet())
        self._hessian_places = rows, cols

    def whole(self, x: FloatArray) -> FloatArray:
        values = self.fixed.copy()
        values[self.kept] = x
        return values

    def value(self, x: FloatArray) -> float:
        return float(self._functions["grad_f"](self.whole(x), 0.0)[0]) + self._rest

    def gradient(self, x: FloatArray) -> FloatArray:
        return np.array(self._functions["grad_f"](self.whole(x), 0.0)[1]).ravel()[self.kept]

    def constraints(self, x: FloatArray) -> FloatArray:
        return np.array(self._functions["jac_g"](self.whole(x), 0.0)[0]).ravel()

    def jacobian(self, x: FloatArray) -> Any:
        return scipy.sparse.csr_matrix(self._functions["jac_g"](self.whole(x), 0.0)[1].sparse())[:, self.kept]

    def hessian(self, x: FloatArray, weight: float, multipliers: FloatArray) -> Any:
        upper = self._functions["hess_lag"](self.whole(x), 0.0, weight, multipliers)
        half = scipy.sparse.csr_matrix(upper.sparse())[self.kept][:, self.kept]
        return half + scipy.sparse.triu(half, 1).T

    def missed(self, x: FloatArray) -> float:
        """The largest violation of a constraint or bound."""
        g = self.constraints(x)
        found = [0.0, (-g[~self.equal]).max(initial=0.0), np.abs(g[self.equal]).max(initial=0.0)]
        return float(max(*found, (self.low - x).max(), (x - self.high).max()))


@dataclass(frozen=True)
class Trace:
    """The result of a solver: seconds, objective and worst miss of its iterates, and how it ended."""

    seconds: tuple[float, ...]
    objectives: tuple[float, ...]
    missed: tuple[float, ...]
    ending: str

    def reached_s(self, objective: float) -> float | None:
        """Time at which an iterate was first near an objective with every constraint held."""
        for second, value, miss in zip(self.seconds, self.objectives, self.missed, strict=True):
            if miss <= HELD and value <= objective * (1.0 + NEAR):
                return second
        return None


def _for_slsqp(question: Question) -> dict[str, Any]:
    rows = []
    for kind, mask in (("eq", question.equal), ("ineq", ~question.equal)):

        def values(x: FloatArray, mask: NDArray[np.bool_] = mask) -> FloatArray:
            return question.constraints(x)[mask]

        def slopes(x: FloatArray, mask: NDArray[np.bool_] = mask) -> FloatArray:
            return question.jacobian(x)[mask].toarray()

        rows.append({"type": kind, "fun": values, "jac": slopes})
    return {"constraints": rows, "options": {"maxiter": 10000, "ftol": 1e-9}}


def _for_trust_constr(question: Question) -> dict[str, Any]:
    none = np.zeros(len(question.equal))

    def bent(x: FloatArray, multipliers: FloatArray) -> Any:
        return question.hessian(x, 0.0, multipliers)

    limit = scipy.optimize.NonlinearConstraint(
        question.constraints, 0.0, np.where(question.equal, 0.0, np.inf), jac=question.jacobian, hess=bent
    )
    options = {"maxiter": 100000, "gtol": 1e-8, "xtol": 1e-10, "sparse_jacobian": True}
    return {"constraints": limit, "hess": lambda x: question.hessian(x, 1.0, none), "options": options}


def _peer(count: tuple[int, int], method: str, out: Connection) -> None:
    spec = DesignSpec(rows=count[0], cols=count[1])
    question = Question(spec, first_problem(spec))
    started, spent = time.perf_counter(), 0.0

    def note(x: FloatArray, *_: Any) -> None:
        nonlocal spent
        stopped = time.perf_counter()
        out.send((stopped - started - spent, question.value(x), question.missed(x)))
        spent += time.perf_counter() - stopped  # reporting is not solving

    question.constraints(question.start), question.jacobian(question.start)
    out.send("ready")
    started = time.perf_counter()
    asked = _for_slsqp(question) if method == "SLSQP" else _for_trust_constr(question)
    found = scipy.optimize.minimize(
        question.value,
        question.start,
        jac=question.gradient,
        method=method,
        bounds=scipy.optimize.Bounds(question.low, question.high),
        callback=note,
        **asked,
    )
    note(found.x)
    out.send(str(found.message))


def peer_trace(count: tuple[int, int], method: str, cap_s: float) -> Trace:
    """The result of a SciPy solver in a separate process, stopped after `cap_s` of wall time."""
    context = get_context("spawn")
    receiving, sending = context.Pipe(duplex=False)
    process = context.Process(target=_peer, args=(count, method, sending))
    process.start()
    sending.close()
    found: list[tuple[float, float, float]] = []
    ending, ends = f"stopped after {cap_s:g} s", np.inf
    try:
        while receiving.poll(max(0.0, ends - time.perf_counter()) if np.isfinite(ends) else None):
            message = receiving.recv()
            if message == "ready":
                ends = time.perf_counter() + cap_s
            elif isinstance(message, str):
                ending = message
                break
            else:
                found.append(message)
    except EOFError:
        ending = "died"
    process.terminate()
    process.join()
    seconds, objectives, missed = zip(*found, strict=True) if found else ((), (), ())
    return Trace(seconds, objectives, missed, ending)


def peers(cap_s: float) -> Table:
    """Print what SciPy's solvers reach on the same programs; seconds and their ratio to those of IPOPT."""
    rows = []
    print(f"\nthe same program, SciPy {version('scipy')}; near: within {NEAR:.0%} of IPOPT, none missed by {HELD:g}")
    head = (
        f"{'count':6} {'solver':13} {'s until near':>12} {'ratio':>8} {'objective':>10} {'missed':>8} {'iterates':>8}"
    )
    print(head + "  ending", flush=True)
    for count in PEER_COUNTS:
        spec = DesignSpec(rows=count[0], cols=count[1])
        problem = first_problem(spec)
        question = Question(spec, problem)
        times = [seconds_of(problem.solver.optimise) for _ in range(5)]
        outcome, ipopt_s = problem.solver.optimise(), statistics.median(times)
        x = outcome.values[question.kept]
        name, best = f"{count[0]}x{count[1]}", question.value(x)
        tail = f"{best:10.5f} {question.missed(x):8.1e} {outcome.iterations:8}  {outcome.status}"
        print(f"{name:6} {'IPOPT':13} {ipopt_s:12.3f} {1.0:8.1f} {tail}", flush=True)
        cells = [f"{count[0]} {TIMES} {count[1]}, {len(question.kept)} unknowns", f"{ipopt_s:.2f} s"]
        for method in PEERS:
            trace = peer_trace(count, method, cap_s)
            reached = trace.reached_s(best)
            # One that never came near has taken at least the time until it ended.
            least_s = reached if reached is not None else max(trace.seconds[-1:], default=cap_s)
            if reached is None and trace.ending.startswith("stopped"):
                least_s = cap_s
            taken = f"{least_s:.2f}" if reached is not None else f"never ({least_s:.0f})"
            sign = "" if reached is not None else ">"
            last = f"{trace.objectives[-1]:10.5f} {trace.missed[-1]:8.1e}" if trace.seconds else f"{'none':>10} {'':8}"
            line = f"{taken:>12} {sign + format(least_s / ipopt_s, '.1f'):>8} {last} {len(trace.seconds):8}"
            print(f"{name:6} {method:13} {line}  {trace.ending}", flush=True)
            ratio = least_s / ipopt_s
            never = f"not within {least_s:.0f} s, more than {ratio:.0f}"
            cells.append(never if reached is None else f"{reached:.{2 if reached < 1.0 else 1}f} s, {ratio:.1f}")
        rows.append(cells)
    print(f"asked: a ratio of at least {ASKED_RATIO:g}")
    return table(("", "IPOPT", *PEERS), rows)
