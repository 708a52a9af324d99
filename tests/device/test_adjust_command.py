"""`mirrorcam cad adjust`: a row for every mirror, files beside it, and refusals in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.licence import write_source
from mirrorcam.cli import main
from tests.cad.holder.screwed import pair, with_screws
from tests.command_line import results
from tests.device.test_adjustment import misaligned


def test_turns_are_printed_written_and_drawn(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    misaligned(sigma_mm=0.01).save(tmp_path / "layout.json")
    write_source(tmp_path / "device", pair(), with_screws())
    arguments = ["cad", "adjust", str(tmp_path / "layout.json"), str(tmp_path / "device")]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    said = capfd.readouterr().out
    assert all(text in said for text in ("0-0", "0-1", "turns of a", "calibrate again after any turn"))
    assert results(tmp_path / "out") == ["turns.json", "turns.png"]


def test_a_mirror_out_of_reach_ends_with_1(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    misaligned(tilt_deg=4.0).save(tmp_path / "layout.json")
    write_source(tmp_path / "device", pair(), with_screws())
    arguments = ["cad", "adjust", str(tmp_path / "layout.json"), str(tmp_path / "device")]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 1
    assert "beyond the travel of the screws: 0-0" in capfd.readouterr().out


def test_a_device_with_glued_mirrors_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    misaligned().save(tmp_path / "layout.json")
    write_source(tmp_path / "device", pair(), HARDWARE)
    arguments = ["cad", "adjust", str(tmp_path / "layout.json"), str(tmp_path / "device")]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 2
    assert 'expected holder.mirrors = "screws"' in capfd.readouterr().err
