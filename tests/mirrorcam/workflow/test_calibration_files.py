"""A calibration request checks itself, and a calibration becomes four files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.pages.run_page import read_metrics
from mirrorcam.workflow.calibration_files import CalibrationRequest, write_calibration
from tests.optics.calibration.sound_calibration import sound_calibration


def test_a_request_has_a_layout_or_a_number_of_mirrors() -> None:
    board = Path("board.toml")
    both: dict[str, Any] = {"layout": Path("layout.json"), "mirrors": 2}
    for wrong in ({}, both):
        with pytest.raises(InputError, match="expected a nominal layout, or the number of mirrors"):
            CalibrationRequest(pictures=(Path("a.png"),), board=board, **wrong)


def test_files_hold_the_calibration(tmp_path: Path) -> None:
    calibration = sound_calibration()
    write_calibration(calibration, tmp_path, command="mirrorcam test")
    names = ["layout.json", "metrics.json", "report.html", "residuals.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert Layout.load(tmp_path / "layout.json") == calibration.layout
    assert read_metrics(tmp_path / "metrics.json") == calibration.metrics
    assert "mirrorcam test" in (tmp_path / "report.html").read_text(encoding="utf-8")
