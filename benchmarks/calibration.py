"""The solver against SciPy and the statistical limit: `python -m benchmarks.calibration [PART ...] [--json FILE]`.

Run it on one thread (`OPENBLAS_NUM_THREADS=1`): the peers gain little from more. Without a PART, all parts:

- speed: 216 parameters and 29,160 residuals, from mirrors with errors of 0.5 deg and 0.5 mm. Our `minimise` (plain
  least squares) and the methods of `scipy.optimize.least_squares`, with the same analytic derivatives and start, in one
  run; then the complete `fit`. Limits: 0.5 s, 10 iterations, 5 times as fast as the fastest peer, the same minimum to 7
  digits.
- limit: errors relative to the Cramer-Rao bound in 1000 trials with Gaussian noise and with outliers, and whether
  the stated covariances are right.
- start: how often a fit converges from errors of 2 deg and 2 mm in each mirror, in 500 draws, and from larger errors.

Exit code 1: a limit is exceeded.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.records import SIGMA, add_json_option, table, write_record
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit, minimise
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Estimate
from tests.optics.calibration.solver.peer import Peer
from tests.optics.calibration.solver.scenes import disturbed, large_scene, small_scene, start_from
from tests.optics.calibration.solver.trials import converges, over_bound, run_trials

ROUNDS = 5
TRIALS = 1000
DRAWS = 500
METHODS: dict[str, dict[str, Any]] = {
    "trf, dense, exact": {"method": "trf", "tr_solver": "exact"},
    "lm (MINPACK), dense": {"method": "lm"},
    "dogbox, dense, exact": {"method": "dogbox", "tr_solver": "exact"},
    "trf, sparse, lsmr": {"method": "trf", "tr_solver": "lsmr"},
}


@dataclass(frozen=True)
class Run:
    """One solution: its duration, number of steps, cost in px^2, and virtual centres (m, 3)."""

    seconds: float
    steps: int
    cost: float
    centres: FloatArray


def _start(seed: int) -> tuple[Estimate, Observations, Model]:
    scene = large_scene()
    observations, _ = scene.noisy(seed)
    mirrors = disturbed(scene.layout, seed, tilt_deg=0.5, offset_mm=0.5)
    return start_from(scene.layout.camera, mirrors, observations, scene.model.board), observations, scene.model


def _peer(peer: Peer, options: dict[str, Any]) -> Run:
    jac: Callable[[FloatArray], Any] = peer.sparse if options.get("tr_solver") == "lsmr" else peer.dense
    start_s = time.perf_counter()
    result = least_squares(
        peer.residuals, peer.x0, jac=jac, x_scale="jac", ftol=1e-9, xtol=1e-12, gtol=1e-12, max_nfev=100, **options
    )
    seconds = time.perf_counter() - start_s
    return Run(
        seconds, result.njev or result.nfev, 2.0 * result.cost, peer.estimate(result.x).virtual_centres_in_rig_mm
    )


def speed(json: Path | None) -> bool:
    """Print the table of times; return whether they are within the limits."""
    start, observations, model = _start(0)
    peer = Peer(start, observations, model)
    print(f"{len(peer.x0)} parameters, {2 * len(observations)} residuals; median of {ROUNDS} rounds, peers once")
    ours = []
    fits = []
    for _ in range(ROUNDS):
        start_s = time.perf_counter()
        estimate, steps = minimise(start, observations, model)
        seconds = time.perf_counter() - start_s
        cost = float(np.sum(peer_residuals(peer, estimate) ** 2))
        ours.append(Run(seconds, steps, cost, estimate.virtual_centres_in_rig_mm))
        start_s = time.perf_counter()
        solution = fit(start, observations, model)
        fits.append(time.perf_counter() - start_s)
    own = sorted(ours, key=lambda run: run.seconds)[ROUNDS // 2]
    fit_s = float(np.median(fits))
    print(f"{'':24}{'s':>8}{'steps':>7}{'ours x':>9}{'cost cost_error':>12}{'centres cost_error, mm':>20}")
    print(f"{'minimise (ours)':24}{own.seconds:8.3f}{own.steps:7d}")
    print(f"{'fit (ours)':24}{fit_s:8.3f}{solution.iterations:7d}   robust start, outliers, covariance")
    fastest, same = np.inf, True
    for name, options in METHODS.items():
        run = _peer(peer, options)
        cost_error = abs(run.cost / own.cost - 1.0)
        centre_error_mm = float(np.abs(run.centres - own.centres).max())
        line = f"{name:24}{run.seconds:8.3f}{run.steps:7d}{run.seconds / own.seconds:9.1f}"
        print(f"{line}{cost_error:12.1e}{centre_error_mm:20.1e}")
        if cost_error < 1e-7:
            fastest = min(fastest, run.seconds)
        same &= run.cost > own.cost * (1.0 - 1e-7)
    figures = {
        "parameters": len(peer.x0),
        "residuals": 2 * len(observations),
        "fit_s": fit_s,
        "steps": solution.iterations,
    }
    write_record(json, "calibration_speed", figures | {"fastest_peer_times": fastest / fit_s})
    good = fit_s <= 0.5 and solution.iterations <= 10 and fastest >= 5.0 * fit_s and same and np.isfinite(fastest)
    print(
        f"fit within 0.5 s and 10 steps, fastest peer {fastest / fit_s:.1f} x as long (>= 5): {'yes' if good else 'NO'}"
    )
    return bool(good)


def peer_residuals(peer: Peer, estimate: Estimate) -> FloatArray:
    """Return the residuals (2 n,) of one of our estimates."""
    return Peer(estimate, peer.observations, peer.model).residuals(peer.x0)


def limit(json: Path | None) -> bool:
    """Print errors relative to the bound; return whether all are within the limits."""
    start_s = time.perf_counter()
    trials = run_trials(TRIALS, outliers=TRIALS)
    print(f"{TRIALS} trials, {2 * len(trials.scene.clean)} residuals, {time.perf_counter() - start_s:.0f} s")
    ours, linear = np.array(over_bound(trials, trials.errors)), np.array(over_bound(trials, trials.linear))
    with_outliers = np.array(over_bound(trials, trials.with_outliers))
    plain = np.sqrt(ours.mean(axis=1))
    paired = np.sqrt(1.0 + (ours - linear).mean(axis=1))
    costs = np.sqrt(with_outliers.mean(axis=1) / ours.mean(axis=1))
    errors, spread = ((plain, 3), (paired, 4), (costs, 3)), np.sqrt(0.5 / TRIALS)
    print(f"RMSE / bound, worst of the mirrors, sampled with a spread of {spread:.3f}:")
    for name, *rows in zip(("normals", "distances"), plain, paired, costs, strict=True):
        worst, paired_worst, cost = (row.max() for row in rows)
        print(f"  {name:10} {worst:.3f}, paired {paired_worst:.4f}; with outliers {cost:.3f} of clean")
    nees = np.mean([e @ np.linalg.solve(c, e) for e, c in zip(trials.errors, trials.claims, strict=True)])
    nees /= trials.errors.shape[1]
    block = trials.scene.bound[trials.mirrors, trials.mirrors]
    weakest = np.linalg.eigh(block)[1][:, -1]
    claimed = np.mean([np.sqrt(weakest @ claim[trials.mirrors, trials.mirrors] @ weakest) for claim in trials.claims])
    sampled = float(np.sqrt(np.mean((trials.errors[:, trials.mirrors] @ weakest) ** 2)))
    print(f"NEES per degree of freedom {nees:.3f}; weakest direction sampled / claimed {sampled / claimed:.3f}")
    good = plain.max() <= 1.05 and costs.max() <= 1.1 and 0.95 <= nees <= 1.05 and abs(sampled / claimed - 1.0) <= 0.1
    print(f"within 1.05, 1.1, 0.95 to 1.05, 10 %: {'yes' if good else 'NO'}")
    worst, paired_worst, cost = (", ".join(f"{row.max():.{digits}f}" for row in rows) for rows, digits in errors)
    rows = [
        ("RMSE / bound, worst normal, worst distance", f"{worst} (each ± {spread:.3f} from {TRIALS} trials)", "1.05"),
        ("the same, paired with the linear estimate of the same noise", paired_worst, ""),
        ("NEES per degree of freedom", f"{nees:.3f}", "0.95 to 1.05"),
        (f"weakest direction, sampled / predicted {SIGMA}", f"{sampled / claimed:.3f}", "within 10 %"),
        (f"1 % outliers of 20 {SIGMA}, normals, distances", f"{cost} of clean", "1.1"),
    ]
    write_record(json, "calibration_bound", table=table(("", "", "limit"), rows))
    return bool(good)


def start(json: Path | None) -> bool:
    """Print how often fits converge from wrong mirrors; return whether nearly all do from 2 deg and 2 mm."""
    scene = small_scene()
    rates, converged = {}, {}
    for tilt_deg, offset_mm in ((2.0, 2.0), (3.0, 3.0), (4.0, 4.0)):
        draws = DRAWS if tilt_deg == 2.0 else DRAWS // 5
        good = sum(converges(scene, seed, tilt_deg=tilt_deg, offset_mm=offset_mm) for seed in range(draws))
        rates[tilt_deg], converged[f"converged_{tilt_deg:g}deg"] = good / draws, good
        print(f"mirror errors of {tilt_deg:g} deg and {offset_mm:g} mm: {good} of {draws} converge")
    write_record(json, "calibration_start", converged)
    return rates[2.0] >= 0.99


PARTS: dict[str, Callable[[Path | None], bool]] = {"speed": speed, "limit": limit, "start": start}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    add_json_option(parser)
    options = parser.parse_args()
    if not PARTS.keys() >= set(options.parts):
        parser.error(f"parts {' '.join(options.parts)}, expected some of {', '.join(PARTS)}")
    results = [PARTS[name](options.json) for name in options.parts or PARTS]
    sys.exit(0 if all(results) else 1)
