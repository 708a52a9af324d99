"""How far parts bend stands beside what all mirrors show together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.calibration.stiffness import bending_line, mount_tilt
from mirrorcam.core.disk.files import write_json, write_metrics
from mirrorcam.core.values import InputError, Metric
from mirrorcam.optics.drift.drift import Drift

STILL = Drift((), (), np.zeros(0), np.zeros((0, 0)), np.array([0.01, 0.0, 0.0]), np.full(3, 0.01), 5, 900, 0.04)


def test_the_figure_of_the_device_is_read(tmp_path: Path) -> None:
    write_metrics(tmp_path / "checks.json", {"mount.tilt_deg": Metric(value=0.031, unit="deg", limit=0.05)})
    assert mount_tilt(tmp_path / "checks.json").deg == 0.031
    assert mount_tilt(None).deg == HARDWARE.mount.tilt_deg


@pytest.mark.parametrize("content", [{}, [], {"mount.tilt_deg": 3}, {"mount.tilt_deg": {"value": "x"}}])
def test_files_without_it_are_refused(tmp_path: Path, content: object) -> None:
    write_json(tmp_path / "checks.json", content)
    with pytest.raises(InputError, match=r"checks\.json: no angle mount\.tilt_deg in it"):
        mount_tilt(tmp_path / "checks.json")


def test_a_common_turn_within_bending_is_no_alarm_and_one_beyond_it_is_said() -> None:
    tilt = mount_tilt(None)
    assert bending_line(STILL, tilt).startswith("gravity bends the mount by 0.05° at most (the limit")
    slipped = replace(STILL, common_turn_deg=np.array([0.0, 0.3, 0.0]))
    assert bending_line(slipped, tilt).startswith("all mirrors together have turned by 0.3° ± 0.01° about y of the rig")
