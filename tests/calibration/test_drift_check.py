"""What a recording tells, in words and figures, and which frames of it are used."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.calibration.drift_check import (
    drift_line,
    drift_of_files,
    write_drift,
)
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.drift.drift import UNDETERMINED_DEG, Drift, MirrorMove, shows_drift
from mirrorcam.optics.geometry.layout import Layout


def drift_of(layout: Layout, *, moved: tuple[int, ...] = (), tells_deg: float = 0.013) -> Drift:
    mirrors = tuple(
        MirrorMove(k, np.array([0.02, 0.0, 0.0]), 0.01, 0.003, 0.2, tells_deg, 400, k in moved)
        for k in range(len(layout.mirrors))
    )
    return Drift(mirrors, (), np.zeros(0), np.zeros((0, 0)), np.zeros(3), np.full(3, 0.01), 5, 900, 0.04)


def test_a_line_tells_what_moved(default_layout: Layout) -> None:
    assert drift_line(default_layout, drift_of(default_layout)) == (
        "no mirror has moved: turns from 0.013° on would show in 900 points of 5 frames"
    )
    one = drift_line(default_layout, drift_of(default_layout, moved=(1,)))
    assert one == "a mirror has moved since the calibration: 0-1 by 0.020° ± 0.003°"
    two = drift_line(default_layout, drift_of(default_layout, moved=(1, 2)))
    assert two.startswith("2 mirrors have moved since the calibration: 0-1 by")


def test_too_little_texture_is_said_with_what_is_needed(default_layout: Layout) -> None:
    line = drift_line(default_layout, drift_of(default_layout, tells_deg=0.3))
    assert line.startswith("not enough texture to tell whether")
    assert "400 points matched in mirror 0-0 tell turns from 0.3° on; expected a scene with detail" in line
    assert "tell nothing" in drift_line(default_layout, drift_of(default_layout, tells_deg=UNDETERMINED_DEG))


def test_pictures_of_another_device_are_told_from_plain_ones(default_layout: Layout) -> None:
    drift = replace(drift_of(default_layout, tells_deg=UNDETERMINED_DEG), unlike=True)
    line = drift_line(default_layout, drift)
    assert "do not show what this layout's mirrors would" in line
    assert line.endswith("of another device, or of a repeating pattern?")


def test_figures_are_written_with_their_limits(default_layout: Layout, tmp_path: Path) -> None:
    write_drift(default_layout, drift_of(default_layout, moved=(1,)), tmp_path / "drift.json")
    figures = json.loads((tmp_path / "drift.json").read_text())
    assert figures["mirrors_moved"]["value"] == 1
    assert figures["view_0_1_turn_deg"]["value"] == pytest.approx(0.02)
    assert figures["view_0_1_statistic"]["limit"] == 1.0


def test_layouts_that_state_no_measured_mirrors_or_two_tell_nothing(
    default_layout: Layout, small_layout: Layout
) -> None:
    assert not shows_drift(small_layout.replaced(kind="calibrated"))
    assert not shows_drift(default_layout.replaced(kind="nominal"))
    assert shows_drift(default_layout.replaced(kind="calibrated"))


def test_a_recording_without_texture_tells_nothing(default_layout: Layout, tmp_path: Path) -> None:
    camera = default_layout.camera
    write_image(tmp_path / "0.png", np.full((camera.height_px, camera.width_px, 3), 80, np.uint8))
    drift = drift_of_files(default_layout.replaced(kind="calibrated"), [tmp_path / "0.png"])
    assert len(drift.untold) == len(default_layout.mirrors)
    assert not drift.moved
