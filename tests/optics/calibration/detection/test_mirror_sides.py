"""Sides of a polygon, and the part of a mirror that shows the scene."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.mirror_sides import Side, shown_in_plane_mm
from tests.optics.calibration.detection.mirror_frames import MEANT

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])


@pytest.mark.parametrize("polygon", [SQUARE, SQUARE[::-1]])
def test_a_side_runs_along_its_edge_and_points_outwards(polygon: FloatArray) -> None:
    for edge in range(4):
        side = Side.of(polygon, edge)
        np.testing.assert_allclose(side.start + side.length_mm * side.along, polygon[(edge + 1) % 4])
        assert abs(side.along @ side.outward) < 1e-12
        assert side.outward @ (side.start - polygon.mean(axis=0)) > 0.0


def test_a_side_moves_by_the_offsets_at_the_ends_of_another() -> None:
    side = Side.of(SQUARE, 0)
    nx, ny, d = side.moved(side, np.array([0.5, 0.5]))
    assert abs(ny) == pytest.approx(1.0)
    assert nx == pytest.approx(0.0)
    assert d / ny == pytest.approx(-0.5)
    nx, ny, d = side.moved(side, np.array([0.0, 0.4]))
    assert nx * 0.0 == pytest.approx(d)
    assert (d - nx * 4.0) / ny == pytest.approx(-0.4)


def test_a_first_surface_mirror_shows_the_scene_on_all_of_it_and_a_plate_on_less() -> None:
    mirror = MEANT.mirrors[0]
    np.testing.assert_array_equal(shown_in_plane_mm(mirror), mirror.apparent.outline_in_plane_mm)
    plate = mirror.replaced(surface="second", thickness_mm=2.0)
    shown, whole = Polygon(shown_in_plane_mm(plate)), Polygon(plate.apparent.outline_in_plane_mm)
    assert 0.8 * whole.area < shown.area < 0.99 * whole.area
