"""Markdown and JUnit's XML: every limit a test, every failure with its reason, and no text that breaks them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import pytest

from mirrorcam.bench.scores.calibration_score import CalibrationScore
from mirrorcam.bench.scores.report_texts import junit, markdown, value_text
from mirrorcam.bench.scores.score_report import Limits, ScoreReport, report_of, scored_set
from tests.hostile_names import ACCEPTED
from tests.optics.camera_files.rigs import device, true_rig, with_random_poses

LIMITS = Limits(each={"rms_px": 1e-6, "shown_share": 1.0, "nees": 2.0}, over_sets={"rms_mm": 1e-6})


@cache
def scored() -> CalibrationScore:
    """A calibration without its first view, and a note that is no markup."""
    rig = with_random_poses(true_rig(device().truth), 1.0)
    return replace(device().score(replace(rig, cameras=rig.cameras[1:])), notes=("a <note> | of `it`",))


def report(*names: str, limits: Limits = LIMITS) -> ScoreReport:
    score = scored()
    sets = [
        scored_set(score, name=name, calibration=f"{name}.yaml", format="opencv", layout="0" * 16, limits=limits)
        for name in names
    ]
    return report_of(sets, [score] * len(sets), limits)


def test_every_limit_is_a_test_of_junit() -> None:
    root = ElementTree.fromstring(junit(report("first", "second")))
    assert root.tag == "testsuites"
    suites = root.findall("testsuite")
    assert [suite.get("name") for suite in suites] == ["first", "second", "over sets"]
    for suite in suites:
        cases, failures = suite.findall("testcase"), suite.findall("testcase/failure")
        assert int(suite.get("tests", "")) == len(cases)
        assert int(suite.get("failures", "")) == len(failures)
        assert {case.get("classname") for case in cases} == {f"mirrorcam.score.{suite.get('name')}"}
        assert all(case.get("name") and case.get("time") for case in cases)
    assert int(root.get("tests", "")) == sum(int(suite.get("tests", "")) for suite in suites) == 10
    assert int(root.get("failures", "")) == 5
    messages = [failure.get("message", "") for failure in suites[0].findall("testcase/failure")]
    assert messages[0].startswith("rms_px is 0.")
    assert messages[0].endswith("px, expected at most 1e-06")
    assert messages[1] == "nees is not given, expected at most 2"
    properties = {each.get("name"): each.get("value") for each in suites[0].findall("properties/property")}
    assert properties["nees"] == "not given"
    assert float(properties["rms_px"] or "") > 0.0


def test_without_limits_there_is_one_test_that_passes() -> None:
    root = ElementTree.fromstring(junit(report("first", limits=Limits(each={}, over_sets={}))))
    assert [case.get("name") for case in root.iter("testcase")] == ["scored"]
    assert root.get("failures") == "0"


def test_markdown_has_a_row_for_every_figure_and_view() -> None:
    text = markdown(report("first", "second"))
    assert text.startswith("# Calibration score: failed\n")
    lines = text.splitlines()
    assert sum(line.startswith("| `view_0_1` |") for line in lines) == 2
    assert sum(line.startswith("| `rms_px` |") for line in lines) == 3
    assert "| `nees` | not given: the calibration has no covariance | at most 2 | **failed** |" in lines
    assert "| `shown_share` | 1 | at least 1 | passed |" in lines
    assert "- no camera for view_0_0" in lines
    tables = [line.count("|") for line in lines if line.startswith("|")]
    assert set(tables) == {5, 11, 7}


@pytest.mark.parametrize("name", ACCEPTED)
def test_names_are_text(name: str) -> None:
    found = report(name)
    root = ElementTree.fromstring(junit(found))
    suite = root.find("testsuite")
    assert suite is not None
    assert suite.get("name") == name
    assert "<script" not in markdown(found).split("\n", 3)[2]


def test_rounding_is_no_error() -> None:
    assert (value_text(3e-13), value_text(0.01234567), value_text(-3e-6, 2)) == ("0", "0.01235", "-3.0e-6")
    assert value_text(float("nan")) == "none"
