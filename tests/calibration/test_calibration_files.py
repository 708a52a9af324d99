"""A calibration request checks itself, a calibration becomes five files, and corners in files calibrate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mirrorcam.calibration.calibration_files import CalibrationRequest, calibrate_files, write_calibration
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import save_board
from mirrorcam.run.run_page import read_metrics
from tests.optics.calibration.sound_calibration import BOARD, nominal_layout, sound_calibration


def test_a_request_has_a_layout_or_a_number_of_mirrors() -> None:
    board = Path("board.toml")
    both: dict[str, Any] = {"layout": Path("layout.json"), "mirrors": 2}
    for wrong in ({}, both):
        with pytest.raises(InputError, match="expected a nominal layout, or the number of mirrors"):
            CalibrationRequest(pictures=(Path("a.png"),), board=board, **wrong)


def test_files_hold_the_calibration(tmp_path: Path) -> None:
    calibration = sound_calibration()
    write_calibration(calibration, tmp_path, command="mirrorcam test")
    names = ["corners.csv", "layout.json", "metrics.json", "report.html", "residuals.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert Layout.load(tmp_path / "layout.json") == calibration.layout
    assert read_metrics(tmp_path / "metrics.json") == calibration.metrics
    assert "mirrorcam test" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_request_has_pictures_or_corners() -> None:
    board, layout = Path("board.toml"), Path("layout.json")
    both: dict[str, Any] = {"pictures": (Path("a.png"),), "corners": (Path("a.csv"),)}
    for wrong in ({"layout": layout}, both | {"layout": layout}, {"corners": (Path("a.csv"),), "mirrors": 2}):
        with pytest.raises(InputError, match="expected pictures, or tables of corners with a nominal layout"):
            CalibrationRequest(board=board, **wrong)


@pytest.fixture
def corner_request(tmp_path: Path) -> CalibrationRequest:
    """A request with the corners of the sound calibration as two tables, of frames with and without mirrors."""
    write_calibration(sound_calibration(), tmp_path, command="mirrorcam test")
    nominal_layout().save(tmp_path / "nominal.json")
    save_board(tmp_path / "board.toml", BOARD)
    heads, *lines = [line for line in (tmp_path / "corners.csv").read_text().splitlines() if line[0] != "#"]
    for name, wanted in (("mirrors.csv", False), ("bare.csv", True)):
        kept = [heads, *(line for line in lines if (",direct," in line) == wanted)]
        (tmp_path / name).write_text("\n".join(kept) + "\n")
    tables = (tmp_path / "mirrors.csv", tmp_path / "bare.csv")
    return CalibrationRequest(board=tmp_path / "board.toml", layout=tmp_path / "nominal.json", corners=tables)


def test_tables_of_corners_calibrate_as_their_pictures_did(corner_request: CalibrationRequest) -> None:
    found, first = calibrate_files(corner_request), sound_calibration()
    assert found.pictures == first.pictures
    assert found.metrics["corners"] == first.metrics["corners"]
    for mirror, same in zip(found.layout.mirrors, first.layout.mirrors, strict=True):
        assert mirror.virtual_centre_in_rig_mm == pytest.approx(same.virtual_centre_in_rig_mm, abs=0.01)


def test_corners_without_mirrors_and_unknown_levels_are_refused(corner_request: CalibrationRequest) -> None:
    with pytest.raises(InputError, match=r"bare\.csv: all corners are seen directly, expected pictures through"):
        calibrate_files(replace(corner_request, corners=corner_request.corners[1:]))
    with pytest.raises(InputError, match="level"):
        calibrate_files(replace(corner_request, level="most"))
