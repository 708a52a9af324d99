"""`mirrorcam evaluate`: anyone's calibrator tried on the sets of a suite, and what it found compared with the truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import Bounds
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
from mirrorcam.core.console.progress import long_work, print_table, say
from mirrorcam.core.values import Value

if TYPE_CHECKING:
    from mirrorcam.bench.evaluation import Evaluation

TIMEOUT_S = Bounds(1.0, 86400.0)
WORSE_BY = Bounds(1.0, 1000.0)


class EvaluateOptions(Value):
    """Run a calibrator on every set of a suite, without the truth, and score its results; exit 1 where one fails."""

    suite: tyro.conf.Positional[Path] = Field(
        description="NAME.suite.json that `mirrorcam suite` wrote, or the folder that holds no other"
    )
    command: str = Field(
        min_length=1,
        description="a line for the shell that calibrates one set: it reads the folder $MIRRORCAM_SET, and writes "
        "its calibration, and if it has one covariance.json, into the folder $MIRRORCAM_RESULT",
    )
    timeout_s: float = TIMEOUT_S.field(
        600.0, "seconds that the command may take on one set, with those to read and score its result"
    )
    format: FormatOption = AUTO
    unit: UnitOption = AUTO
    pictures: PicturesOption = AUTO
    views: ViewsOption = None
    limits: LimitsOption = None
    baseline: Annotated[Path | None, FILE] = Field(
        default=None, description="evaluation.json of an earlier run, to show the change against"
    )
    worse_by: Annotated[float | None, tyro.conf.arg(metavar="FACTOR", help_behavior_hint="")] = WORSE_BY.field(
        None, "factor by which the RMS error of a set may exceed that of the baseline"
    )
    out: Path = Field(
        default=Path("output/evaluation"),
        description="folder for evaluation.json, summary.md, junit.xml, pictures and results",
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.worse_by is not None and self.baseline is None:
            raise ValueError("--worse-by: expected --baseline with it")
        return self


def run(options: EvaluateOptions) -> int:
    """Evaluate, print a row for each set, and write the files; 1 where a set has no score or a limit is not kept."""
    from mirrorcam.bench.evaluation import EvaluationRequest, EvaluationStopped, evaluate
    from mirrorcam.bench.evaluation_files import FILES, write_evaluation
    from mirrorcam.bench.evaluation_reading import read_evaluation
    from mirrorcam.bench.scoring import ScoreRequest
    from mirrorcam.bench.suite_folder import read_finished
    from mirrorcam.core.disk.output_folder import output_folder

    suite = read_finished(options.suite)
    reading = ScoreRequest(
        sets=(),
        calibrations=(),
        format=None if options.format == AUTO else options.format,
        unit=None if options.unit == AUTO else options.unit,
        pictures=None if options.pictures == AUTO else options.pictures,
        views=options.views,
        limits=options.limits,
    )
    request = EvaluationRequest(
        command=options.command,
        timeout_s=options.timeout_s,
        reading=reading,
        baseline=None if options.baseline is None else read_evaluation(options.baseline),
        worse_by=options.worse_by,
    )
    stopped = None
    # Absolute: the command may remove the folder that this process works in.
    with output_folder(options.out.absolute(), "evaluate", force=options.force) as output:
        output.refuse_others(*FILES)
        with output.staged(result="evaluation.json") as folder:
            try:
                with long_work("evaluate", options.command, "sets") as advance:
                    evaluation, scores = evaluate(suite, request, folder, advance)
            except EvaluationStopped as error:
                evaluation, scores, stopped = error.evaluation, error.scores, error
            write_evaluation(evaluation, scores, suite, folder)
    _print(evaluation)
    if stopped is not None:
        raise stopped
    say("evaluate", f"{options.out} written: {'passed' if evaluation.passed else 'failed'}")
    return 0 if evaluation.passed else 1


def _print(evaluation: Evaluation) -> None:
    from mirrorcam.bench.evaluation_summary import SHORT_COLUMNS, failed_lines, set_rows

    heads, *rows = set_rows(evaluation, SHORT_COLUMNS)
    print_table(heads, rows)
    for line in failed_lines(evaluation):
        say("evaluate", line)
