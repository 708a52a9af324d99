"""`mirrorcam validate`: a folder without a set is refused; a figure past its limit ends it with 1."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.calibration.validation import Validation
from mirrorcam.core.values import Metric
from tests.command_line import assert_refused_here
from tests.optics.calibration.sound_calibration import sound_calibration


def test_a_folder_without_a_set_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(["validate", "nowhere"], capfd, "nowhere/dataset.json: no such file")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error_deg", "code", "verdict"),
    [
        (0.02, 0, "passed"),
        (0.021, 1, "failed: a figure exceeds its limit"),
        (float("nan"), 1, "failed: a figure that has a limit could not be computed"),
    ],
)
def test_figures_are_printed_with_their_limits_and_decide_about_the_exit_code(
    error_deg: float,
    code: int,
    verdict: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    metrics = {
        "normal_error_max_deg": Metric(value=error_deg, unit="deg", limit=0.02),
        "corners": Metric(value=40000.0, unit="1"),
    }
    written: list[tuple[Validation, Path]] = []
    monkeypatch.setattr(
        "mirrorcam.calibration.validation.validate", lambda folder, progress: Validation(sound_calibration(), metrics)
    )
    monkeypatch.setattr(
        "mirrorcam.calibration.validation.write_validation",
        lambda made, folder, command: written.append((made, folder)),
    )
    assert cli.main(["validate", "set", "--out", str(tmp_path)]) == code
    printed = capfd.readouterr().out
    assert ("none" if math.isnan(error_deg) else f"{error_deg:g}") in printed
    assert ("FAIL" in printed) == bool(code)
    assert printed.rstrip().endswith(verdict)
    ((made, folder),) = written
    assert made.metrics == metrics
    assert folder.is_relative_to(tmp_path)
