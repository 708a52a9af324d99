"""`mirrorcam score`: anyone's calibration of a rendered set, compared with the set's ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.core.bounds import DEPTH_MM
from mirrorcam.core.console.option_texts import (
    AUTO,
    FILE,
    FORCE,
    FormatOption,
    LimitsOption,
    PicturesOption,
    UnitOption,
    ViewsOption,
)
from mirrorcam.core.console.progress import print_table, say
from mirrorcam.core.values import Value

if TYPE_CHECKING:
    from mirrorcam.bench.scores.score_report import ScoredSet, ScoreReport

LEFT_OUT = ("median_px", "bias_x_px", "bias_y_px")
"""Figures of views that a terminal is too narrow for; the files of the report have them."""


class ScoreOptions(Value):
    """Score anyone's calibration of a rendered set against its ground truth; exit 1 past a limit."""

    sets: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="SET...", help_behavior_hint="")] = (
        Field(min_length=1, description="folders of sets that `mirrorcam render` wrote, or folders of such folders")
    )
    calibration: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE|FOLDER...")] = Field(
        min_length=1,
        description="the calibration of each set; or one folder that holds one for each, by the name of the set",
    )
    format: FormatOption = AUTO
    unit: UnitOption = AUTO
    pictures: PicturesOption = AUTO
    views: ViewsOption = None
    covariance: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE...", help_behavior_hint="")] = Field(
        default=(), description="covariance of the calibration's parameters, JSON, for NEES; a layout.json has its own"
    )
    distance_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(that of the set's layout)")
    ] = DEPTH_MM.field(None, "working distance from each view")
    limits: LimitsOption = None
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE", help_behavior_hint="")] = Field(
        default=None, description="file to write the report to as JSON"
    )
    markdown: Annotated[Path | None, FILE] = Field(default=None, description="file to write it to as Markdown")
    junit: Annotated[Path | None, FILE] = Field(
        default=None, description="file to write its limits to as tests of JUnit"
    )
    set_name: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...", help_behavior_hint="")] = Field(
        default=(), description="names of the sets in reports, instead of their folders'"
    )
    force: bool = FORCE


def run(options: ScoreOptions) -> int:
    """Score, print the figures, and write the files; 1 where a figure is past its limit."""
    from mirrorcam.bench.scoring import ScoreFiles, ScoreRequest, refuse_files, score, write_report

    files = ScoreFiles(options.json_file, options.markdown, options.junit)
    refuse_files(files, force=options.force)
    request = ScoreRequest(
        sets=options.sets,
        calibrations=options.calibration,
        covariances=options.covariance,
        names=options.set_name,
        format=None if options.format == AUTO else options.format,
        unit=None if options.unit == AUTO else options.unit,
        pictures=None if options.pictures == AUTO else options.pictures,
        views=options.views,
        distance_mm=options.distance_mm,
        limits=options.limits,
    )
    report = score(request)
    for scored in report.sets:
        _print(scored)
    if len(report.sets) > 1:
        _print_means(report)
    write_report(report, files, force=options.force)
    if files.paths:
        say("score", f"{', '.join(map(str, files.paths))} written")
    if options.limits is not None:
        say("score", "passed" if report.passed else "failed: a figure exceeds its limit, or is not given")
    return 0 if report.passed else 1


def _print(scored: ScoredSet) -> None:
    """What was scored, the figures of each view, and those of all."""
    from mirrorcam.bench.scores.report_texts import VIEW_COLUMNS, rows_of, summary, value_text

    say("score", f"{scored.name}: {summary(scored)}")
    for note in scored.notes:
        say("score", note)
    if scored.missing:
        say("score", f"no camera of {', '.join(scored.missing)}")
    names = [name for name in VIEW_COLUMNS if name not in LEFT_OUT]
    rows = []
    for view in scored.views:
        metrics = [scored.figures.get(f"{view}_{name}") for name in names]
        rows.append((view, *("-" if metric is None else value_text(metric.value, 2) for metric in metrics)))
    print_table(["", *(VIEW_COLUMNS[name] for name in names)], rows)
    print_table(["", "value", "limit", ""], rows_of(scored))


def _print_means(report: ScoreReport) -> None:
    from mirrorcam.bench.scores.report_texts import value_text

    rows = []
    for name, mean in report.over_sets.items():
        error = "" if mean.standard_error is None else value_text(mean.standard_error, 2)
        rows.append((name, value_text(mean.mean), error, str(mean.sets)))
    print_table([f"over {len(report.sets)} sets", "mean", "standard error", "sets"], rows)
