"""`mirrorcam compare`: a row for every view, the motion, and what has no covariance."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mirrorcam.cli import main
from mirrorcam.core.figures.figure_texts import SIGMA
from mirrorcam.optics.geometry.layout import Layout
from tests.command_line import assert_refused_here, results
from tests.optics.calibration.sound_calibration import nominal_layout, sound_calibration, true_layout


def test_every_view_is_printed_and_what_is_not_predicted(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sound_calibration().layout.save(tmp_path / "a.json")
    true_layout().save(tmp_path / "b.json")
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "--out", str(tmp_path / "out")]) == 0
    said = capfd.readouterr().out
    assert all(f"mirror {name} " in said for name in ("0-0", "0-1", "1-0", "1-1"))
    assert "all views" in said
    assert "is removed" in said
    assert f"b.json has no covariance: {SIGMA} leaves out the covariance of B" in said
    assert "the difference is within noise: at most " in said
    assert results(tmp_path / "out") == ["difference.png", "metrics.json"]


def test_whether_the_difference_exceeds_noise_is_stated(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """By the worst view; of a layout and itself, no rounding is printed."""
    layout = sound_calibration().layout
    layout.save(tmp_path / "a.json")
    mirror = layout.mirrors[2]
    moved = mirror.replaced(
        virtual_centre_in_rig_mm=1.01 * mirror.virtual_centre_in_rig_mm,
        outline_in_rig_mm=1.01 * mirror.outline_in_rig_mm,
    )
    layout.replaced(mirrors=(*layout.mirrors[:2], moved, *layout.mirrors[3:])).save(tmp_path / "b.json")
    said = {}
    for other in ("a", "b"):
        arguments = ["compare", str(tmp_path / "a.json"), str(tmp_path / f"{other}.json")]
        assert main([*arguments, "--out", str(tmp_path / other)]) == 0
        said[other] = capfd.readouterr().out
    assert "the calibrations do not differ" in said["a"]
    assert "e-1" not in said["a"]
    assert re.search(rf"the difference is more than noise: \d+ times the predicted {SIGMA}, in mirror 1-0", said["b"])


def test_without_any_covariance_the_verdict_is_open(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    true_layout().save(tmp_path / "a.json")
    nominal_layout().save(tmp_path / "b.json")
    paths = [str(tmp_path / f"{name}.json") for name in "ab"]
    assert main(["compare", *paths, "--distance-mm", "400", "--out", str(tmp_path / "out")]) == 0
    assert "cannot compare the difference with noise" in capfd.readouterr().out


def test_another_device_is_refused_in_one_line(
    tmp_path: Path, small_layout: Layout, capfd: pytest.CaptureFixture[str]
) -> None:
    sound_calibration().layout.save(tmp_path / "a.json")
    small_layout.save(tmp_path / "b.json")
    arguments = ["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "--out", str(tmp_path / "out")]
    assert_refused_here(arguments, capfd, "b.json: the second layout has 1 x 2 mirrors, expected 2 x 2")
    assert not (tmp_path / "out").exists()
