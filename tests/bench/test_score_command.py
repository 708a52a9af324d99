"""`mirrorcam score`: what it prints, the files it writes, and its exit codes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import get_args
from xml.etree import ElementTree

import pytest

from mirrorcam.bench.score_request import Flip, Format, Unit
from mirrorcam.cli import main
from mirrorcam.optics.camera_files.camera_rig import PictureFlip
from mirrorcam.optics.camera_files.read.registry import FORMATS, UNITS_MM
from mirrorcam.optics.camera_files.write import write_exports
from tests.command_line import assert_refused_here, results
from tests.optics.camera_files.rigs import device


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set without its pictures, and a calibration of it that is that of the design."""
    folder = tmp_path_factory.mktemp("scored")
    device().nominal.save(folder / "set" / "layout.json")
    device().truth.save(folder / "set" / "truth" / "layout.json")
    write_exports(device().truth, folder / "true")
    device().nominal.save(folder / "design" / "layout.json")
    return folder


def test_a_score_is_printed_and_written(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["score", str(folder / "set"), "--calibration", str(folder / "true"), "--format", "kalibr"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    said = capfd.readouterr().out
    assert "set: kalibr, 6 of 6 views, aligned by the best rigid motion, at 475 mm" in said
    assert all(f"view_{row}_{column} " in said for row in range(2) for column in range(3))
    assert "not given: the calibration has no covariance" in said
    assert results(tmp_path) == ["junit.xml", "score.json", "score.md"]
    report = json.loads((tmp_path / "score.json").read_text())
    assert report["schema"] == "mirrorcam.score/1"
    assert report["passed"] is True
    assert ElementTree.parse(tmp_path / "junit.xml").getroot().get("failures") == "0"


def test_a_figure_past_its_limit_is_exit_code_1(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("rms_px = 0.5\nshown_share = 1.0\n")
    arguments = ["score", str(folder / "set"), "--limits", str(limits), "--out", str(tmp_path / "out"), "--calibration"]
    assert main([*arguments, str(folder / "true" / "opencv.yaml")]) == 0
    assert "passed" in capfd.readouterr().out
    assert main([*arguments, str(folder / "design")]) == 1
    said = capfd.readouterr().out
    assert "failed: a figure exceeds its limit" in said
    assert "at most 0.5" in said


def test_several_sets_have_means(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sets = [str(shutil.copytree(folder / "set", tmp_path / name)) for name in ("first", "second")]
    calibrations = [str(folder / "true" / "opencv.yaml"), str(folder / "design" / "layout.json")]
    assert main(["score", *sets, "--calibration", *calibrations, "--out", str(tmp_path / "out")]) == 0
    said = capfd.readouterr().out
    assert "first: opencv" in said
    assert "second: mirrorcam" in said
    assert "over 2 sets" in said
    assert "standard error" in said


def test_bad_input_is_refused_in_one_line(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["score", str(folder / "set"), "--out", str(tmp_path / "out"), "--calibration"]
    assert_refused_here([*arguments, str(folder / "true")], capfd, "calibrations as kalibr, opencv")
    assert_refused_here([*arguments, str(tmp_path)], capfd, "no calibration in a known format")
    assert_refused_here(["score", str(folder / "set")], capfd, "--calibration")
    limits = tmp_path / "limits.toml"
    limits.write_text("rms = 1\n")
    layout = str(folder / "design" / "layout.json")
    assert_refused_here(
        [*arguments, layout, "--limits", str(limits)], capfd, "'rms' is not a figure, did you mean rms_px?"
    )
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "score.md").write_text("mine")
    assert_refused_here([*arguments, layout], capfd, "score.md")
    assert (tmp_path / "out" / "score.md").read_text() == "mine"


def test_other_units_and_flips_are_used(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["score", str(folder / "set"), "--calibration", str(folder / "true"), "--format", "colmap"]
    arguments += ["--out", str(tmp_path)]
    assert main([*arguments, "--unit", "m", "--flip", "top-bottom"]) == 0
    assert "aligned by the best rigid motion, at" in capfd.readouterr().out
    assert_refused_here([*arguments, "--unit", "mm"], capfd, "times as far apart", "--unit")


def test_the_choices_of_options_are_those_of_the_readers() -> None:
    assert get_args(Format) == FORMATS
    assert get_args(Unit) == tuple(UNITS_MM)
    assert get_args(Flip) == get_args(PictureFlip)
