"""Training and test of the confidence of depth."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.light_field_depth.kinds import Case, read_case, rooms, variants
from benchmarks.light_field_depth.reliability import sigma_px
from benchmarks.records import Rows
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth import DepthEstimator, Quality, confidence
from mirrorcam.optics.light_field.depth.confidence import RIGHT_PX, STATISTICS, LogOdds

Floats = NDArray[np.float32]
SAMPLED_PX = 4000
"""Pixels of each case that training uses, at random."""
RIDGE = 3.0
"""Inverse variance of the coefficients, for a case of SAMPLED_PX pixels."""
STEPS = 12
LIMITS = 0.005
"""Fraction of the pixels beyond each limit of a statistic."""
TRAINING_SEED, TEST_SEED = 0, 1000
ROOMS = 18
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
    """Pixels with a truth: statistics (k, n), error and sigma (n,) in px at the longest baseline, confidence (n,)."""

    name: str
    statistics: Floats
    error_px: FloatArray
    sigma_px: FloatArray
    confidence: Floats

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether (n,) depths are right."""
        return np.asarray(self.error_px < RIGHT_PX)


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
        estimator.recorded[:, known],
        error[known],
        sigma_px(depth)[known],
        depth.confidence[known],
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


def report(results: Iterable[Tried]) -> Rows:
    """Print and return how well confidence and sigma hold on each case."""
    rows = Rows("case", "mean confidence", "right", "calibration error", "beyond 3 sigma", "of those sure by .9")
    errors = []
    for result in results:
        beyond, sure = result.error_px > 3.0 * result.sigma_px, result.confidence >= 0.9
        errors.append(calibration_error(result.confidence, result.right))
        rows.add(
            result.name,
            f"{result.confidence.mean():.3f}",
            f"{result.right.mean():.3f}",
            f"{errors[-1]:.3f}",
            f"{beyond.mean():.1%}",
            f"{beyond[sure].mean():.1%} of {sure.mean():.0%}" if sure.any() else "none",
        )
    rows.add("mean", "", "", f"{np.mean(errors):.3f}", "", "")
    return rows
