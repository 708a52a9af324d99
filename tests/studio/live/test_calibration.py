"""A calibration as a process of its own: done, failed, and cancelled."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.studio.live.calibration import CalibrationRun
from tests.shared import built_once
from tests.small_set import BOARD


@pytest.fixture(scope="module")
def whole_set(default_layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set that a calibration can be made of: ten frames of 640 x 360 pixels."""
    full = default_layout.camera
    focal = {"fx_px": full.fx_px / 3.0, "fy_px": full.fy_px / 3.0}
    layout = default_layout.replaced(camera=Camera(width_px=640, height_px=360, cx_px=319.5, cy_px=179.5, **focal))
    settings = RenderSettings(renderer="fast", maps=False)
    request = SetRequest(layout=layout, target=BOARD, frames=10, base_frames=0, seed=5, settings=settings)
    return built_once(tmp_path_factory, "live_calibration_set", lambda out: render_set(request, out))


def test_a_calibration_gives_its_report(whole_set: Path, tmp_path: Path) -> None:
    out = tmp_path / "calibrated"
    run = CalibrationRun(whole_set / "frames", whole_set / "board.toml", whole_set / "layout.json", out)
    found = run.wait(120.0)
    assert found.state in ("done", "alarm"), found.lines
    assert found.report == out / "report.html" and found.report.is_file()
    assert found.layout is not None and found.layout.is_file() and found.lines


def test_one_that_cannot_be_says_why(finished_set: Path, tmp_path: Path) -> None:
    board, layout = finished_set / "board.toml", finished_set / "layout.json"
    found = CalibrationRun(tmp_path / "none", board, layout, tmp_path / "out").wait(60.0)
    assert found.state == "failed" and found.report is None and "none" in " ".join(found.lines)


def test_one_that_is_cancelled_leaves_no_report(finished_set: Path, tmp_path: Path) -> None:
    board, layout = finished_set / "board.toml", finished_set / "layout.json"
    run = CalibrationRun(finished_set / "frames", board, layout, tmp_path / "out")
    assert run.wait(0.01).state == "running"
    run.cancel()
    assert run.state().state == "cancelled" and run.state().report is None
    run.cancel()
