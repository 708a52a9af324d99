"""The picture of a calibration shows the residuals of every view where they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver

from mirrorcam.calibration.calibration_figure import residual_figure
from mirrorcam.optics.calibration.diagnostics.view_statistics import cell_means
from tests.drawn import drawn
from tests.optics.calibration.sound_calibration import sound_calibration


@pytest.fixture(scope="module")
def figure(tmp_path_factory: pytest.TempPathFactory) -> Figure:
    path = tmp_path_factory.mktemp("figure") / "residuals.png"
    return drawn(lambda: residual_figure(sound_calibration(), path), path)


def test_an_arrow_for_every_cell_of_every_view(figure: Figure) -> None:
    calibration = sound_calibration()
    arrows = [item for item in figure.axes[0].collections if isinstance(item, Quiver)]
    views = np.unique(calibration.observations.view)
    assert len(arrows) == len(views) == 5
    for item, view in zip(arrows, views, strict=True):
        means = cell_means(calibration, int(view))
        assert np.allclose(item.get_offsets(), means.at_px)
        drawn_px, mean_px = np.hypot(item.U, item.V), np.linalg.norm(means.mean_px, axis=1)
        assert np.allclose(drawn_px / drawn_px.max(), mean_px / mean_px.max())


def test_all_residuals_that_count_are_in_the_distribution(figure: Figure) -> None:
    calibration = sound_calibration()
    used = int(calibration.inliers.sum())
    assert figure.axes[1].get_title().startswith(f"{used} corners")
    assert len(figure.axes[1].patches) == 2


def test_the_same_calibration_gives_the_same_picture(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        residual_figure(sound_calibration(), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
