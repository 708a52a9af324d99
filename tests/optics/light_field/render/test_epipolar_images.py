"""Epipolar-plane images of planes in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.light_field import Axis, LightField
from mirrorcam.optics.light_field.render.epipolar_images import epi
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, refocus
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

WALL = Surface(330.0, seed=4)
BEHIND_MM = -80.0


@pytest.fixture(scope="module")
def light_field() -> LightField:
    return photograph(grid_views(step_mm=10.0), [WALL], noise=0.0)[0]


@pytest.mark.parametrize(("axis", "line"), [("s", 41), ("t", 57)])
def test_points_at_the_chosen_depth_are_vertical(light_field: LightField, axis: Axis, line: int) -> None:
    found = epi(light_field, axis, line, depth_mm=330.0 + BEHIND_MM)
    length = 120 if axis == "s" else 90
    assert found.samples.shape == (3, length, 3)
    both = (found.weights > 0.99).all(axis=0)
    assert both.mean() > 0.7
    assert np.abs(np.diff(found.samples[:, both], axis=0)).mean() < 0.015
    # At other depths they are not.
    sheared = epi(light_field, axis, line)
    both &= (sheared.weights > 0.99).all(axis=0)
    assert np.abs(np.diff(sheared.samples[:, both], axis=0)).mean() > 0.05
    expected = light_field.positions_mm[1, :, 0] if axis == "s" else light_field.positions_mm[:, 1, 1]
    np.testing.assert_array_equal(found.positions_mm, expected)


@pytest.mark.parametrize("axis", ["s", "t"])
def test_the_middle_line_shows_the_reference_view(light_field: LightField, axis: Axis) -> None:
    found = epi(light_field, axis, 30)
    central = light_field.samples[1, 1] / np.float32(255.0)
    np.testing.assert_allclose(found.samples[1], central[30] if axis == "s" else central[:, 30], atol=1e-6)


def test_slopes_match_those_of_points(light_field: LightField) -> None:
    depth = 330.0 + BEHIND_MM
    found = epi(light_field, "s", 41)
    slope = found.slope_px_per_mm(light_field, depth)
    # For views with a position along z, u is that of their pinhole; the law of slopes ignores z.
    flat = grid_views(step_mm=10.0, uneven=False)
    point = flat.plane_points_in_rig(depth, np.array([60.0, 41.0]))
    seen = flat.project(point)[1, :, 0]
    np.testing.assert_allclose(np.diff(seen), slope * 10.0, rtol=1e-9)
    upright = epi(light_field, "s", 41, depth_mm=depth)
    assert upright.slope_px_per_mm(light_field, depth) == 0.0


def test_the_mean_of_an_upright_epi_is_a_line_of_the_refocused_picture(light_field: LightField) -> None:
    depth = 330.0 + BEHIND_MM
    middle = np.zeros((3, 3), np.float32)
    middle[1] = 1.0
    picture = refocus(light_field, FocalPlane.at_depth(light_field, depth), view_weights=middle)
    found = epi(light_field, "s", 41, depth_mm=depth)
    total = (found.samples * found.weights[..., None]).sum(axis=0) / found.weights.sum(axis=0)[:, None]
    np.testing.assert_allclose(total, picture.image[41], atol=0.01)


@pytest.mark.parametrize(
    ("axis", "line", "depth_mm", "message"),
    [
        ("s", 90, None, "line is 90 along s, expected 0 to 89"),
        ("t", -1, None, "line is -1 along t, expected 0 to 119"),
        ("s", 5, -90.0, "focus at -90 mm, expected a depth beyond the views"),
    ],
)
def test_impossible_cuts_are_refused(
    light_field: LightField, axis: Axis, line: int, depth_mm: float | None, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        epi(light_field, axis, line, depth_mm=depth_mm)


def test_one_row_of_views_has_no_column() -> None:
    row = photograph(grid_views(1, 3), [WALL])[0]
    with pytest.raises(InputError, match="one view along t, expected two or more"):
        epi(row, "t", 5)
