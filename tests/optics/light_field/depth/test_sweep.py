"""Planes of a sweep, against the pinholes of the views."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.sweep import (
    MARGIN_PLANES,
    MIN_PLANES,
    NEIGHBOUR_PX,
    NO_SURFACE,
    TILE_PX,
    Ranges,
    Volume,
    full_range,
    nearest_planes,
    range_around,
    sweep,
    tracked_range,
)
from tests.optics.light_field.depth.surfaces import Surface, everywhere, grid_views, met

INVERSE_DISTANCES = np.linspace(1 / 800.0, 1 / 300.0, 11)
FINE_INVERSE_DISTANCES = np.linspace(1 / 700.0, 1 / 300.0, 21)


def test_pixels_match_points_on_the_planes() -> None:
    views = grid_views(2, 3)
    planes = sweep(views, INVERSE_DISTANCES)
    others = [index for index in np.ndindex(2, 3) if views.positions_mm[index].any()]
    for plane in (0, 4, 10):
        distance = 1.0 / INVERSE_DISTANCES[plane]
        u, v = 31.0, 70.0
        # The pinhole of the reference view: its principal point belongs to the reference plane.
        point = np.array([*((np.array([u, v]) - views.centre_px) * distance / views.focal_px), distance])
        valid = views.project_in_view(point)
        for view, index in enumerate(others):
            coordinate = [
                planes.mapping.scale[plane, view] * u + planes.mapping.offset_u[plane, view],
                planes.mapping.scale[plane, view] * v + planes.mapping.offset_v[plane, view],
            ]
            np.testing.assert_allclose(coordinate, valid[index], atol=2e-4)


def test_views_at_similar_distance_compete_by_direction() -> None:
    planes = sweep(grid_views(3, 3, uneven=False), INVERSE_DISTANCES)
    assert planes.mapping.rings.tolist() == [0, 8]
    assert sorted(planes.mapping.sector) == list(range(8))
    many = sweep(grid_views(5, 5, uneven=False), INVERSE_DISTANCES)
    assert many.mapping.rings.tolist() == [0, 8, 24]
    most = sweep(grid_views(9, 9, uneven=False), INVERSE_DISTANCES)
    assert len(most.mapping.rings) == 5
    assert most.mapping.rings[-1] <= 4 * 16
    row = sweep(grid_views(1, 5, uneven=False), INVERSE_DISTANCES)
    assert row.mapping.rings.tolist() == [0, 2, 4]


def test_a_plane_step_shifts_the_farthest_view_by_step_px() -> None:
    views = grid_views(1, 3, uneven=False)
    planes = sweep(views, INVERSE_DISTANCES)
    assert planes.step_px == pytest.approx(
        abs(float(planes.mapping.offset_u[1, 0] - planes.mapping.offset_u[0, 0])), rel=1e-4
    )
    np.testing.assert_allclose(
        planes.inverse_distance(np.array([0.0, 2.5], np.float32)),
        INVERSE_DISTANCES[0] + np.array([0.0, 2.5]) * planes.step,
        rtol=1e-6,
    )


def test_the_nearest_surface_hides_the_others() -> None:
    views = grid_views()
    planes = sweep(views, FINE_INVERSE_DISTANCES)
    surfaces = [Surface(600.0), Surface(400.0, bounds=(-20.0, -20.0, 20.0, 20.0))]
    distance = met(views, (1, 1), views.pixel_grid(), surfaces)[1]
    own = ((1.0 / distance - FINE_INVERSE_DISTANCES[0]) / planes.step).astype(np.float32)
    found = nearest_planes(own, planes)
    others = [index for index in np.ndindex(3, 3) if index != (1, 1)]
    for view, index in enumerate(others):
        valid = met(views, index, views.pixel_grid(), surfaces)[1] + 0.0
        # Distances from the view's own plane to those from the reference view's: met() gives the latter.
        truth = (1.0 / valid - FINE_INVERSE_DISTANCES[0]) / planes.step
        known = found[view] > NO_SURFACE
        assert known.mean() > 0.6
        near = truth > 10
        agree = np.abs(found[view] - truth) < 0.5
        # To a pixel at the card's edges.
        assert agree[known].mean() > 0.95
        assert agree[near].mean() > 0.9


def test_points_outside_a_view_hide_nothing() -> None:
    views = grid_views(1, 2, uneven=False)
    planes = sweep(views, FINE_INVERSE_DISTANCES)
    found = nearest_planes(np.full((90, 120), 20.0, np.float32), planes)
    assert (found[0] == NO_SURFACE).any()
    assert (found[0][found[0] > NO_SURFACE] == 20.0).all()


def test_costs_are_contiguous() -> None:
    ranges = Ranges.of(np.array([[2, 0], [5, 1]], np.int32), np.array([[3, 4], [1, 2]], np.int32))
    assert ranges.size == 10
    assert ranges.start.tolist() == [[0, 3], [7, 8]]
    assert everywhere(Volume.empty(full_range((2, 3), 5))).shape == (2, 3, 5)


@pytest.mark.parametrize("farthest", [0.0, 240.0])
@pytest.mark.parametrize("shape", [(40, 64), (37, 51), (9, 8)])
def test_a_tile_is_searched_around_all_known_planes_near_it(shape: tuple[int, int], farthest: float) -> None:
    planes = 300
    known = farthest + np.random.default_rng(0).uniform(0, 60, shape).astype(np.float32)
    known[:, shape[1] // 2 :] = 25.3 + farthest
    ranges = range_around(known, planes)
    for v in range(0, shape[0], TILE_PX):
        for u in range(0, shape[1], TILE_PX):
            tile = slice(v, v + TILE_PX), slice(u, u + TILE_PX)
            near = known[
                max(v - NEIGHBOUR_PX, 0) : v + TILE_PX + NEIGHBOUR_PX,
                max(u - NEIGHBOUR_PX, 0) : u + TILE_PX + NEIGHBOUR_PX,
            ]
            low = np.clip(np.floor(near.min()) - MARGIN_PLANES, 0, planes - MIN_PLANES)
            high = min(np.ceil(near.max()) + MARGIN_PLANES + 1, planes)
            assert (ranges.low[tile] == low).all()
            assert (ranges.low[tile] + ranges.plane_count[tile] == high).all()


def test_all_planes_are_searched_if_there_are_few() -> None:
    ranges = range_around(np.full((16, 16), 1.0, np.float32), MIN_PLANES)
    assert (ranges.low == 0).all()
    assert (ranges.plane_count == MIN_PLANES).all()


def test_a_tracked_range_holds_all_maps_and_all_planes_where_they_are_unknown() -> None:
    before, after = np.full((24, 40), 20.0, np.float32), np.full((24, 40), 26.0, np.float32)
    unknown = np.zeros((24, 40), bool)
    unknown[12, 36] = True
    found = tracked_range([before, after], 60, unknown)
    assert found.low[0, 0] <= 18 and found.low[0, 0] + found.plane_count[0, 0] >= 28
    assert found.plane_count[0, 0] < 15
    assert (found.plane_count[8:16, 32:40] == 60).all()
    assert (found.plane_count[:, :24] < 15).all()
