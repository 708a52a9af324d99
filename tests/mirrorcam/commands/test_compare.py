"""`mirrorcam compare`: a row for every view, the motion, and what has no covariance."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cli import main
from mirrorcam.optics.base.figure_texts import SIGMA
from mirrorcam.optics.geometry.layout import Layout
from tests.mirrorcam.command_line import assert_refused_here, results
from tests.optics.calibration.sound_calibration import sound_calibration, true_layout


def test_every_view_is_printed_and_what_is_not_predicted(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sound_calibration().layout.save(tmp_path / "a.json")
    true_layout().save(tmp_path / "b.json")
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "--out", str(tmp_path / "out")]) == 0
    said = capfd.readouterr().out
    assert all(f"mirror {name} " in said for name in ("0-0", "0-1", "1-0", "1-1"))
    assert "all views" in said
    assert "which is taken out" in said
    assert f"b.json has no covariance: {SIGMA} is without that of B" in said
    assert results(tmp_path / "out") == ["difference.png", "metrics.json"]


def test_another_device_is_refused_in_one_line(
    tmp_path: Path, small_layout: Layout, capfd: pytest.CaptureFixture[str]
) -> None:
    sound_calibration().layout.save(tmp_path / "a.json")
    small_layout.save(tmp_path / "b.json")
    arguments = ["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "--out", str(tmp_path / "out")]
    assert_refused_here(arguments, capfd, "b.json: the second layout has 1 x 2 mirrors, expected 2 x 2")
    assert not (tmp_path / "out").exists()
