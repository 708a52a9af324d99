"""What views say of a plane: means, sides, and those that do not see it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.cost import ONE_SIDE, TRUNCATION, UNITS, UNSEEN, Planes, best_half, sides
from mirrorcam.optics.light_field.depth.geometry import parallax
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
    prepared = planes.prepared([picture, picture])
    cost = planes.cost(1, prepared, picture)
    assert (cost[:, 61:] == 0).all()
    # The view to the left alone agrees: cheaper than half of what an unseen one adds.
    assert (cost[:, :59] == min(ONE_SIDE, UNSEEN * UNITS // 2)).all()
    assert planes.cost(0, prepared, picture)[:, 61:].mean() > 20 * UNITS


@pytest.mark.parametrize("along_mm", [0.0, 3.0, 40.0])
def test_shifts_of_stretched_pictures_stand_for_the_planes_of_views_that_lie_ahead(along_mm: float) -> None:
    """A smooth picture, taken where a plane puts it in the other view, costs next to nothing on that plane alone."""
    positions = np.array([[[0.0, 0.0, 0.0], [20.0, 5.0, along_mm]]])
    views = grid_views(1, 2, positions_mm=positions)
    size = views.width_px, views.height_px
    inverse_distances = np.linspace(1 / 900.0, 1 / 300.0, 20)
    coarse = np.random.default_rng(6).uniform(0, 255, (16, 20)).astype(np.float32)
    reference = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    planes = Planes(views, np.ones((1, 2, *size[::-1]), np.float32), inverse_distances)
    for number in (0, 7, 19):
        matrix = parallax(views, (0, 1)).affine(inverse_distances[number])
        other = cv2.warpAffine(reference, matrix, size, flags=cv2.INTER_LINEAR)
        prepared = planes.prepared([np.asarray(other)])
        costs = [planes.cost(plane, prepared, np.asarray(reference))[20:-20, 30:-30].mean() for plane in range(20)]
        assert int(np.argmin(costs)) == number
        assert costs[number] < 5.0 * UNITS
