"""What views say of a plane: means, sides, and those that do not see it."""

from __future__ import annotations

import numpy as np

from optics.light_field.depth.cost import ONE_SIDE, TRUNCATION, UNITS, UNSEEN, Planes, best_half, sides
from tests.optics.light_field.depth.surfaces import grid_views


def levels(*values: int) -> list[np.ndarray]:
    return [np.full((2, 3), value, np.uint8) for value in values]


def test_the_cost_is_the_mean_when_all_views_agree_alike() -> None:
    assert (best_half(levels(10, 10, 10, 10), [[0, 1], [2, 3]]) == 10 * UNITS).all()
    assert (best_half(levels(0, 20, 20, 0), [[0, 1], [2, 3]]) == 10 * UNITS).all()


def test_a_side_that_sees_the_place_outvotes_one_that_does_not() -> None:
    assert (best_half(levels(2, 2, 80, 80), [[0, 1], [2, 3]]) == 2 * UNITS + ONE_SIDE).all()
    assert (best_half(levels(2, 2, 80, 80), []) == 41 * UNITS).all()


def test_many_views_do_not_overflow() -> None:
    for count in (80, 224, 960):
        assert (best_half(levels(*([TRUNCATION] * count)), [list(range(40))]) == TRUNCATION * UNITS).all()


def test_sides_are_those_of_the_true_positions() -> None:
    assert sides(grid_views(uneven=False)) == [[0, 3, 5], [2, 4, 7], [0, 1, 2], [5, 6, 7]]
    assert sides(grid_views()) == [[0, 3, 5], [2, 4, 7], [0, 1, 2], [5, 6, 7]]
    assert sides(grid_views(1, 3, uneven=False)) == [[0], [1]]


def test_a_plane_costs_nothing_where_it_is_and_a_view_that_sees_nothing_is_neutral() -> None:
    views = grid_views(1, 3, uneven=False)
    distance = views.reference_distance_mm
    seen = np.ones((1, 3, views.height_px, views.width_px), np.float32)
    seen[0, 2, :, :60] = 0.0
    picture = np.random.default_rng(2).integers(0, 255, (views.height_px, views.width_px)).astype(np.uint8)
    planes = Planes(views, seen, np.array([0.5 / distance, 1.0 / distance]))
    cost = planes.cost(1, [picture, picture], picture)
    assert (cost[:, 61:] == 0).all()
    # The view to the left alone agrees: cheaper than half of what an unseen one adds.
    assert (cost[:, :59] == min(ONE_SIDE, UNSEEN * UNITS // 2)).all()
    assert planes.cost(0, [picture, picture], picture)[:, 61:].mean() > 20 * UNITS
