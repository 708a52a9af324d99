"""Training and test of the confidence of depth."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.light_field_depth.kinds import Case, read_case, rooms, variants
from benchmarks.light_field_depth.reliability import sigma_px
from benchmarks.records import Rows
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth import DepthEstimator, Quality, confidence
from mirrorcam.optics.light_field.depth.confidence import RIGHT_PX, STATISTICS, LogOdds

Floats = NDArray[np.float32]
SAMPLED_PX = 1500
"""Pixels of each case that training uses, at random."""
RIDGE = 1.0
"""Inverse variance of the coefficients, for a case of SAMPLED_PX pixels."""
STEPS = 12
LIMITS = 0.005
"""Fraction of the pixels beyond each limit of a statistic."""
TRAINING_SEED, TEST_SEED = 0, 1000
ROOMS = 36
SURE = 0.9
MIN_CLASS = 0.01
COLUMNS = "mean confidence", "right", "calibration error", "beyond 3 sigma", "of those sure by 0.9"
BINS = np.linspace(0.0, 1.0, 11)
COEFFICIENTS = Path(confidence.__file__).with_suffix(".json")


class _Recorder(DepthEstimator):
    """An estimator that keeps the statistics of the last depth map."""

    recorded: Floats

    def _confidence(self, statistics: Floats) -> Floats:
        self.recorded = statistics
        return super()._confidence(statistics)


@dataclass(frozen=True, eq=False)
class Tried:
    """Pixels with a truth: statistics (k, n), error and sigma (n,) in px at the longest baseline, confidence (n,).

    The truth is a multiple of `truth_step_px`, 0 if it is not rounded.
    """

    name: str
    kind: str
    statistics: Floats
    error_px: FloatArray
    sigma_px: FloatArray
    confidence: Floats
    truth_step_px: float

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether (n,) depths are right."""
        return np.asarray(self.error_px < RIGHT_PX)

    @property
    def sigmas(self) -> FloatArray:
        """Errors (n,) beyond the rounding of the truth, in standard deviations."""
        return np.asarray(np.maximum(self.error_px - self.truth_step_px / 2.0, 0.0) / self.sigma_px)


def tried(case: Case, quality: Quality) -> Tried:
    """Measure the depth of a case and compare it with the truth."""
    light_field = case.light_field
    estimator = _Recorder(light_field, near_mm=case.near_mm, far_mm=case.far_mm, quality=quality)
    depth = estimator.estimate(light_field)
    distance = depth.depth_mm.astype(np.float64) - light_field.reference_view_depth_mm
    baseline = light_field.focal_px * float(np.abs(light_field.positions_mm[..., :2]).max())
    disparity = baseline * (1.0 / distance - 1.0 / light_field.reference_depth_mm)
    error = np.abs(disparity - case.truth_px)
    known = np.isfinite(error)
    return Tried(
        case.name,
        case.kind,
        estimator.recorded[:, known],
        error[known],
        sigma_px(depth)[known],
        depth.confidence[known],
        case.truth_step_px,
    )


def cases(scenes: Sequence[str], step: int, seed: int) -> Iterator[Case]:
    """Yield all kinds of the scenes, and rooms with bare walls."""
    for number, text in enumerate(scenes):
        yield from variants(read_case(text, step), seed + 10 * number)
    yield from rooms(seed, ROOMS)


def _products(values: Floats) -> Floats:
    """Return 1, values (k, n) and their products (m, n), in the order of `_unpacked`."""
    first, second = np.triu_indices(len(values))
    return np.concatenate([np.ones_like(values[:1]), values, values[first] * values[second]])


def _unpacked(coefficients: FloatArray, count: int) -> tuple[float, FloatArray, FloatArray]:
    quadratic = np.zeros((count, count))
    quadratic[np.triu_indices(count)] = coefficients[1 + count :]
    return float(coefficients[0]), coefficients[1 : 1 + count], (quadratic + quadratic.T) / 2.0


def fitted(statistics: Floats, right: NDArray[np.bool_], weights: FloatArray) -> LogOdds:
    """Fit the log odds to statistics (k, n) by logistic regression with a ridge (Newton's method)."""
    count = len(statistics)
    lowest, highest = np.quantile(statistics, (LIMITS, 1.0 - LIMITS), axis=1).astype(np.float32)
    empty = LogOdds(lowest, highest, 0.0, np.zeros(count, np.float32), np.zeros((count, count), np.float32))
    design = _products(empty.scaled(statistics)).astype(np.float64)
    coefficients = np.zeros(len(design))
    ridge = np.full(len(design), RIDGE)
    ridge[0] = 0.0
    for _ in range(STEPS):
        probability = 1.0 / (1.0 + np.exp(-(coefficients @ design)))
        gradient = design @ (weights * (right - probability)) - ridge * coefficients
        curvature = (design * (weights * probability * (1.0 - probability))) @ design.T + np.diag(ridge)
        coefficients = coefficients + np.linalg.solve(curvature, gradient)
    constant, linear, quadratic = _unpacked(coefficients, count)
    return LogOdds(lowest, highest, constant, linear.astype(np.float32), quadratic.astype(np.float32))


def train(results: Iterable[Tried]) -> LogOdds:
    """Fit the log odds to cases, each with the same weight."""
    random = np.random.default_rng(TRAINING_SEED)
    statistics, right, weights = [], [], []
    for result in results:
        chosen = random.choice(len(result.error_px), min(SAMPLED_PX, len(result.error_px)), replace=False)
        statistics.append(result.statistics[:, chosen])
        right.append(result.right[chosen])
        weights.append(np.full(len(chosen), SAMPLED_PX / len(chosen)))
    return fitted(np.concatenate(statistics, axis=1), np.concatenate(right), np.concatenate(weights))


def store(odds: LogOdds) -> None:
    """Write the coefficients that the estimator reads."""
    stored = {
        "statistics": STATISTICS,
        "lowest": _rounded(odds.lowest),
        "highest": _rounded(odds.highest),
        "constant": round(odds.constant, 4),
        "linear": _rounded(odds.linear),
        "quadratic": [_rounded(row) for row in odds.quadratic],
    }
    lines = ",\n".join(f"  {json.dumps(name)}: {_lines(value)}" for name, value in stored.items())
    COEFFICIENTS.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    confidence.log_odds.cache_clear()


def _rounded(values: Floats) -> list[float]:
    return [round(float(value), 4) for value in values]


def _lines(value: object) -> str:
    if isinstance(value, (list, tuple)) and not isinstance(value[0], float):
        return "[\n    " + ",\n    ".join(json.dumps(item) for item in value) + "\n  ]"
    return json.dumps(value)


def calibration_error(stated: Floats, right: NDArray[np.bool_]) -> float:
    """Return the expected calibration error: the mean difference of stated and true probability over ten classes."""
    number = np.clip(np.digitize(stated, BINS) - 1, 0, len(BINS) - 2)
    sums = np.bincount(number, weights=stated - right, minlength=len(BINS) - 1)
    return float(np.abs(sums).sum() / len(stated))


def report(results: Iterable[Tried], figure: Path | None) -> Rows:
    """Print how well confidence and sigma hold on each case, and return how well on each kind."""
    cases = Rows("case", *COLUMNS)
    by_kind: dict[str, list[Tried]] = {}
    for result in results:
        cases.add(result.name, *_figures([result]))
        by_kind.setdefault(result.kind, []).append(result)
    print()
    kinds = Rows("kind", *COLUMNS)
    for kind, members in by_kind.items():
        kinds.add(kind, *_figures(members))
    if figure is not None:
        draw(by_kind, figure)
    return kinds


def _figures(results: Sequence[Tried]) -> tuple[str, ...]:
    confidence, right = (
        np.concatenate([getattr(result, name) for result in results]) for name in ("confidence", "right")
    )
    beyond = np.concatenate([result.sigmas for result in results]) > 3.0
    sure = confidence >= SURE
    error = np.mean([calibration_error(result.confidence, result.right) for result in results])
    among_sure = f"{beyond[sure].mean():.1%} of {sure.mean():.0%}" if sure.any() else "none"
    return f"{confidence.mean():.3f}", f"{right.mean():.3f}", f"{error:.3f}", f"{beyond.mean():.1%}", among_sure


def draw(by_kind: Mapping[str, Sequence[Tried]], path: Path) -> None:
    """Draw the reliability diagram of each kind: how often depth is right, over stated confidence, one line a case."""
    matplotlib.rcParams["svg.hashsalt"] = "mirrorcam"
    figure = Figure(figsize=(2.3 * len(by_kind), 2.7), layout="constrained")
    for axes, (kind, results) in zip(figure.subplots(1, len(by_kind), sharey=True), by_kind.items(), strict=True):
        axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
        for result in results:
            axes.plot(*_points(result.confidence, result.right), color="tab:blue", alpha=0.35, linewidth=1)
        together = [np.concatenate([getattr(r, name) for r in results]) for name in ("confidence", "right")]
        axes.plot(*_points(*together), "o-", color="black", markersize=3)
        axes.set(title=kind, xlabel="stated", xlim=(0, 1), ylim=(0, 1), aspect="equal")
    figure.axes[0].set_ylabel("fraction right")
    with atomic(path) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None})


def _points(stated: Floats, right: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return mean stated probability and fraction right of the classes with at least MIN_CLASS of the pixels."""
    number = np.clip(np.digitize(stated, BINS) - 1, 0, len(BINS) - 2)
    counts, stated_sums, right_sums = (
        np.bincount(number, weights=weights, minlength=len(BINS) - 1) for weights in (None, stated, right)
    )
    kept = counts > MIN_CLASS * len(stated)
    return stated_sums[kept] / counts[kept], right_sums[kept] / counts[kept]
