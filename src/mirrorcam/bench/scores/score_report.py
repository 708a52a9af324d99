"""The scores of one or more sets, and their JSON file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from mirrorcam.bench.scores.calibration_score import CalibrationScore
from mirrorcam.bench.scores.consistency import pooled
from mirrorcam.core.disk.files import LARGEST_TEXT_BYTES, read_bytes, toml_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import Line, Name
from mirrorcam.core.values import Metric, Value

VIEW_FIGURES = (
    *("rms_px", "median_px", "p95_px", "max_px", "rms_mm", "bias_x_px", "bias_y_px"),
    *("shown_share", "focal_error_percent"),
)
"""Figures over all views, and of each view as `view_ROW_COLUMN_NAME`."""
FIGURES = (
    *VIEW_FIGURES,
    *("worst_view_rms_px", "focal_error_rms_percent"),
    *("baseline_error_rms_mm", "baseline_error_max_mm", "baseline_error_percent"),
    *("angle_error_rms_deg", "angle_error_max_deg"),
    *("triangulation_rms_mm", "triangulation_median_mm", "triangulation_max_mm", "scale_error_percent"),
    *("nees", "nees_low", "nees_high", "nees_freedom"),
)
"""All figures of a score, in order."""
AT_LEAST = frozenset({"shown_share"})
"""Figures with a lower limit; all others have an upper limit on their absolute value."""
OVER_SETS = "over_sets"
_VIEW_FIGURE = re.compile(r"view_\d+_\d+_(.+)")


class Limits(Value):
    """Limits by figure, for each set and for means over sets."""

    each: dict[str, float]
    over_sets: dict[str, float]

    @classmethod
    def load(cls, path: Path) -> Limits:
        """Read a TOML file; raises InputError for an unknown figure or an invalid limit."""
        tables = toml_of(path, read_bytes(path, LARGEST_TEXT_BYTES))
        over = tables.pop(OVER_SETS, {})
        if not isinstance(over, dict):
            raise InputError(f"{path}: {OVER_SETS}: expected a table of limits")
        return cls(each=_checked_limits(path, tables), over_sets=_checked_limits(path, over))


class Check(Value):
    """Whether a figure is within its limit; a missing figure fails, with its `reason`."""

    figure: str
    value: float | None
    unit: str
    limit: float
    at_least: bool
    passed: bool
    reason: str = ""


def _checked_limits(path: Path, tables: Mapping[str, object]) -> dict[str, float]:
    limits = {}
    for name, value in tables.items():
        if figure_of(name) not in FIGURES:
            close = get_close_matches(name, FIGURES, n=1)
            hint = f"did you mean {close[0]}?" if close else "expected a figure of `mirrorcam score`, such as rms_px"
            raise InputError(f"{path}: {name[:40]!r} is not a figure, {hint}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= float(value) < np.inf:
            raise InputError(f"{path}: {name}: {str(value)[:40]!r}, expected a limit of 0 or more")
        limits[name] = float(value)
    return limits


def figure_of(name: str) -> str:
    """Return the figure in a name without its view; an unknown figure keeps the view."""
    match = _VIEW_FIGURE.fullmatch(name)
    return match[1] if match and match[1] in VIEW_FIGURES else name


def checks(
    limits: Mapping[str, float], figures: Mapping[str, Metric], not_given: Mapping[str, str]
) -> tuple[Check, ...]:
    """Check each limit."""
    results = []
    for name, limit in limits.items():
        metric, at_least = figures.get(name), figure_of(name) in AT_LEAST
        if metric is None or not metric.known:
            reason = not_given.get(name, "not given") if metric is None else metric.reason
            results.append(
                Check(figure=name, value=None, unit="", limit=limit, at_least=at_least, passed=False, reason=reason)
            )
            continue
        passed = metric.value >= limit if at_least else abs(metric.value) <= limit
        results.append(
            Check(figure=name, value=metric.value, unit=metric.unit, limit=limit, at_least=at_least, passed=passed)
        )
    return tuple(results)


SCHEMA = "mirrorcam.score/1"
NO_LIMITS = Limits(each={}, over_sets={})


class ScoredSet(Value):
    """The score of one set in a file: a `CalibrationScore` and the checks of its limits."""

    name: Name
    calibration: Line
    format: str
    layout: str = Field(description="identity of the true layout")
    distance_mm: float
    alignment: str
    mirrored: bool
    views: dict[str, Line] = Field(description="camera of the calibration, by view")
    missing: tuple[str, ...]
    figures: dict[str, Metric]
    not_given: dict[str, str]
    notes: tuple[Line, ...]
    checks: tuple[Check, ...]


class MeanFigure(Value):
    """Mean of a figure over sets; for a signed figure, the bias. The standard error needs two sets."""

    mean: float
    standard_error: float | None
    unit: str
    sets: int


class ScoreReport(Value):
    """Content of the JSON file of `mirrorcam score`."""

    schema_id: Literal["mirrorcam.score/1"] = Field(default="mirrorcam.score/1", alias="schema")
    sets: tuple[ScoredSet, ...]
    over_sets: dict[str, MeanFigure]
    checks_over_sets: tuple[Check, ...]
    passed: bool

    def text(self) -> str:
        """Return the JSON."""
        return self.model_dump_json(indent=1, by_alias=True) + "\n"


def scored_set(
    score: CalibrationScore, *, name: str, calibration: str, format: str, layout: str, limits: Limits = NO_LIMITS
) -> ScoredSet:
    """Convert a score to an entry of the report."""
    missing = {
        figure: f"no camera for {view}" for figure in limits.each for view in score.missing if figure.startswith(view)
    }
    return ScoredSet(
        name=name,
        calibration=calibration,
        format=format,
        layout=layout,
        distance_mm=score.distance_mm,
        alignment=score.alignment,
        mirrored=score.mirrored,
        views=score.views,
        missing=score.missing,
        figures=score.figures,
        not_given=score.not_given,
        notes=score.notes,
        checks=checks(limits.each, score.figures, score.not_given | missing),
    )


def report_of(sets: Sequence[ScoredSet], scores: Sequence[CalibrationScore], limits: Limits = NO_LIMITS) -> ScoreReport:
    """Return the report of sets and their scores; raises ValueError if there is none."""
    if not sets:
        raise ValueError("no set, expected at least one")
    over = {name: mean for name in FIGURES if (mean := _mean([entry.figures.get(name) for entry in sets])) is not None}
    joint = pooled([score.nees for score in scores if score.nees is not None])
    for name in ("nees", "nees_low", "nees_high", "nees_freedom"):
        over.pop(name, None)
    if joint is not None:
        low, high = joint.interval
        values = {"nees": joint.mean, "nees_low": low, "nees_high": high, "nees_freedom": joint.freedom}
        count = sum(score.nees is not None for score in scores)
        for name, value in values.items():
            over[name] = MeanFigure(mean=value, standard_error=None, unit="1", sets=count)
    figures = {name: Metric(value=mean.mean, unit=mean.unit) for name, mean in over.items()}
    over_checks = checks(limits.over_sets, figures, {})
    passed = all(check.passed for entry in sets for check in entry.checks)
    passed = passed and all(check.passed for check in over_checks)
    return ScoreReport(sets=tuple(sets), over_sets=over, checks_over_sets=over_checks, passed=passed)


def _mean(metrics: Sequence[Metric | None]) -> MeanFigure | None:
    known = [metric for metric in metrics if metric is not None and metric.known]
    if not known:
        return None
    values = np.array([metric.value for metric in known])
    error = float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None
    return MeanFigure(mean=float(values.mean()), standard_error=error, unit=known[0].unit, sets=len(values))
