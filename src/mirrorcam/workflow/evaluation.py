"""A calibrator tried on the sets of a suite: its command is run on each without the truth, and its result is scored."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field

from mirrorcam.optics.base.files import LARGEST_LAYOUT_BYTES, read_model, shortened
from mirrorcam.optics.base.names import Line
from mirrorcam.optics.base.progress import Progress, no_progress
from mirrorcam.optics.base.values import InputError, Value
from mirrorcam.optics.scoring.attempt import TriedSet
from mirrorcam.optics.scoring.calibration_score import CalibrationScore
from mirrorcam.optics.scoring.figure_limits import Limits
from mirrorcam.optics.scoring.matched_views import ViewsFile
from mirrorcam.optics.scoring.score_report import NO_LIMITS, ScoredSet, ScoreReport, report_of
from mirrorcam.workflow.blind_sets import blind_set
from mirrorcam.workflow.scoring import ScoreRequest, score_set
from mirrorcam.workflow.suite_folder import FinishedSuite, SuiteSet

RESULTS = "results"
LOG = "log.txt"
COVARIANCE = "covariance.json"
LAST_BYTES = 2000
"""Bytes of the end of a log in which the line that says what was wrong is looked for."""
WATCHED = "rms_px"
"""The figure that is compared with an earlier evaluation."""


class Change(Value):
    """A figure of a set against an earlier evaluation of the same set."""

    set: str
    figure: str
    before: float
    now: float
    most: float | None
    passed: bool

    @property
    def factor(self) -> float:
        """How many times the figure is what it was."""
        return self.now / self.before if self.before > 0.0 else (1.0 if self.now == 0.0 else float("inf"))


class Evaluation(Value):
    """The content of `evaluation.json`."""

    schema_id: Literal["mirrorcam.evaluation/1"] = Field(default="mirrorcam.evaluation/1", alias="schema")
    suite: str
    version: int
    command: Line
    tried: tuple[TriedSet, ...]
    scores: ScoreReport | None = Field(description="of the sets that have a score; none where no set has")
    changes: tuple[Change, ...]
    passed: bool

    @property
    def failures(self) -> dict[str, str]:
        """Why sets have no score, by their names."""
        return {each.name: each.failure for each in self.tried if each.failure}

    @property
    def scored(self) -> dict[str, ScoredSet]:
        """The scores, by the names of the sets."""
        return {} if self.scores is None else {each.name: each for each in self.scores.sets}

    def text(self) -> str:
        """The JSON."""
        return self.model_dump_json(indent=1, by_alias=True) + "\n"


@dataclass(frozen=True)
class EvaluationRequest:
    """A command, and how its results are judged.

    Attributes
    ----------
    command
        A line for the shell, which finds the set in $MIRRORCAM_SET, and puts its calibration into $MIRRORCAM_RESULT.
    timeout_s
        Time that it may take on one set.
    reading
        How its results are read; sets and calibrations in it are not used.
    baseline
        An earlier evaluation; None: none.
    worse_by
        The factor by which the RMS error of a set may exceed that of the baseline; None: any.
    """

    command: str
    timeout_s: float
    reading: ScoreRequest
    baseline: Evaluation | None = None
    worse_by: float | None = None


def evaluate(
    suite: FinishedSuite, request: EvaluationRequest, folder: Path, progress: Progress = no_progress
) -> tuple[Evaluation, dict[str, CalibrationScore]]:
    """Run a command on each set of a suite, in folders of `folder / RESULTS`, and score what it leaves there.

    Returns the evaluation, and the scores by the names of the sets. A command that fails, or whose result cannot be
    read, fails the set, not the evaluation. Raises InputError for limits or views that cannot be read.
    """
    reading = request.reading
    views = None if reading.views is None else ViewsFile.load(reading.views)
    limits = NO_LIMITS if reading.limits is None else Limits.load(reading.limits)
    tried: list[TriedSet] = []
    scored: list[ScoredSet] = []
    scores: dict[str, CalibrationScore] = {}
    progress(0, len(suite.folders))
    for done, (entry, place) in enumerate(zip(suite.manifest.sets, suite.folders, strict=True), start=1):
        result = folder / RESULTS / entry.name
        result.mkdir(parents=True)
        seconds, failure = _run(request, place, result)
        if not failure:
            try:
                of_set, score = score_set(
                    place,
                    _calibration(result),
                    reading,
                    name=entry.name,
                    covariance=result / COVARIANCE if (result / COVARIANCE).exists() else None,
                    views=views,
                    limits=limits,
                )
                scored.append(of_set)
                scores[entry.name] = score
            except InputError as error:
                failure = str(error).replace(f"{result}", "$MIRRORCAM_RESULT")
        tried.append(_tried(entry, seconds, failure))
        progress(done, len(suite.folders))
    report = report_of(scored, list(scores.values()), limits) if scored else None
    changes = changes_of(request, suite, {each.name: each for each in scored})
    passed = len(scored) == len(tried) and (report is None or report.passed) and all(each.passed for each in changes)
    evaluation = Evaluation(
        suite=suite.manifest.name,
        version=suite.manifest.version,
        command=_line(request.command),
        tried=tuple(tried),
        scores=report,
        changes=changes,
        passed=passed and bool(tried),
    )
    return evaluation, scores


def read_baseline(path: Path) -> Evaluation:
    """Read an earlier evaluation; raises InputError in one line where it is none."""
    return read_model(Evaluation, path, LARGEST_LAYOUT_BYTES)


def changes_of(request: EvaluationRequest, suite: FinishedSuite, scored: Mapping[str, ScoredSet]) -> tuple[Change, ...]:
    """The watched figure of each set that the baseline has, too; a set that was rendered otherwise is not compared."""
    if request.baseline is None:
        return ()
    before = request.baseline.scored
    the_same = {each.name: each.dataset_sha256 for each in request.baseline.tried}
    found = []
    for entry in suite.manifest.sets:
        if entry.name not in scored or entry.name not in before or the_same.get(entry.name) != entry.dataset_sha256:
            continue
        now, then = (each[entry.name].figures[WATCHED].value for each in (scored, before))
        passed = request.worse_by is None or now <= request.worse_by * then
        found.append(Change(set=entry.name, figure=WATCHED, before=then, now=now, most=request.worse_by, passed=passed))
    return tuple(found)


def _calibration(result: Path) -> Path:
    """The one file that a command has left in its folder, or the folder of several; raises InputError for none."""
    names = [path for path in sorted(result.iterdir()) if path.name not in (LOG, COVARIANCE)]
    if not names:
        raise InputError("the command left no file in $MIRRORCAM_RESULT, expected its calibration there")
    return names[0] if len(names) == 1 else result


def _tried(entry: SuiteSet, seconds: float, failure: str) -> TriedSet:
    return TriedSet(
        name=entry.name,
        why=entry.why,
        dataset_sha256=entry.dataset_sha256,
        seconds=round(seconds, 2),
        failure=_line(failure),
    )


def _line(text: str) -> str:
    return shortened("".join(char if char.isprintable() else " " for char in " ".join(text.split())))


def _run(request: EvaluationRequest, place: Path, result: Path) -> tuple[float, str]:
    """Run the command on one set; its time, and why it failed, or nothing. What it prints goes into the log."""
    started = time.monotonic()
    with blind_set(place) as seen, (result / LOG).open("wb") as log:
        environment = os.environ | {"MIRRORCAM_SET": f"{seen}", "MIRRORCAM_RESULT": f"{result.absolute()}"}
        process = subprocess.Popen(
            request.command,
            shell=True,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )
        try:
            code = process.wait(timeout=request.timeout_s)
        except subprocess.TimeoutExpired:
            return time.monotonic() - started, f"the command took longer than {request.timeout_s:g} s"
        finally:
            _end(process)
    seconds = time.monotonic() - started
    if code == 0:
        return seconds, ""
    said = _last_line(result / LOG)
    for path, variable in ((seen, "$MIRRORCAM_SET"), (result.absolute(), "$MIRRORCAM_RESULT")):
        said = said.replace(f"{path}", variable)
    ended = f"signal {-code} ended the command" if code < 0 else f"the command ended with exit code {code}"
    return seconds, ended + (f": {said}" if said else "")


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill a command with all that it has started, if it has not ended."""
    if process.poll() is None:
        if sys.platform == "win32":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _last_line(log: Path) -> str:
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - LAST_BYTES))
        lines = file.read().decode("utf-8", errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")
