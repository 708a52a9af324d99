"""A calibrator's command is run on every set, and what it leaves is scored; a set that fails loses no other."""

from __future__ import annotations

import errno
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from mirrorcam.bench import evaluation
from mirrorcam.bench.calibrator_run import LOG, copy_result
from mirrorcam.bench.evaluation import (
    RESULTS,
    Change,
    Evaluation,
    EvaluationStopped,
    _NoScore,
    _score_in,
    _ScoringTask,
    evaluate,
    read_evaluation,
)
from mirrorcam.bench.score_request import EvaluationRequest, Reading
from mirrorcam.bench.scores.score_report import NO_LIMITS
from mirrorcam.bench.suite_folder import FinishedSuite, read_finished
from mirrorcam.core.processes.worker_process import WorkerProcess
from tests.nightly import a_few

pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")

READING = Reading()
NOMINAL = 'cp "$MIRRORCAM_SET/layout.json" "$MIRRORCAM_RESULT"'
"""A calibrator that takes the design for the device."""


@pytest.fixture
def suite(finished_suite: Path) -> FinishedSuite:
    return read_finished(finished_suite)


def evaluated(suite: FinishedSuite, folder: Path, command: str = NOMINAL, **stated: Any) -> Evaluation:
    baseline, reading = stated.pop("baseline", None), stated.pop("reading", READING)
    request = EvaluationRequest.model_construct(command=command, **{"timeout_s": 60.0, **stated})
    return evaluate(suite, request, reading, folder, baseline=baseline)[0]


def test_the_true_layout_has_no_error_and_the_design_that_of_its_assembly(suite: FinishedSuite, tmp_path: Path) -> None:
    sets = zip(suite.manifest.sets, suite.folders, strict=True)
    truths = {each.name: place / "truth" / "layout.json" for each, place in sets}
    folder = tmp_path / "truths"
    folder.mkdir()
    for name, path in truths.items():
        (folder / f"{name}.json").write_bytes(path.read_bytes())
    true = evaluated(suite, tmp_path / "a", f'cp "{folder}/$(basename "$MIRRORCAM_RESULT").json" "$MIRRORCAM_RESULT"')
    nominal = evaluated(suite, tmp_path / "b")
    assert true.passed and nominal.passed
    for name in truths:
        assert true.scored[name].figures["rms_px"].value < 1e-6
        assert 0.5 < nominal.scored[name].figures["rms_px"].value < 50.0


def test_a_command_sees_no_truth_and_its_output_is_kept(suite: FinishedSuite, tmp_path: Path) -> None:
    evaluated(suite, tmp_path, f'find "$MIRRORCAM_SET" | sort; echo said >&2; {NOMINAL}')
    for each in suite.manifest.sets:
        log = (tmp_path / RESULTS / each.name / LOG).read_text(encoding="utf-8")
        assert "views.json" in log and "truth" not in log and log.endswith("said\n")


@pytest.mark.parametrize(
    ("command", "failure"),
    a_few(
        3,
        [
            ("echo so >&2; echo it is >&2; exit 3", "the command ended with exit code 3: it is"),
            ('echo "$MIRRORCAM_SET/x"; exit 1', "the command ended with exit code 1: $MIRRORCAM_SET/x"),
            ("kill -9 $$", "signal 9 ended the command"),
            ("true", "the command left no file in $MIRRORCAM_RESULT, expected its calibration there"),
            ('echo no > "$MIRRORCAM_RESULT/a.yaml"', "$MIRRORCAM_RESULT"),
            ('ln -s /etc/hostname "$MIRRORCAM_RESULT/c.yaml"', "$MIRRORCAM_RESULT/c.yaml: is a link"),
            ('mkfifo "$MIRRORCAM_RESULT/covariance.json"', "$MIRRORCAM_RESULT/covariance.json: is not a regular file"),
            ('rm -r "$MIRRORCAM_RESULT" "$MIRRORCAM_SET"', "the command removed $MIRRORCAM_RESULT"),
        ],
    ),
)
def test_a_set_that_fails_says_why_and_loses_no_other(
    suite: FinishedSuite, tmp_path: Path, command: str, failure: str
) -> None:
    first, *others = (each.name for each in suite.manifest.sets)
    only_first = f'if [ "$(basename "$MIRRORCAM_RESULT")" = {first} ]; then {command}; else {NOMINAL}; fi'
    found = evaluated(suite, tmp_path, only_first)
    assert not found.passed
    assert list(found.failures) == [first]
    assert found.failures[first].startswith(failure)
    assert list(found.scored) == others


@pytest.mark.slow
def test_a_command_that_takes_too_long_is_ended_with_all_that_it_started(suite: FinishedSuite, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    waits = f"import time; time.sleep(3); open({str(mark)!r}, 'w')"
    started = time.monotonic()
    found = evaluated(suite, tmp_path / "out", f'"{sys.executable}" -c "{waits}" & wait', timeout_s=0.5)
    assert set(found.failures.values()) == {"the command took longer than 0.5 s"}
    time.sleep(max(0.0, started + 5.0 - time.monotonic()))
    assert not mark.exists()


def test_a_result_that_takes_too_long_to_read_is_not_waited_for(suite: FinishedSuite, tmp_path: Path) -> None:
    (tmp_path / "layout.json").write_bytes((suite.folders[0] / "layout.json").read_bytes())
    reads = _ScoringTask("one", suite.folders[0], tmp_path, READING, None, NO_LIMITS)
    worker = WorkerProcess(preload=("mirrorcam.bench.scoring",))
    try:
        with pytest.raises(_NoScore, match="took longer than 0 s"):
            _score_in(worker, reads, 1e-3)
        assert _score_in(worker, reads, 60.0)[0].name == "one"
    finally:
        worker.close()


def test_where_this_machine_has_no_more_room_what_is_done_stays(
    suite: FinishedSuite, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(result: Path, place: Path) -> None:
        if place.name == "two":
            raise OSError(errno.ENOSPC, "No space left on device")
        copy_result(result, place)

    monkeypatch.setattr(evaluation, "copy_result", full)
    with pytest.raises(EvaluationStopped, match=r"two: No space left on device") as caught:
        evaluated(suite, tmp_path)
    found = caught.value.evaluation
    assert list(found.scored) == list(caught.value.scores) == ["one"]
    assert list(found.failures) == ["two"] and not found.passed
    assert {path.name for path in tmp_path.iterdir()} == {RESULTS}


def test_limits_decide(suite: FinishedSuite, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("rms_px = 1e-3\n", encoding="utf-8")
    found = evaluated(suite, tmp_path / "out", reading=READING.replaced(limits=limits))
    assert not found.passed and not found.failures


@pytest.mark.slow
def test_a_baseline_decides_where_a_factor_is_given(suite: FinishedSuite, tmp_path: Path) -> None:
    before = evaluated(suite, tmp_path / "before")
    path = tmp_path / "evaluation.json"
    path.write_text(before.text(), encoding="utf-8")
    assert read_evaluation(path) == before
    assert before.scores is not None
    halved = []
    for each in before.scores.sets:
        rms = each.figures["rms_px"]
        halved.append(each.replaced(figures=each.figures | {"rms_px": rms.replaced(value=rms.value / 2.0)}))
    better = before.replaced(scores=before.scores.replaced(sets=halved))
    same = evaluated(suite, tmp_path / "same", baseline=before, worse_by=1.1)
    worse = evaluated(suite, tmp_path / "worse", baseline=better, worse_by=1.5)
    told = evaluated(suite, tmp_path / "told", baseline=better)
    assert same.passed and not worse.passed and told.passed
    assert [change.factor for change in same.changes] == [1.0, 1.0]
    assert [change.factor for change in worse.changes] == pytest.approx([2.0, 2.0])


@pytest.mark.slow
def test_sets_that_were_rendered_otherwise_are_not_compared(suite: FinishedSuite, tmp_path: Path) -> None:
    before = evaluated(suite, tmp_path / "before")
    others = [each.replaced(dataset_sha256="0" * 64) for each in before.tried]
    assert evaluated(suite, tmp_path / "now", baseline=before.replaced(tried=others)).changes == ()


def test_a_change_from_nothing_is_endless() -> None:
    nothing = Change(set="a", figure="rms_px", before=0.0, now=0.0, most=None, passed=True)
    assert nothing.factor == 1.0
    assert nothing.replaced(now=1.0).factor == float("inf")
