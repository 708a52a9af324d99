"""The picture of an epipolar-plane image shows every view at its place in mm, and depths as slopes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.lightfield.epi_figure import LINES, draw_epi
from mirrorcam.optics.light_field.light_field import Axis
from mirrorcam.optics.light_field.render.epipolar_images import epi
from tests.drawn import drawn
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.mark.parametrize("axis", ["s", "t"])
def test_bands_lie_around_the_places_of_views_and_slopes_are_those_of_depths(axis: Axis, tmp_path: Path) -> None:
    light_field, _, _ = photograph(grid_views(), [Surface(500.0)])
    found = epi(light_field, axis, 20)
    path = tmp_path / "epi.png"
    figure = drawn(lambda: draw_epi(path, light_field, found, (400.0, 900.0)), path)
    above, below = figure.axes
    assert np.asarray(above.lines[0].get_ydata())[0] == 20
    assert len(below.images) == len(found.positions_mm)
    for image, place in zip(below.images, found.positions_mm, strict=True):
        _, _, high, low = image.get_extent()
        assert low < place < high
    assert len(below.lines) == LINES
    for line, depth in zip(below.lines, (1.0 / np.linspace(1 / 400.0, 1 / 900.0, LINES)).tolist(), strict=True):
        along, places = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        assert np.ptp(along) == pytest.approx(abs(found.slope_px_per_mm(light_field, depth)) * np.ptp(places))
