"""A drift test from files: figures, and the re-solved layout where a mirror moved."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam.calibration import drift_check
from mirrorcam.calibration.drift_files import find_drift_files, write_drift_files
from mirrorcam.calibration.stiffness import MountTilt
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from tests.command_line import results
from tests.core.video.videos import pictures, write_h264
from tests.optics.drift.calibrated_device import device, turn_error_deg, turned
from tests.optics.drift.textured_scenes import Shot, fractal, photograph, scene


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
    with pytest.raises(InputError, match=r"layout\.json: is a nominal layout, expected a calibrated one"):
        find_drift_files([Path("frame.png")], default_layout.replaced(kind="nominal"), Path("layout.json"))


def test_two_mirrors_are_refused(small_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"layout\.json: has 2 mirrors, expected a calibrated one of 3 mirrors"):
        find_drift_files([Path("frame.png")], small_layout.replaced(kind="calibrated"), Path("layout.json"))
