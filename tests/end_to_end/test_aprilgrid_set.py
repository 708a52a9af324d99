"""A set of Kalibr's AprilGrid by the fast renderer, calibrated blind and held against its sealed truth."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.calibration.validation import validate
from mirrorcam.optics.geometry.boards import AprilGrid, load_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings

BOARD = AprilGrid(cols=10, rows=7, tag_mm=18.0, spacing=0.3)


@pytest.mark.slow
def test_every_limit_is_met(default_layout: Layout, tmp_path: Path) -> None:
    request = SetRequest(
        layout=default_layout,
        board=BOARD,
        frames=6,
        base_frames=3,
        seed=0,
        tolerances=Tolerances(tilt_deg=0.3, offset_mm=0.3),
        settings=RenderSettings(renderer="fast"),
    )
    render_set(request, tmp_path / "set")
    assert load_board(tmp_path / "set" / "board.toml") == BOARD
    validation = validate(tmp_path / "set")
    assert validation.metrics["corners"].value > 6000
    limited = {name: metric for name, metric in validation.metrics.items() if metric.known and metric.limit is not None}
    assert all(metric.passed for metric in limited.values()), limited
