"""The runner of the leaderboard: what it runs, what it does not run again, and that its sets are of `standard`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import leaderboard
from benchmarks.leaderboard import CALIBRATORS, evaluated, main
from mirrorcam.render_scenes.suites.suite import read_suite
from tests.mirrorcam.workflow.test_leaderboard_files import written


def test_its_sets_are_those_of_the_suite_standard() -> None:
    standard = {each.name: each for each in read_suite("standard").sets}
    chosen = read_suite(str(Path(leaderboard.__file__).with_suffix(".toml"))).sets
    assert len(chosen) == 14
    assert [each for each in chosen if standard[each.name] != each] == []


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
    monkeypatch.setattr(sys, "argv", ["leaderboard", "small.suite.json", "--out", str(tmp_path / "found")])
    assert main() == 0
    told = (tmp_path / "found" / "leaderboard.md").read_text(encoding="utf-8")
    assert "- mrcal, one lens: no interpreter here has it" in told
    assert "- Kalibr: " in told
    assert told.count("| 1 of 1 |") == len(CALIBRATORS) - 1
