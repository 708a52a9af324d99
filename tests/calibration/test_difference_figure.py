"""The map of a difference shows every view where the sensor has it, on one scale with what is predicted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure

from mirrorcam.calibration.difference_figure import difference_figure
from mirrorcam.core.figures.figure_texts import SIGMA
from mirrorcam.optics.calibration.diagnostics.calibration_difference import calibration_difference
from mirrorcam.optics.geometry.layout import Layout
from tests.drawn import drawn, values_of
from tests.optics.calibration.sound_calibration import nominal_layout, sound_calibration


def maps(figure: Figure, panel: int) -> list[PatchCollection]:
    return [item for item in figure.axes[panel].collections if isinstance(item, PatchCollection)]


def test_every_view_is_shown_with_what_is_predicted_on_one_scale(tmp_path: Path) -> None:
    a, b = nominal_layout(), sound_calibration().layout
    difference = calibration_difference(a, b, range_mm=400.0)
    path = tmp_path / "difference.png"
    figure = drawn(lambda: difference_figure(difference, a, path), path)
    expected = [("length_px", "difference, px"), ("sigma_px", f"predicted {SIGMA} of B alone, px")]
    expected += [("difference_mm", "difference, mm"), ("sigma_mm", f"predicted {SIGMA} of B alone, mm")]
    for panel, (values, title) in enumerate(expected):
        assert figure.axes[panel].get_title().startswith(f"{title} (RMS of each view")
        shown = maps(figure, panel)
        assert len(shown) == len(difference.views) == 4
        for item, view in zip(shown, difference.views, strict=True):
            np.testing.assert_allclose(values_of(item), getattr(view, values))
        assert {item.get_clim() for item in shown} == {maps(figure, panel // 2 * 2)[0].get_clim()}


def test_nothing_is_predicted_of_layouts_without_covariance(small_layout: Layout, tmp_path: Path) -> None:
    """The direct view, of a layout whose views look along the camera's axis, has panels of its own."""
    layout = small_layout.replaced(view_from_rig=np.eye(3))
    difference = calibration_difference(layout, layout, range_mm=400.0)
    path = tmp_path / "difference.png"
    figure = drawn(lambda: difference_figure(difference, layout, path), path)
    assert [len(maps(figure, panel)) for panel in range(4)] == [2, 1, 2, 1]
