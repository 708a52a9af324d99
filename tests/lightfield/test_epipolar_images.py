"""Epipolar-plane images: arrays as requested, and a figure with each view at its position and depths as slopes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.lightfield.epipolar_images import LINES, draw_epi, write_epi
from mirrorcam.optics.light_field.light_field import Axis
from mirrorcam.optics.light_field.render.epipolar_images import epi
from tests.drawn import drawn
from tests.nightly import a_few
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.mark.parametrize(("axis", "length"), a_few(1, [("s", 120), ("t", 90)]))
def test_an_image_is_cut_in_the_middle_unless_a_line_is_given(axis: Axis, length: int, tmp_path: Path) -> None:
    light_field = photograph(grid_views(), [Surface(480.0, slope=(0.2, -0.3), seed=1)])[0]
    middle = {"s": light_field.height_px // 2, "t": light_field.width_px // 2}[axis]
    reference = light_field.reference_depth_mm
    for line, depth_mm, expected in ((None, None, (axis, middle, reference)), (40, 320.0, (axis, 40, 320.0))):
        write_epi(tmp_path, "card", light_field, axis=axis, line=line, depth_mm=depth_mm)
        with np.load(tmp_path / "card_epi.npz") as arrays:
            assert (arrays["axis"], arrays["line"], arrays["plane_depth_mm"]) == expected
            assert arrays["samples"].shape == (3, length, 3)
            assert arrays["positions_mm"][1] == 0.0
    picture = read_image(tmp_path / "card_epi.png")
    assert picture.shape[1] == 1000
    assert picture.std() > 20
    with pytest.raises(InputError, match=r"line is 120 along [st], expected 0 to "):
        write_epi(tmp_path, "card", light_field, axis=axis, line=120)


@pytest.mark.parametrize("axis", ["s", "t"])
def test_bands_lie_around_view_positions_and_slopes_match_depths(axis: Axis, tmp_path: Path) -> None:
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
