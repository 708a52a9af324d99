"""What a recording tells, in words and figures, and which frames of it are used."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.calibration import drift_check
from mirrorcam.calibration.drift_check import (
    MountTilt,
    bending_line,
    drift_line,
    find_drift_files,
    mount_tilt,
    write_drift,
    write_drift_files,
)
from mirrorcam.core.disk.files import write_json, write_metrics
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import Metric
from mirrorcam.optics.drift.drift import UNDETERMINED_DEG, Drift, MirrorMove, can_test_drift
from mirrorcam.optics.geometry.layout import Layout
from tests.command_line import results
from tests.core.video.videos import pictures, write_h264
from tests.optics.drift.calibrated_device import device, turn_error_deg, turned
from tests.optics.drift.textured_scenes import Shot, fractal, photograph, scene


def drift_of(layout: Layout, *, moved: tuple[int, ...] = (), tells_deg: float = 0.013) -> Drift:
    mirrors = tuple(
        MirrorMove(k, np.array([0.02, 0.0, 0.0]), 0.01, 0.003, 0.2, tells_deg, 400, k in moved)
        for k in range(len(layout.mirrors))
    )
    return Drift(mirrors, (), np.zeros(0), np.zeros((0, 0)), np.zeros(3), np.full(3, 0.01), 5, 900, 0.04)


def test_a_line_tells_what_moved(default_layout: Layout) -> None:
    assert drift_line(default_layout, drift_of(default_layout)) == (
        "no mirror has moved: rotations of 0.013° or more would show in 900 points of 5 frames"
    )
    one = drift_line(default_layout, drift_of(default_layout, moved=(1,)))
    assert one == "a mirror has moved since the calibration: 0-1 by 0.020° ± 0.003°"
    two = drift_line(default_layout, drift_of(default_layout, moved=(1, 2)))
    assert two.startswith("2 mirrors have moved since the calibration: 0-1 by")


def test_too_little_texture_is_said_with_what_is_needed(default_layout: Layout) -> None:
    line = drift_line(default_layout, drift_of(default_layout, tells_deg=0.3))
    assert line.startswith("not enough texture to determine whether")
    assert "400 points matched in mirror 0-0 show rotations of 0.3° or more; expected a scene with detail" in line
    assert "show nothing" in drift_line(default_layout, drift_of(default_layout, tells_deg=UNDETERMINED_DEG))


def test_pictures_of_another_device_are_told_from_plain_ones(default_layout: Layout) -> None:
    drift = replace(drift_of(default_layout, tells_deg=UNDETERMINED_DEG), mismatched=True)
    line = drift_line(default_layout, drift)
    assert "do not fit this layout" in line
    assert line.endswith("is it another device, or a repeating pattern?")


def test_figures_are_written_with_their_limits(default_layout: Layout, tmp_path: Path) -> None:
    write_drift(default_layout, drift_of(default_layout, moved=(1,)), tmp_path / "drift.json")
    figures = json.loads((tmp_path / "drift.json").read_text())
    assert figures["mirrors_moved"]["value"] == 1
    assert figures["view_0_1_turn_deg"]["value"] == pytest.approx(0.02)
    assert figures["view_0_1_statistic"]["limit"] == 1.0


def test_layouts_that_state_no_measured_mirrors_or_two_tell_nothing(
    default_layout: Layout, small_layout: Layout
) -> None:
    assert not can_test_drift(small_layout.replaced(kind="calibrated"))
    assert not can_test_drift(default_layout.replaced(kind="nominal"))
    assert can_test_drift(default_layout.replaced(kind="calibrated"))


def test_a_recording_without_texture_tells_nothing(default_layout: Layout, tmp_path: Path) -> None:
    camera = default_layout.camera
    write_image(tmp_path / "0.png", np.full((camera.height_px, camera.width_px, 3), 80, np.uint8))
    drift = find_drift_files([tmp_path / "0.png"], default_layout.replaced(kind="calibrated"), tmp_path / "layout.json")
    assert len(drift.undetermined) == len(default_layout.mirrors)
    assert not drift.moved


@pytest.mark.slow
def test_a_moved_mirror_is_written_where_it_is(tmp_path: Path) -> None:
    random, truth = np.random.default_rng(1), device().truth
    sheets = scene(random, (250.0, 600.0), [fractal(random, slope=0.8)], truth.camera.fx_px)
    write_image(tmp_path / "frame.png", photograph(truth, sheets, Shot(), random))
    moved = turned(device().calibrated, 4, np.array([0.04, 0.0, 0.03]))
    drift = find_drift_files([tmp_path / "frame.png"], moved, tmp_path / "layout.json")
    write_drift_files(moved, drift, MountTilt(0.03, "checks.json"), ["frame.png"], tmp_path / "out")
    assert results(tmp_path / "out") == ["drift.json", "layout.json"]
    assert json.loads((tmp_path / "out" / "drift.json").read_text())["mount_tilt_deg"]["value"] == 0.03
    found = Layout.load(tmp_path / "out" / "layout.json")
    assert turn_error_deg(found, device().calibrated, 4) < 0.01
    assert found.provenance["resolved_by"] == "a scene in frame.png"


def test_what_to_know_of_a_video_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drift_check, "drift_of", lambda layout, frames: None)
    layout, said = device().calibrated, list[str]()
    path = write_h264(tmp_path / "a.mp4", pictures(2, layout.camera.width_px, layout.camera.height_px), interlaced=True)
    find_drift_files([path], layout, tmp_path / "layout.json", said.append)
    assert [line.startswith("a.mp4 is interlaced: ") for line in said] == [True]
    dark = np.full((layout.camera.height_px, layout.camera.width_px), 4000, np.uint16)
    assert cv2.imwrite(str(tmp_path / "a.png"), dark)
    find_drift_files([tmp_path / "a.png"], layout, tmp_path / "layout.json", said.append)
    assert "the lowest 12 of these bits" in said[1]


def test_a_nominal_layout_is_refused(default_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"layout\.json: is a nominal layout, expected a calibrated layout"):
        find_drift_files([Path("frame.png")], default_layout.replaced(kind="nominal"), Path("layout.json"))


def test_two_mirrors_are_refused(small_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"layout\.json: has 2 mirrors, expected a calibrated layout of 3 mirrors"):
        find_drift_files([Path("frame.png")], small_layout.replaced(kind="calibrated"), Path("layout.json"))


STILL = Drift((), (), np.zeros(0), np.zeros((0, 0)), np.array([0.01, 0.0, 0.0]), np.full(3, 0.01), 5, 900, 0.04)


def test_the_figure_of_the_device_is_read(tmp_path: Path) -> None:
    write_metrics(tmp_path / "checks.json", {"mount.tilt_deg": Metric(value=0.031, unit="deg", limit=0.05)})
    assert mount_tilt(tmp_path / "checks.json").deg == 0.031
    assert mount_tilt(None).deg == HARDWARE.mount.tilt_deg


@pytest.mark.parametrize("content", [{}, [], {"mount.tilt_deg": 3}, {"mount.tilt_deg": {"value": "x"}}])
def test_files_without_it_are_refused(tmp_path: Path, content: object) -> None:
    write_json(tmp_path / "checks.json", content)
    with pytest.raises(InputError, match=r"checks\.json: no angle mount\.tilt_deg"):
        mount_tilt(tmp_path / "checks.json")


def test_a_common_turn_within_bending_is_no_alarm_and_one_beyond_it_is_said() -> None:
    tilt = mount_tilt(None)
    assert bending_line(STILL, tilt).startswith("gravity bends the mount by 0.05° at most (the limit")
    slipped = replace(STILL, common_rotation_deg=np.array([0.0, 0.3, 0.0]))
    assert bending_line(slipped, tilt).startswith(
        "all mirrors together have rotated by 0.3° ± 0.01° about y of the rig"
    )
