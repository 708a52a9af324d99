"""The search at one size, and from size to size, on surfaces in closed form."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.parallax import other_views
from mirrorcam.optics.light_field.depth.photometry import ViewPicture
from mirrorcam.optics.light_field.depth.search import Size, search
from mirrorcam.optics.light_field.depth.semiglobal import Cheapest
from mirrorcam.optics.light_field.depth.sweep import Ranges, range_around
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

NEAR_MM, FAR_MM = 320.0, 900.0


@pytest.fixture(scope="module")
def step() -> tuple[Any, ViewPicture, list[ViewPicture], Any]:
    """A card before a wall: views, pictures, and true depth."""
    views = grid_views()
    surfaces = [Surface(600.0, grain_mm=2.0), Surface(420.0, bounds=(-25.0, -20.0, 10.0, 20.0), grain_mm=2.0)]
    light_field, depth, _ = photograph(views, surfaces, noise=0.002)
    own, *others = (ViewPicture.of(light_field, index) for index in ((1, 1), *other_views(views)))
    return views, own, others, depth


def planes_of(size: Size, views: Any, depth: Any) -> Any:
    inverse = 1.0 / (depth - views.reference_view_depth_mm)
    return (inverse - size.sweep.inverse_distances[0]) / size.sweep.step


def near(found: Cheapest, size: Size) -> Ranges:
    return range_around(found.planes, size.sweep.planes)


def test_a_search_of_all_planes_and_one_near_them_find_the_surfaces(step: Any) -> None:
    views, own, others, depth = step
    size = Size.of(views, NEAR_MM, FAR_MM, 0)
    found = search(size, own, others, rounds=1)
    wrong = np.abs(found.planes - planes_of(size, views, depth)) > 1.0
    assert wrong.mean() < 0.01
    again = search(size, own, others, ThreadPoolExecutor(2).map, known=found, ranges=near(found, size))
    assert (np.abs(again.planes - planes_of(size, views, depth)) > 1.0).mean() < 0.01
    assert np.array_equal(again.planes, search(size, own, others, known=found, ranges=near(found, size)).planes)


def test_depth_at_half_size_guides_the_search_at_full_size(step: Any) -> None:
    views, own, others, depth = step
    half, full = (Size.of(views, NEAR_MM, FAR_MM, halvings) for halvings in (1, 0))
    assert half.shape == (45, 60)
    assert half.cells * 7 < full.cells
    before = full.enlarged(search(half, own, others, rounds=1), half)
    truth = planes_of(full, views, depth)
    assert np.median(np.abs(before.planes - truth)) < 1.0
    found = search(full, own, others, known=before, ranges=near(before, full))
    assert (np.abs(found.planes - truth) > 1.0).mean() < 0.01


def test_planes_lie_farther_apart_if_there_are_too_many() -> None:
    views = grid_views()
    fine = Size.of(views, NEAR_MM, FAR_MM, 0)
    coarse = Size.of(views, NEAR_MM, FAR_MM, 0, fine.sweep.planes // 2)
    assert fine.sweep.reach_px == pytest.approx(0.5, rel=0.05)
    assert coarse.sweep.reach_px == pytest.approx(1.0, rel=0.1)
