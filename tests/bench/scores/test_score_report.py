"""Reports: what fails, means over sets with their standard errors, and JSON that reads back."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.bench.scores.calibration_score import CalibrationScore
from mirrorcam.bench.scores.consistency import Nees
from mirrorcam.bench.scores.score_report import SCHEMA, Limits, ScoreReport, report_of, scored_set
from tests.optics.camera_files.rigs import device, moved, true_rig, with_random_poses

ROOT = Path(__file__).parents[3]


@cache
def score_of(scale: float = 1.0, nees: Nees | None = None) -> CalibrationScore:
    score = device().score(moved(true_rig(device().truth), np.diag([scale, scale, scale, 1.0])))
    return replace(score, nees=nees)


def report(scores: list[CalibrationScore], limits: Limits | None = None) -> ScoreReport:
    limits = limits or Limits(each={}, over_sets={})
    sets = [
        scored_set(score, name=f"set {number}", calibration="a.yaml", format="opencv", layout="0" * 16, limits=limits)
        for number, score in enumerate(scores)
    ]
    return report_of(sets, scores, limits)


def test_means_over_sets_have_their_standard_error() -> None:
    scales = [1.001, 1.002, 0.9995]
    found = report([score_of(scale) for scale in scales]).over_sets["scale_error_percent"]
    values = 100.0 * (np.array(scales) - 1.0)
    assert found.mean == pytest.approx(values.mean())
    assert found.standard_error == pytest.approx(values.std(ddof=1) / np.sqrt(3))
    assert found.sets == 3
    assert report([score_of()]).over_sets["rms_px"].standard_error is None


def test_nees_of_several_sets_is_that_of_all_degrees_of_freedom() -> None:
    over = report([score_of(nees=Nees(10.0, 20)), score_of(nees=Nees(50.0, 30)), score_of()]).over_sets
    assert over["nees"].mean == pytest.approx(60.0 / 50.0)
    assert over["nees_freedom"].mean == 50.0
    assert over["nees"].sets == 2
    assert "nees" not in report([score_of()]).over_sets


def test_a_limit_of_a_set_or_of_the_mean_fails_the_report() -> None:
    scores = [score_of(1.001), score_of(0.998)]
    assert report(scores).passed
    assert report(scores, Limits(each={"scale_error_percent": 0.21}, over_sets={"scale_error_percent": 0.06})).passed
    assert not report(scores, Limits(each={"scale_error_percent": 0.15}, over_sets={})).passed
    failed = report(scores, Limits(each={}, over_sets={"scale_error_percent": 0.04}))
    assert not failed.passed
    assert [check.passed for check in failed.checks_over_sets] == [False]


def test_a_limit_of_a_view_that_is_missing_fails() -> None:
    rig = true_rig(device().truth)
    score = device().score(replace(rig, cameras=rig.cameras[1:]))
    found = report([score], Limits(each={"view_0_0_rms_px": 1.0, "view_0_1_rms_px": 1.0}, over_sets={}))
    assert [(check.passed, check.reason) for check in found.sets[0].checks] == [
        (False, "no camera for view_0_0"),
        (True, ""),
    ]


def test_json_reads_back_and_says_its_schema() -> None:
    found = report([score_of(1.001), device().score(with_random_poses(true_rig(device().truth), 1.0))])
    text = found.text()
    assert json.loads(text)["schema"] == SCHEMA
    assert ScoreReport.model_validate_json(text, strict=True) == found
    assert text == report([score_of(1.001), device().score(with_random_poses(true_rig(device().truth), 1.0))]).text()


def test_the_report_has_what_its_schema_lists() -> None:
    published = json.loads((ROOT / "docs" / "schemas" / "score.schema.json").read_text(encoding="utf-8"))
    written = json.loads(report([score_of()]).text())
    assert written.keys() <= published["properties"].keys()
    assert set(published["required"]) <= written.keys()


def test_a_report_of_nothing_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="no set"):
        report_of([], [])
