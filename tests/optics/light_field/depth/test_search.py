"""The search at one pyramid level, and from level to level, on surfaces in closed form."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.parallax import other_views
from mirrorcam.optics.light_field.depth.photometry import ViewPicture, colours, halved_picture
from mirrorcam.optics.light_field.depth.search import LevelViews, PyramidLevel, search
from mirrorcam.optics.light_field.depth.semiglobal import LowestCost
from mirrorcam.optics.light_field.depth.sweep import Ranges, range_around
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

NEAR_MM, FAR_MM = 320.0, 900.0


@pytest.fixture(scope="module")
def step() -> tuple[Any, Any, ViewPicture, list[ViewPicture], Any]:
    """A card before a wall: views, the reference view's colours, pictures, and true depth."""
    views = grid_views()
    surfaces = [Surface(600.0, grain_mm=2.0), Surface(420.0, bounds=(-25.0, -20.0, 10.0, 20.0), grain_mm=2.0)]
    light_field, depth, _ = photograph(views, surfaces, noise=0.002)
    reference, *others = (ViewPicture.of(light_field, index) for index in ((1, 1), *other_views(views)))
    return views, colours(light_field, (1, 1)), reference, others, depth


def planes_of(level: PyramidLevel, views: Any, depth: Any) -> Any:
    inverse = 1.0 / (depth - views.reference_view_depth_mm)
    return (inverse - level.sweep.inverse_distances[0]) / level.sweep.step


def near(found: LowestCost, level: PyramidLevel) -> Ranges:
    return range_around(found.planes, level.sweep.plane_count)


def test_a_search_of_all_planes_and_one_near_them_find_the_surfaces(step: Any) -> None:
    views, picture, reference, others, depth = step
    level = PyramidLevel.of(views, NEAR_MM, FAR_MM, 0)
    compared = LevelViews.of(level, reference, others)
    found = search(level, picture, compared, rounds=1)
    wrong = np.abs(found.planes - planes_of(level, views, depth)) > 1.0
    assert wrong.mean() < 0.01
    again = search(level, picture, compared, ThreadPoolExecutor(2).map, earlier=found, ranges=near(found, level))
    assert (np.abs(again.planes - planes_of(level, views, depth)) > 1.0).mean() < 0.01
    assert np.array_equal(
        again.planes, search(level, picture, compared, earlier=found, ranges=near(found, level)).planes
    )


def test_depth_at_half_size_guides_the_search_at_full_size(step: Any) -> None:
    views, picture, reference, others, depth = step
    half, full = (PyramidLevel.of(views, NEAR_MM, FAR_MM, halvings) for halvings in (1, 0))
    assert half.shape == (45, 60)
    assert half.cost_count * 7 < full.cost_count
    before = full.enlarged(
        search(half, halved_picture(picture), LevelViews.of(half, reference, others), rounds=1), half
    )
    truth = planes_of(full, views, depth)
    assert np.median(np.abs(before.planes - truth)) < 1.0
    found = search(full, picture, LevelViews.of(full, reference, others), earlier=before, ranges=near(before, full))
    assert (np.abs(found.planes - truth) > 1.0).mean() < 0.01


def test_planes_lie_farther_apart_if_there_are_too_many() -> None:
    views = grid_views()
    fine = PyramidLevel.of(views, NEAR_MM, FAR_MM, 0)
    coarse = PyramidLevel.of(views, NEAR_MM, FAR_MM, 0, fine.sweep.plane_count // 2)
    assert fine.sweep.step_px == pytest.approx(0.5, rel=0.05)
    assert coarse.sweep.step_px == pytest.approx(1.0, rel=0.1)
