"""Evaluate a calibrator on a suite: run its command on each set without the ground truth, and score its results."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from mirrorcam.bench.calibrator_run import (
    COVARIANCE,
    LOG,
    RESULT,
    calibration_path,
    copy_result,
    run_calibrator,
    write_blind_set,
)
from mirrorcam.bench.score_request import EvaluationRequest, Reading
from mirrorcam.bench.scores.calibration_score import CalibrationScore
from mirrorcam.bench.scores.leaderboard import TriedSet
from mirrorcam.bench.scores.matched_views import ViewsFile
from mirrorcam.bench.scores.score_report import NO_LIMITS, Limits, ScoredSet, ScoreReport, report_of
from mirrorcam.bench.scoring import score_set
from mirrorcam.bench.suite_folder import FinishedSuite, SuiteSet
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, model_from, read_bytes, tables_of
from mirrorcam.core.disk.work_folder import remove_stale, work_folder
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.core.names import Line
from mirrorcam.core.processes.worker_process import WorkerDied, WorkerProcess
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import Value

RESULTS = "results"
READING_S = 10.0
"""Minimum time limit for reading and scoring a result."""
RESERVED_BYTES, RESERVED_BYTES_PER_SET = 1_000_000, 200_000
"""Disk space reserved for the files of an evaluation, in case a command fills the disk."""
COMPARED = "rms_px"
"""The figure that is compared with the baseline."""


class Change(Value):
    """Change of a set's figure from the baseline, an earlier evaluation; `most` is the maximum factor allowed."""

    set: str
    figure: str
    before: float
    now: float
    most: float | None
    passed: bool

    @property
    def factor(self) -> float:
        """Ratio of the figure to the baseline's."""
        return self.now / self.before if self.before > 0.0 else (1.0 if self.now == 0.0 else float("inf"))


class Evaluation(Value):
    """Content of `evaluation.json`."""

    schema_id: Literal["mirrorcam.evaluation/1"] = Field(default="mirrorcam.evaluation/1", alias="schema")
    suite: str
    version: int
    command: Line
    tried: tuple[TriedSet, ...]
    scores: ScoreReport | None = Field(description="of the sets with a score; null if no set has one")
    changes: tuple[Change, ...]
    passed: bool

    @property
    def failures(self) -> dict[str, str]:
        """Reasons for missing scores, by the names of the sets."""
        return {tried.name: tried.failure for tried in self.tried if tried.failure}

    @property
    def scored(self) -> dict[str, ScoredSet]:
        """The scores, by the names of the sets."""
        return {} if self.scores is None else {scored.name: scored for scored in self.scores.sets}

    def text(self) -> str:
        """Return the JSON."""
        return self.model_dump_json(indent=1, by_alias=True) + "\n"


class EvaluationStopped(InputError):
    """An evaluation stopped because the disk is full or a folder was removed; the message states the reason.

    Attributes
    ----------
    evaluation, scores
        As returned by `evaluate`; sets that were not reached are failures.
    """

    def __init__(self, reason: str, evaluation: Evaluation, scores: dict[str, CalibrationScore]) -> None:
        super().__init__(reason)
        self.evaluation, self.scores = evaluation, scores


def evaluate(
    suite: FinishedSuite,
    request: EvaluationRequest,
    reading: Reading,
    folder: Path,
    *,
    baseline: Evaluation | None = None,
    progress: Progress = no_progress,
) -> tuple[Evaluation, dict[str, CalibrationScore]]:
    """Run a command on each set of a suite, in temporary folders, and score its results.

    `baseline` is the earlier evaluation that the request names. Logs and results are written to `folder / RESULTS`.
    Returns the evaluation, and the scores by the names of the sets. If the command fails, or its result is invalid,
    only the set fails. Raises InputError for invalid limits or views, and EvaluationStopped.
    """
    views = None if reading.views is None else ViewsFile.load(reading.views)
    limits = NO_LIMITS if reading.limits is None else Limits.load(reading.limits)
    tried: list[TriedSet] = []
    scored: list[ScoredSet] = []
    scores: dict[str, CalibrationScore] = {}
    stopped = ""
    remove_stale()
    folder = folder.absolute()  # a command may remove the working directory
    folder.mkdir(parents=True, exist_ok=True)
    reserve = folder / "reserve"
    reserve.write_bytes(os.urandom(RESERVED_BYTES + RESERVED_BYTES_PER_SET * len(suite.folders)))
    worker = WorkerProcess(preload=("mirrorcam.bench.scoring",))
    progress(0, len(suite.folders))
    try:
        worker.start()
        for done, (entry, set_folder) in enumerate(zip(suite.manifest.sets, suite.folders, strict=True), start=1):
            seconds, failure = 0.0, f"not run: {stopped}" if stopped else ""
            results = folder / RESULTS / entry.name
            try:
                if not stopped:
                    seconds, failure = _run(request, set_folder, results)
                if not failure:
                    task = _ScoringTask(entry.name, set_folder, results, reading, views, limits)
                    scored_set, score = _score_in(worker, task, max(READING_S, request.timeout_s - seconds))
                    scored.append(scored_set)
                    scores[entry.name] = score
            except _NoScore as error:
                failure = str(error)
            except OSError as error:
                stopped = f"{error.filename or results}: {error.strerror or error}"
                failure = f"not saved: {stopped}"
            tried.append(_tried_set(entry, seconds, failure))
            progress(done, len(suite.folders))
    finally:
        worker.close()
        reserve.unlink()
    report = report_of(scored, list(scores.values()), limits) if scored else None
    changes = changes_of(baseline, request.worse_by, suite, {scored_set.name: scored_set for scored_set in scored})
    passed = len(scored) == len(tried) and (report is None or report.passed)
    passed = passed and all(change.passed for change in changes)
    evaluation = Evaluation(
        suite=suite.manifest.name,
        version=suite.manifest.version,
        command=_one_line(request.command),
        tried=tuple(tried),
        scores=report,
        changes=changes,
        passed=passed and bool(tried),
    )
    if stopped:
        raise EvaluationStopped(stopped, evaluation, scores)
    return evaluation, scores


def changes_of(
    baseline: Evaluation | None, worse_by: float | None, suite: FinishedSuite, scored: Mapping[str, ScoredSet]
) -> tuple[Change, ...]:
    """Return the change of the compared figure for each set that the baseline has with the same checksum."""
    if baseline is None:
        return ()
    earlier = baseline.scored
    checksums = {tried.name: tried.dataset_sha256 for tried in baseline.tried}
    changes = []
    for entry in suite.manifest.sets:
        if entry.name not in scored or entry.name not in earlier or checksums.get(entry.name) != entry.dataset_sha256:
            continue
        figures = [scores[entry.name].figures[COMPARED] for scores in (scored, earlier)]
        if not all(figure.known for figure in figures):
            continue
        now, before = (figure.value for figure in figures)
        passed = worse_by is None or now <= worse_by * before
        changes.append(Change(set=entry.name, figure=COMPARED, before=before, now=now, most=worse_by, passed=passed))
    return tuple(changes)


def _tried_set(entry: SuiteSet, seconds: float, failure: str) -> TriedSet:
    return TriedSet(
        name=entry.name,
        why=entry.why,
        dataset_sha256=entry.dataset_sha256,
        seconds=round(seconds, 2),
        failure=_one_line(failure),
    )


def _one_line(text: str) -> str:
    return shortened(" ".join("".join(char if char.isprintable() else " " for char in text).split()))


def _run(request: EvaluationRequest, set_folder: Path, results: Path) -> tuple[float, str]:
    """Run the command on one set and save its log and result; return its duration, and why it failed or "".

    Raises OSError if files cannot be written.
    """
    results.mkdir(parents=True)
    with work_folder() as work:
        inputs, result = work / "set", work / "result" / results.name
        for path in (inputs, result):
            path.mkdir(parents=True)
        try:
            write_blind_set(set_folder, inputs)
        except InputError as error:
            return 0.0, str(error)
        run = run_calibrator(request.command, inputs, result, request.timeout_s)
        failure = run.failure
        try:
            copy_result(result, results)
        except InputError as error:
            failure = failure or str(error)
    (results / LOG).write_bytes(run.log)
    return run.seconds, failure


@dataclass(frozen=True)
class _ScoringTask:
    """Inputs of `score_set` for one set."""

    name: str
    set_folder: Path
    results: Path
    reading: Reading
    views: ViewsFile | None
    limits: Limits

    def score(self) -> tuple[ScoredSet, CalibrationScore]:
        covariance = self.results / COVARIANCE
        return score_set(
            self.set_folder,
            calibration_path(self.results),
            self.reading,
            name=self.name,
            covariance=covariance if covariance.exists() else None,
            views=self.views,
            limits=self.limits,
        )


class _NoScore(Exception):
    """A result cannot be scored; the message states why."""


def _score_in(worker: WorkerProcess, task: _ScoringTask, limit_s: float) -> tuple[ScoredSet, CalibrationScore]:
    """Score a command's result; raises _NoScore.

    The worker process that reads it is killed after a time limit, and may crash without harm to this one.
    """
    worker.send(_ScoringTask.score, task)  # before the timer starts, which kills the process
    start_s = time.monotonic()
    timer = threading.Timer(limit_s, worker.kill)
    timer.start()
    try:
        answer: tuple[ScoredSet, CalibrationScore] = worker.answer()
        return answer
    except InputError as error:
        raise _NoScore(str(error).replace(f"{task.results}", f"${RESULT}")) from None
    except WorkerDied as error:
        if time.monotonic() - start_s >= limit_s:
            raise _NoScore(f"reading and scoring its result took longer than {limit_s:.0f} s") from None
        raise _NoScore(f"the process that read its result ended {error}") from None
    except RuntimeError as error:  # a bug of this program must not affect the other sets
        with (task.results / LOG).open("a", encoding="utf-8") as log:
            log.write(f"\n{error}")
        reason = str(error).strip().splitlines()[-1]
        raise _NoScore(f"its result could not be scored, as {LOG} explains: {reason}") from None
    finally:
        timer.cancel()
        timer.join()


def read_evaluation(path: Path) -> Evaluation:
    """Read an evaluation; raises InputError for an invalid file.

    A set whose RMS error is not a number of at least 0 becomes a failure.
    """
    tables = tables_of(path, read_bytes(path, LARGEST_LAYOUT_BYTES))
    scores = tables.get("scores") if isinstance(tables, dict) else None
    sets = scores.get("sets") if isinstance(scores, dict) else None
    if isinstance(scores, dict) and isinstance(sets, list):
        invalid = {name: reason for table in sets if (name := _name_of(table)) and (reason := _invalid_reason(table))}
        scores["sets"] = [table for table in sets if _name_of(table) not in invalid]
        for table in tables["tried"] if isinstance(tables.get("tried"), list) else []:
            if (name := _name_of(table)) in invalid:
                table["failure"] = invalid[name]
    return model_from(Evaluation, path, tables)


def _name_of(table: Any) -> str:
    """Return the name of a set in a table; empty if missing."""
    name = table.get("name") if isinstance(table, dict) else None
    return name if isinstance(name, str) else ""


def _invalid_reason(scored: dict[str, Any]) -> str:
    """Return why a score in a table is invalid; empty if it is valid, or the table has no figures."""
    figures = scored.get("figures")
    if not isinstance(figures, dict):
        return ""
    figure = figures.get(COMPARED)
    value = figure.get("value") if isinstance(figure, dict) else None
    if isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < math.inf:
        return ""
    text = shortened("".join(char for char in repr(value) if char.isprintable()), 40)
    return f"invalid result: {COMPARED} is {text}, expected a number of at least 0"
