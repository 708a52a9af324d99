"""`mirrorcam score`: calibrations of rendered sets against their ground truth; calibrators, alone and compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from mirrorcam.bench.score_request import EvaluationRequest, Reading, ScoreRequest
from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, print_table, say

if TYPE_CHECKING:
    from mirrorcam.bench.evaluation import Evaluation
    from mirrorcam.bench.scores.score_report import ScoredSet, ScoreReport

OMITTED = ("median_px", "bias_x_px", "bias_y_px")
"""Figures of views that do not fit on a terminal; the report's files contain them."""
OutputFolder = Annotated[Path, Parameter(help="output folder")]

app = App(name="score")


@app.default
def score(
    sets: Annotated[
        tuple[Path, ...],
        Parameter(name="SET...", help="folders of sets that mirrorcam render wrote, or folders of such folders"),
    ],
    /,
    *,
    request: ScoreRequest,
    reading: Reading = Reading(),
    out: OutputFolder = Path("output/score"),
    force: Force = False,
) -> int:
    """Score calibrations of rendered sets by any program.

    Compares calibrations of Kalibr, OpenCV, ROS, COLMAP, mrcal, Anipose or MirrorCam with the ground truth. Writes
    score.json, score.md, and the limits as tests in junit.xml. Exit code 1: a figure exceeds its limit.

    Examples:
        mirrorcam score output/set --calibration camchain.yaml
        mirrorcam score sets/ --calibration results/ --limits limits.toml
        mirrorcam score suite suites --command 'python calibrate.py'
    """
    from mirrorcam.bench.scoring import FILES, score, write_report
    from mirrorcam.core.disk.output_folder import output_folder

    with output_folder(out, "score", force=force) as output:
        output.refuse_others(*FILES)
        report = score(sets, request, reading)
        with output.staged(result="score.json") as folder:
            write_report(report, folder)
    for scored in report.sets:
        _print(scored)
    if len(report.sets) > 1:
        _print_means(report)
    say("score", f"{', '.join(str(out / name) for name in FILES)} written")
    if reading.limits is not None:
        say("score", "passed" if report.passed else "failed: a figure exceeds its limit, or is missing")
    return 0 if report.passed else 1


@app.command
def suite(
    rendered: Annotated[
        Path,
        Parameter(name="SUITE", help="NAME.suite.json that mirrorcam suite wrote, or a folder with only one"),
    ],
    /,
    *,
    request: EvaluationRequest,
    reading: Reading = Reading(),
    out: OutputFolder = Path("output/evaluation"),
    force: Force = False,
) -> int:
    """Run a calibrator on every set of a suite, and score its results.

    The calibrator does not see the ground truth. Writes evaluation.json, summary.md, junit.xml, and pictures/ and
    results/ of the sets. Exit code 1: a set has no score, or a figure exceeds its limit.

    Examples:
        mirrorcam score suite suites --command 'python calibrate.py' --limits limits.toml
    """
    from mirrorcam.bench.evaluation import EvaluationStopped, evaluate, read_evaluation
    from mirrorcam.bench.evaluation_files import FILES, write_evaluation
    from mirrorcam.bench.suite_folder import read_finished
    from mirrorcam.core.disk.output_folder import output_folder

    finished = read_finished(rendered)
    baseline = None if request.baseline is None else read_evaluation(request.baseline)
    stopped = None
    # Absolute: the command may remove the folder that this process works in.
    with output_folder(out.absolute(), "evaluate", force=force) as output:
        output.refuse_others(*FILES)
        with output.staged(result="evaluation.json") as folder:
            try:
                with long_work("score", request.command, "sets") as advance:
                    evaluation, scores = evaluate(
                        finished, request, reading, folder, baseline=baseline, progress=advance
                    )
            except EvaluationStopped as error:
                evaluation, scores, stopped = error.evaluation, error.scores, error
            write_evaluation(evaluation, scores, finished, folder)
    _print_sets(evaluation)
    if stopped is not None:
        raise stopped
    say("score", f"{out} written: {'passed' if evaluation.passed else 'failed'}")
    return 0 if evaluation.passed else 1


@app.command
def leaderboard(
    evaluations: Annotated[
        tuple[str, ...],
        Parameter(
            name="NAME=FILE...",
            help="name of a calibrator and its evaluation.json by mirrorcam score suite; evaluations of "
            "one name are combined",
        ),
    ],
    /,
    *,
    not_run: Annotated[
        tuple[str, ...], Parameter(metavar="NAME=WHY...", help="calibrators that the page names as not run, and why")
    ] = (),
    out: OutputFolder = Path("output/leaderboard"),
    force: Force = False,
) -> int:
    """Compare calibrators by their evaluations, on a page.

    Writes leaderboard.html, leaderboard.md and leaderboard.json.

    Examples:
        mirrorcam score leaderboard mine=mine/evaluation.json theirs=theirs/evaluation.json
    """
    from mirrorcam.bench.leaderboard_files import FILES, read_leaderboard, write_leaderboard
    from mirrorcam.bench.scores.leaderboard import board_rows, reasons
    from mirrorcam.core.disk.output_folder import output_folder

    board = read_leaderboard(evaluations, not_run)
    with output_folder(out, "leaderboard", force=force) as output:
        output.refuse_others(*FILES)
        with output.staged(result="leaderboard.json") as folder:
            write_leaderboard(board, folder)
    header, *rows = board_rows(board)
    columns = [
        column for column, title in enumerate(header) if title in ("calibrator", "sets scored", "NEES") or "px" in title
    ]
    print_table([header[column] for column in columns], [[row[column] for column in columns] for row in rows])
    for calibrator, reason, names in reasons(board):
        say("leaderboard", f"{calibrator} failed on {', '.join(names)}: {reason}")
    say("leaderboard", f"{out / 'leaderboard.html'} written")
    return 0


def _print_sets(evaluation: Evaluation) -> None:
    from mirrorcam.bench.evaluation_files import SHORT_COLUMNS, failed_lines, set_rows

    header, *rows = set_rows(evaluation, SHORT_COLUMNS)
    print_table(header, rows)
    for line in failed_lines(evaluation):
        say("score", line)


def _print(scored: ScoredSet) -> None:
    """Print the scored calibration, the figures of each view, and the figures over all views."""
    from mirrorcam.bench.scores.report_texts import VIEW_COLUMNS, rows_of, summary, value_text

    say("score", f"{scored.name}: {summary(scored)}")
    for note in scored.notes:
        say("score", note)
    if scored.missing:
        say("score", f"no camera for {', '.join(scored.missing)}")
    names = [name for name in VIEW_COLUMNS if name not in OMITTED]
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
