"""The runner of the leaderboard: what it runs, what it does not run again, and its records."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import leaderboard
from benchmarks.leaderboard import CALIBRATORS, evaluated, main
from benchmarks.records import Records
from tests.bench.test_leaderboard_files import written


@pytest.mark.parametrize("name", CALIBRATORS)
def test_a_command_is_of_a_module_that_is_there_and_says_how_it_is_used(name: str) -> None:
    calibrator = CALIBRATORS[name]
    assert "$MIRRORCAM_SET" in calibrator.command
    assert "$MIRRORCAM_RESULT" in calibrator.command
    assert (Path(leaderboard.__file__).parent / "calibrators" / f"{calibrator.module}.py").is_file()


def test_an_evaluation_that_is_there_is_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there = written(tmp_path / "evaluation.json", {"a": 0.1})
    monkeypatch.setattr(subprocess, "run", lambda *given, **named: pytest.fail("it was run again"))
    assert evaluated(CALIBRATORS["mirrorcam"], tmp_path / "small.suite.json", tmp_path, 600.0) == there


def test_bad_input_ends_it(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"MirrorCam on .*none\.suite\.json: mirrorcam: "):
        evaluated(CALIBRATORS["mirrorcam"], tmp_path / "none.suite.json", tmp_path / "out", 600.0)


def test_without_mrcal_the_page_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def made(calibrator: Any, suite: Path, folder: Path, timeout_s: float) -> Path:
        folder.mkdir(parents=True)
        return written(folder / "evaluation.json", {"a": 0.1})

    monkeypatch.setattr(leaderboard, "evaluated", made)
    monkeypatch.setattr(leaderboard, "python_with_mrcal", lambda asked: None)
    records = tmp_path / "records.json"
    line = ["leaderboard", "small.suite.json", "--out", str(tmp_path / "found"), "--json", str(records)]
    monkeypatch.setattr(sys, "argv", line)
    assert main() == 0
    measured = Records.load(records).records["leaderboard_sets"]
    assert measured.values["opencv-joint.a"].value == 0.1
    told = (tmp_path / "found" / "leaderboard.md").read_text(encoding="utf-8")
    assert "- mrcal, one lens: no interpreter here has it" in told
    assert "- Kalibr: " in told
    assert told.count("| 1 of 1 |") == len(CALIBRATORS) - 1
