"""The scores of one or several sets as a value, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from mirrorcam.bench.scores.calibration_score import CalibrationScore
from mirrorcam.bench.scores.consistency import pooled
from mirrorcam.bench.scores.figure_limits import FIGURES, Check, Limits, checks
from mirrorcam.core.names import Line, Name
from mirrorcam.core.values import Metric, Value

SCHEMA = "mirrorcam.score/1"
NO_LIMITS = Limits(each={}, over_sets={})


class ScoredSet(Value):
    """The score of one set: `CalibrationScore` in a file, and which limits it keeps."""

    name: Name
    calibration: Line
    format: str
    layout: str = Field(description="identity of the true layout")
    distance_mm: float
    alignment: str
    mirrored: bool
    views: dict[str, Line] = Field(description="camera of the calibration by the view that it is")
    missing: tuple[str, ...]
    figures: dict[str, Metric]
    not_given: dict[str, str]
    notes: tuple[Line, ...]
    checks: tuple[Check, ...]


class MeanFigure(Value):
    """Mean of a figure over sets: of a signed one, the bias. The standard error needs two sets."""

    mean: float
    standard_error: float | None
    unit: str
    sets: int


class ScoreReport(Value):
    """The content of the JSON file of `mirrorcam score`."""

    schema_id: Literal["mirrorcam.score/1"] = Field(default="mirrorcam.score/1", alias="schema")
    sets: tuple[ScoredSet, ...]
    over_sets: dict[str, MeanFigure]
    checks_over_sets: tuple[Check, ...]
    passed: bool

    def text(self) -> str:
        """The JSON."""
        return self.model_dump_json(indent=1, by_alias=True) + "\n"


def scored_set(
    score: CalibrationScore, *, name: str, calibration: str, format: str, layout: str, limits: Limits = NO_LIMITS
) -> ScoredSet:
    """A score as a value of the report."""
    missing = {
        figure: f"no camera of {view}" for figure in limits.each for view in score.missing if figure.startswith(view)
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
    """The report of sets with their scores; raises ValueError for none."""
    if not sets:
        raise ValueError("no set, expected one at least")
    over = {name: mean for name in FIGURES if (mean := _mean([each.figures.get(name) for each in sets])) is not None}
    together = pooled([score.nees for score in scores if score.nees is not None])
    for name in ("nees", "nees_low", "nees_high", "nees_freedom"):
        over.pop(name, None)
    if together is not None:
        low, high = together.interval
        values = {"nees": together.mean, "nees_low": low, "nees_high": high, "nees_freedom": together.freedom}
        count = sum(score.nees is not None for score in scores)
        for name, value in values.items():
            over[name] = MeanFigure(mean=value, standard_error=None, unit="1", sets=count)
    figures = {name: Metric(value=mean.mean, unit=mean.unit) for name, mean in over.items()}
    over_checks = checks(limits.over_sets, figures, {})
    passed = all(check.passed for each in sets for check in each.checks) and all(each.passed for each in over_checks)
    return ScoreReport(sets=tuple(sets), over_sets=over, checks_over_sets=over_checks, passed=passed)


def _mean(metrics: Sequence[Metric | None]) -> MeanFigure | None:
    given = [metric for metric in metrics if metric is not None and metric.known]
    if not given:
        return None
    values = np.array([metric.value for metric in given])
    error = float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None
    return MeanFigure(mean=float(values.mean()), standard_error=error, unit=given[0].unit, sets=len(values))
