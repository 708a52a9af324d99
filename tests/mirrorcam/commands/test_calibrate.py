"""`mirrorcam calibrate`: which options go together, what it refuses, and an exit code that tells of alarms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam import cli
from mirrorcam.optics.base.pictures import write_image
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import default_board, save_board
from tests.mirrorcam.command_line import assert_refused_here
from tests.optics.calibration.sound_calibration import sound_calibration

TOGETHER = "--direct-view goes with --mirrors N, without --layout and --base"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("", "expected --layout LAYOUT, or --direct-view"),
        ("--layout layout.json --mirrors 2", "expected --layout LAYOUT, or --direct-view"),
        ("--direct-view", TOGETHER),
        ("--direct-view --mirrors 2 --layout layout.json", TOGETHER),
        ("--direct-view --mirrors 2 --base base", TOGETHER),
        ("--direct-view --mirrors 2 --level paper", "--level and --live-hint go with --layout"),
        ("--direct-view --mirrors 2 --live-hint", "--level and --live-hint go with --layout"),
        ("--direct-view --mirrors 5", "--mirrors 5: Input should be less than or equal to 4"),
        ("--layout nowhere.json", "no such file"),
    ],
)
def test_options_that_do_not_go_together_are_refused_in_one_line(
    arguments: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(["calibrate", "picture.png", "--board", "board.toml", *arguments.split()], capfd, expected)
    assert list(tmp_path.iterdir()) == []


def test_pictures_without_a_corner_are_refused(
    tmp_path: Path, default_layout: Layout, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    default_layout.save(tmp_path / "layout.json")
    save_board(tmp_path / "board.toml", default_board())
    for name in ("one.png", "two.png", "base.png"):
        write_image(tmp_path / name, np.zeros((1080, 1920, 3), dtype=np.uint8))
    arguments = "calibrate one.png two.png --base base.png --layout layout.json --board board.toml --out calibrated"
    before = set(tmp_path.rglob("*"))
    assert_refused_here(arguments.split(), capfd, "no corner of the board found in any of 2 frames")
    # What was found in the pictures is kept, so that they are not searched again beside better ones.
    kept = tmp_path / "calibrated" / "detections"
    assert {path for path in tmp_path.rglob("*") if path.is_file()} - before == set(kept.iterdir())


@pytest.mark.parametrize("alarms", [(), ("the mirrors bend",)])
def test_an_alarm_is_printed_and_ends_it_with_1(
    alarms: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    sound = sound_calibration()
    assert sound.diagnostics is not None
    found = replace(sound, notes=("a note",), diagnostics=replace(sound.diagnostics, alarms=alarms))
    written: list[Path] = []
    files = "mirrorcam.workflow.calibration_files"
    monkeypatch.setattr(f"{files}.calibrate_files", lambda request, progress, on_hint: found)
    monkeypatch.setattr(f"{files}.write_calibration", lambda result, folder, command: written.append(folder))
    arguments = ["calibrate", "picture.png", "--board", "board.toml", "--layout", "layout.json", "--out", str(tmp_path)]
    assert cli.main(arguments) == len(alarms)
    printed = capfd.readouterr().out
    assert "a note" in printed
    assert ("alarm: the mirrors bend" in printed) == bool(alarms)
    assert "mirror 0" not in printed  # figures of single mirrors are in the report
    assert [folder.is_relative_to(tmp_path) for folder in written] == [True]
