"""Speed of the optimiser: `python -m benchmarks.design [--skip-peers] [--cap SECONDS]`.

Times `design` without imports: the default 3x3 and 5x5, repeatedly in this process and in two, and once cold in a fresh
one; its growth with the mirror count; and the same program (objective, constraints, bounds, start, exact derivatives)
solved by IPOPT and by SciPy's SLSQP and trust-constr, in the same run, until these are within 1 % of IPOPT's objective
with no constraint violated by more than 1e-6, or until the time limit.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.design_peers import ScipyProblem, first_problem, peers, seconds_of
from benchmarks.records import TIMES, Rows, Table, add_json_option, write_record
from mirrorcam.core.processes.worker_pool import in_two_processes
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign

LIMITS_S = {(3, 3): 2.0, (5, 5): 10.0}
RUNS = {(3, 3): 9, (5, 5): 5}
GROWTH = ((1, 2), (2, 2), (2, 3), (3, 3), (3, 5), (4, 4), (5, 5), (6, 6), (7, 7))
GROWTH_RUNS = 3

COLD = """
import sys, time
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
spec = DesignSpec(rows=int(sys.argv[1]), cols=int(sys.argv[2]))
started = time.perf_counter()
design(spec)
print(time.perf_counter() - started)
"""


def cold_s(rows: int, cols: int) -> float:
    """Return the time of the first design in a fresh process, without imports."""
    command = [sys.executable, "-c", COLD, str(rows), str(cols)]
    root = Path(__file__).parents[1]
    return float(subprocess.run(command, check=True, capture_output=True, text=True, cwd=root).stdout)


def speed() -> Table:
    """Print the times; return the table for one process."""
    rows = Rows("one process", "median", "fastest", "slowest", "first in a fresh process", "limit")
    with in_two_processes(["mirrorcam.optics.design.optimise"]) as calls:
        for count, limit_s in LIMITS_S.items():
            spec = DesignSpec(rows=count[0], cols=count[1])
            times = [seconds_of(partial(design, spec)) for _ in range(RUNS[count])]
            seconds = (statistics.median(times), min(times), max(times), cold_s(*count))
            figures = (f"{value:.{2 if value < 4.0 else 1}f} s" for value in seconds)
            rows.add(f"{count[0]} {TIMES} {count[1]}, {len(times)} runs", *figures, f"{limit_s:g} s")
            design(spec, calls=calls)
            times = [seconds_of(partial(design, spec, calls=calls)) for _ in range(RUNS[count])]
            print(f"in two processes: {statistics.median(times):.2f} s, {min(times):.2f} to {max(times):.2f} s")
    return rows.table


def growth() -> tuple[float, dict[str, float]]:
    """Print times and sizes against the mirror count.

    Returns the power of the count with which times grow, and figures for 2 and 36 mirrors.
    """
    print(f"\n{'count':6} {'unknowns':>8} {'constraints':>11} {'median s':>8}  of {GROWTH_RUNS} runs")
    mirrors, times, sizes = [], [], []
    for rows, cols in GROWTH:
        spec = DesignSpec(rows=rows, cols=cols)
        program = ScipyProblem(spec, first_problem(spec))
        try:
            runs = [seconds_of(partial(design, spec)) for _ in range(GROWTH_RUNS)]
        except InfeasibleDesign as error:
            print(
                f"{rows}x{cols}    {len(program.free):8} {len(program.equal):11}  infeasible: {error}",
                flush=True,
            )
            continue
        mirrors.append(rows * cols)
        times.append(runs)
        sizes.append((len(program.free), len(program.equal)))
        print(f"{rows}x{cols}    {sizes[-1][0]:8} {sizes[-1][1]:11} {statistics.median(runs):8.2f}", flush=True)
    medians = [statistics.median(runs) for runs in times]
    power = float(np.polyfit(np.log(mirrors), np.log(medians), 1)[0])
    print(f"time grows like mirrors^{power:.2f}")
    two, many = mirrors.index(2), mirrors.index(36)
    figures = {"two_mirrors_s": medians[two], "thirty_six_mirrors_s": medians[many]}
    return power, figures | dict(zip(("thirty_six_unknowns", "thirty_six_constraints"), sizes[many], strict=True))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--skip-peers", action="store_true", help="omit SciPy's solvers")
    parser.add_argument("--only-peers", action="store_true", help="run only SciPy's solvers")
    parser.add_argument("--cap", type=float, default=90.0, help="seconds after which a peer is stopped")
    add_json_option(parser)
    arguments = parser.parse_args()
    if not arguments.only_peers:
        times = speed()
        power, figures = growth()
        write_record(arguments.json, "design_speed", {"growth_power": power}, times)
        write_record(arguments.json, "design_growth", figures)
    if not arguments.skip_peers:
        write_record(arguments.json, "design_peers", table=peers(arguments.cap))
