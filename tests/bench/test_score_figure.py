"""The picture of a score shows every view's errors where the sensor has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.collections import PatchCollection

from mirrorcam.bench.evaluation_files import score_figure, view_errors
from mirrorcam.bench.scores.calibration_score import score_calibration
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.geometry.layout import Layout
from tests.drawn import drawn, values_of


def test_errors_of_every_view_are_drawn(default_layout: Layout, tmp_path: Path) -> None:
    camera = default_layout.camera
    longer = default_layout.replaced(camera=camera.replaced(fx_px=1.01 * camera.fx_px, fy_px=1.01 * camera.fy_px))
    longer.save(tmp_path / "layout.json")
    score = score_calibration(read_rig(tmp_path / "layout.json"), default_layout, default_layout, 400.0)
    errors = view_errors(score)
    assert [view.view for view in errors] == list(range(9))
    for view in errors:
        assert np.isfinite(view.length_px).all() and view.length_px.max() > 0.1
    path = tmp_path / "score.png"
    figure = drawn(lambda: score_figure(score, default_layout, path, title="a set"), path)
    shown = [item for item in figure.axes[0].collections if isinstance(item, PatchCollection)]
    for item, view in zip(shown, errors, strict=True):
        np.testing.assert_allclose(values_of(item), view.length_px)
    assert figure.axes[0].get_title().startswith("a set: error in px at 400 mm")
