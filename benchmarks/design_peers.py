"""The program that `design` solves with IPOPT, for SciPy's SLSQP and trust-constr; part of `benchmarks.design`."""

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
NEAR, FEASIBLE = 0.01, 1e-6
MIN_RATIO = 10.0


def seconds_of(action: Callable[[], Any]) -> float:
    start_s = time.perf_counter()
    action()
    return time.perf_counter() - start_s


def first_problem(spec: DesignSpec) -> Problem:
    """Return the first program that `design` solves."""
    working_mm = len(spec.depths_mm) / sum(1.0 / depth for depth in spec.depths_mm)
    return overlap_problem(spec, seed_of(spec, working_mm), neighbour_pairs(spec.arrangement))


class ScipyProblem:
    """A problem in SciPy's form: f, and g (at least 0, or 0), with exact derivatives, bounds and start.

    It omits the slacks, which are zero when a design is optimised, and separates equalities. `value` adds the constant
    that the program omits, so that 0 is a perfect design.
    """

    def __init__(self, spec: DesignSpec, problem: Problem) -> None:
        solver = problem.solver
        low, high = solver.program.bounds
        self.free = np.flatnonzero(high > low)
        self.fixed = solver.program.start
        self.start, self.low, self.high = self.fixed[self.free], low[self.free], high[self.free]
        self._functions = solver.derivatives
        self._offset = 1.0 - spec.tradeoff
        self.equal = np.concatenate(
            [np.full(len(indices) * term.family.size, term.equality) for term, indices, _ in solver.program.uses]
        )
        sparsity = self._functions["hess_lag"].sparsity_out(0)
        rows, cols = (np.array(indices) for indices in sparsity.get_triplet())
        self._hessian_indices = rows, cols

    def expanded(self, x: FloatArray) -> FloatArray:
        values = self.fixed.copy()
        values[self.free] = x
        return values

    def value(self, x: FloatArray) -> float:
        return float(self._functions["grad_f"](self.expanded(x), 0.0)[0]) + self._offset

    def gradient(self, x: FloatArray) -> FloatArray:
        return np.array(self._functions["grad_f"](self.expanded(x), 0.0)[1]).ravel()[self.free]

    def constraints(self, x: FloatArray) -> FloatArray:
        return np.array(self._functions["jac_g"](self.expanded(x), 0.0)[0]).ravel()

    def jacobian(self, x: FloatArray) -> Any:
        return scipy.sparse.csr_matrix(self._functions["jac_g"](self.expanded(x), 0.0)[1].sparse())[:, self.free]

    def hessian(self, x: FloatArray, weight: float, multipliers: FloatArray) -> Any:
        upper = self._functions["hess_lag"](self.expanded(x), 0.0, weight, multipliers)
        half = scipy.sparse.csr_matrix(upper.sparse())[self.free][:, self.free]
        return half + scipy.sparse.triu(half, 1).T

    def violation(self, x: FloatArray) -> float:
        """Return the largest violation of a constraint or bound."""
        g = self.constraints(x)
        violations = [0.0, (-g[~self.equal]).max(initial=0.0), np.abs(g[self.equal]).max(initial=0.0)]
        return float(max(*violations, (self.low - x).max(), (x - self.high).max()))


@dataclass(frozen=True)
class SolverRun:
    """The run of a solver: seconds, objective and largest violation at its iterates, and its ending."""

    seconds: tuple[float, ...]
    objectives: tuple[float, ...]
    violations: tuple[float, ...]
    ending: str

    def time_to_s(self, objective: float) -> float | None:
        """Return the time at which an iterate was first close to an objective with every constraint satisfied."""
        for second, value, violation in zip(self.seconds, self.objectives, self.violations, strict=True):
            if violation <= FEASIBLE and value <= objective * (1.0 + NEAR):
                return second
        return None


def _for_slsqp(program: ScipyProblem) -> dict[str, Any]:
    rows = []
    for kind, mask in (("eq", program.equal), ("ineq", ~program.equal)):

        def values(x: FloatArray, mask: NDArray[np.bool_] = mask) -> FloatArray:
            return program.constraints(x)[mask]

        def jacobian(x: FloatArray, mask: NDArray[np.bool_] = mask) -> FloatArray:
            return program.jacobian(x)[mask].toarray()

        rows.append({"type": kind, "fun": values, "jac": jacobian})
    return {"constraints": rows, "options": {"maxiter": 10000, "ftol": 1e-9}}


def _for_trust_constr(program: ScipyProblem) -> dict[str, Any]:
    zeros = np.zeros(len(program.equal))

    def constraint_hessian(x: FloatArray, multipliers: FloatArray) -> Any:
        return program.hessian(x, 0.0, multipliers)

    limit = scipy.optimize.NonlinearConstraint(
        program.constraints,
        0.0,
        np.where(program.equal, 0.0, np.inf),
        jac=program.jacobian,
        hess=constraint_hessian,
    )
    options = {"maxiter": 100000, "gtol": 1e-8, "xtol": 1e-10, "sparse_jacobian": True}
    return {"constraints": limit, "hess": lambda x: program.hessian(x, 1.0, zeros), "options": options}


def _peer(count: tuple[int, int], method: str, out: Connection) -> None:
    spec = DesignSpec(rows=count[0], cols=count[1])
    program = ScipyProblem(spec, first_problem(spec))
    start_s, reporting_s = time.perf_counter(), 0.0

    def note(x: FloatArray, *_: Any) -> None:
        nonlocal reporting_s
        stop_s = time.perf_counter()
        out.send((stop_s - start_s - reporting_s, program.value(x), program.violation(x)))
        reporting_s += time.perf_counter() - stop_s  # not part of solving

    program.constraints(program.start), program.jacobian(program.start)
    out.send("ready")
    start_s = time.perf_counter()
    arguments = _for_slsqp(program) if method == "SLSQP" else _for_trust_constr(program)
    result = scipy.optimize.minimize(
        program.value,
        program.start,
        jac=program.gradient,
        method=method,
        bounds=scipy.optimize.Bounds(program.low, program.high),
        callback=note,
        **arguments,
    )
    note(result.x)
    out.send(str(result.message))


def peer_run(count: tuple[int, int], method: str, cap_s: float) -> SolverRun:
    """Run a SciPy solver in a separate process, stopped after `cap_s` of elapsed time."""
    context = get_context("spawn")
    receiving, sending = context.Pipe(duplex=False)
    process = context.Process(target=_peer, args=(count, method, sending))
    process.start()
    sending.close()
    iterates: list[tuple[float, float, float]] = []
    ending, end_s = f"stopped after {cap_s:g} s", np.inf
    try:
        while receiving.poll(max(0.0, end_s - time.perf_counter()) if np.isfinite(end_s) else None):
            message = receiving.recv()
            if message == "ready":
                end_s = time.perf_counter() + cap_s
            elif isinstance(message, str):
                ending = message
                break
            else:
                iterates.append(message)
    except EOFError:
        ending = "died"
    process.terminate()
    process.join()
    seconds, objectives, violation = zip(*iterates, strict=True) if iterates else ((), (), ())
    return SolverRun(seconds, objectives, violation, ending)


def peers(cap_s: float) -> Table:
    """Print the results of SciPy's solvers on the same programs; return seconds, and their ratios to IPOPT's."""
    rows = []
    print(
        f"\nthe same program, SciPy {version('scipy')}; near: within {NEAR:.0%} of IPOPT, violations up to {FEASIBLE:g}"
    )
    head = (
        f"{'count':6} {'solver':13} {'s until near':>12} {'ratio':>8} {'objective':>10} {'missed':>8} {'iterates':>8}"
    )
    print(head + "  ending", flush=True)
    for count in PEER_COUNTS:
        spec = DesignSpec(rows=count[0], cols=count[1])
        problem = first_problem(spec)
        program = ScipyProblem(spec, problem)
        times = [seconds_of(problem.solver.optimise) for _ in range(5)]
        outcome, ipopt_s = problem.solver.optimise(), statistics.median(times)
        x = outcome.values[program.free]
        name, best = f"{count[0]}x{count[1]}", program.value(x)
        tail = f"{best:10.5f} {program.violation(x):8.1e} {outcome.iterations:8}  {outcome.status}"
        print(f"{name:6} {'IPOPT':13} {ipopt_s:12.3f} {1.0:8.1f} {tail}", flush=True)
        cells = [f"{count[0]} {TIMES} {count[1]}, {len(program.free)} unknowns", f"{ipopt_s:.2f} s"]
        for method in PEERS:
            run = peer_run(count, method, cap_s)
            reached = run.time_to_s(best)
            # A solver that never came near needed at least the time until it ended.
            min_s = reached if reached is not None else max(run.seconds[-1:], default=cap_s)
            if reached is None and run.ending.startswith("stopped"):
                min_s = cap_s
            taken = f"{min_s:.2f}" if reached is not None else f"never ({min_s:.0f})"
            sign = "" if reached is not None else ">"
            last = f"{run.objectives[-1]:10.5f} {run.violations[-1]:8.1e}" if run.seconds else f"{'none':>10} {'':8}"
            line = f"{taken:>12} {sign + format(min_s / ipopt_s, '.1f'):>8} {last} {len(run.seconds):8}"
            print(f"{name:6} {method:13} {line}  {run.ending}", flush=True)
            ratio = min_s / ipopt_s
            never = f"not within {min_s:.0f} s, more than {ratio:.0f}"
            cells.append(never if reached is None else f"{reached:.{2 if reached < 1.0 else 1}f} s, {ratio:.1f}")
        rows.append(cells)
    print(f"required: a ratio of at least {MIN_RATIO:g}")
    return table(("", "IPOPT", *PEERS), rows)
