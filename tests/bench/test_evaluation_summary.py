"""The summary says first what failed, and JUnit's XML has a test for each of it."""

from __future__ import annotations

from xml.etree.ElementTree import fromstring

import pytest

from mirrorcam.bench.evaluation import Change, Evaluation
from mirrorcam.bench.evaluation_files import (
    SHORT_COLUMNS,
    failed_lines,
    junit_text,
    set_rows,
    summary_text,
)
from mirrorcam.bench.scores.leaderboard import TriedSet
from mirrorcam.bench.scores.score_report import Check, ScoredSet, ScoreReport
from mirrorcam.core.values import Metric

LIMIT = Check(figure="rms_px", value=0.4, unit="px", limit=0.25, at_least=False, passed=False)


def scored(name: str, rms_px: float, *checks: Check) -> ScoredSet:
    figures = {
        "rms_px": Metric(value=rms_px, unit="px"),
        "worst_view_rms_px": Metric(value=2.0 * rms_px, unit="px"),
        "rms_mm": Metric(value=0.1 * rms_px, unit="mm"),
    }
    return ScoredSet(
        name=name,
        calibration="cameras.yaml",
        format="opencv",
        layout="1234",
        distance_mm=400.0,
        alignment="rigid",
        mirrored=False,
        views={},
        missing=(),
        figures=figures,
        not_given={"nees": "the calibration has no covariance"},
        notes=(),
        checks=checks,
    )


@pytest.fixture
def failed() -> Evaluation:
    """One set past its limit, one worse than before, one without a score."""
    tried = [("first", ""), ("second", ""), ("third", "the command ended with exit code 1: a|b `c` <script>")]
    sets = (scored("first", 0.4, LIMIT), scored("second", 0.2))
    return Evaluation(
        suite="small",
        version=2,
        command="python `calibrate`.py",
        tried=tuple(TriedSet(name=n, why="", dataset_sha256="0" * 64, seconds=1.25, failure=f) for n, f in tried),
        scores=ScoreReport(sets=sets, over_sets={}, checks_over_sets=(), passed=False),
        changes=(Change(set="second", figure="rms_px", before=0.1, now=0.2, most=1.5, passed=False),),
        passed=False,
    )


@pytest.fixture
def passed(failed: Evaluation) -> Evaluation:
    sets = (scored("first", 0.4), scored("second", 0.2))
    assert failed.scores is not None
    return failed.replaced(
        tried=failed.tried[:2],
        scores=failed.scores.replaced(sets=sets, passed=True),
        changes=(failed.changes[0].replaced(before=0.2, passed=True),),
        passed=True,
    )


def test_each_failure_has_a_line(failed: Evaluation, passed: Evaluation) -> None:
    assert failed_lines(failed) == [
        "third has no score: the command ended with exit code 1: a|b `c` <script>",
        "first: rms_px is 0.4 px, expected at most 0.25",
        "second: rms_px is 2.00 times the baseline's 0.1, expected at most 1.5 times",
    ]
    assert failed_lines(passed) == []


def test_every_set_has_a_row_and_its_change(failed: Evaluation) -> None:
    heads, *rows = set_rows(failed, SHORT_COLUMNS)
    assert heads == ["set", *SHORT_COLUMNS.values(), "time s", "RMS / baseline"]
    assert rows == [
        ["first", "0.4", "0.8", "0.04", "", "1.2", ""],
        ["second", "0.2", "0.4", "0.02", "", "1.2", "2.00 \N{MULTIPLICATION SIGN}"],
        ["third", "", "", "", "", "1.2", ""],
    ]


def test_the_summary_is_markdown_in_which_texts_of_others_are_texts(failed: Evaluation, passed: Evaluation) -> None:
    text = summary_text(failed, pictures=("first",))
    assert text.startswith("# Calibration on the suite small, version 2: failed\n")
    assert "\n- third has no score: the command ended with exit code 1: a\\|b \\`c\\` &lt;script&gt;\n" in text
    assert "by `python _calibrate_.py`" in text
    assert "![Errors of first in every view](pictures/first.png)" in text
    assert "bar [0.4, 0.2]" in text and "line [" not in text
    assert summary_text(passed).startswith("# Calibration on the suite small, version 2: passed\n")
    both = (passed.changes[0], passed.changes[0].replaced(set="first", before=0.3))
    assert "line [0.3, 0.2]" in summary_text(passed.replaced(changes=both))


def test_the_summary_of_what_fails_against_the_baseline_alone_does_not_say_that_it_passed(passed: Evaluation) -> None:
    worse = passed.changes[0].replaced(before=0.1, passed=False)
    text = summary_text(passed.replaced(changes=(worse,), passed=False))
    heads = [line for line in text.splitlines() if line.startswith("#")]
    assert heads == [
        "# Calibration on the suite small, version 2: failed",
        "## Limits: passed",
        "### first",
        "### second",
        "### Over 2 sets",
    ]


def test_the_summary_says_whether_limits_are_kept(failed: Evaluation) -> None:
    assert "\n## Limits: failed\n" in summary_text(failed)


def test_junit_counts_what_it_lists(failed: Evaluation, passed: Evaluation) -> None:
    for evaluation, failures in ((failed, 3), (passed, 0), (failed.replaced(scores=None, changes=()), 1)):
        root = fromstring(junit_text(evaluation))
        cases = root.findall(".//testcase")
        assert int(root.get("tests", "")) == len(cases)
        assert int(root.get("failures", "")) == len(root.findall(".//failure")) == failures
        for suite in root.findall("testsuite"):
            assert int(suite.get("tests", "")) == len(suite.findall("testcase"))
            assert int(suite.get("failures", "")) == len(suite.findall("testcase/failure"))
    said = fromstring(junit_text(failed)).find(".//testcase[@name='third: scored']/failure")
    assert said is not None and said.get("message") == failed.failures["third"]
