"""Aggregation, against the explicit recursion pixel by pixel."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.semiglobal import (
    CERTAIN_MARGIN,
    EDGE_FLOOR,
    EDGE_GREY,
    EDGE_STEPS,
    PATH_DIRECTIONS,
    aggregate,
    lowest_cost,
    surface_slants,
)
from mirrorcam.optics.light_field.depth.sweep import Ranges, Volume, full_range
from tests.optics.light_field.depth.surfaces import everywhere


def volume_of(costs: np.ndarray) -> Volume:
    """A volume of costs (v, u, n) of all planes."""
    return Volume(full_range(costs.shape[:2], costs.shape[2]), costs.ravel())


def summed(costs: np.ndarray, *arguments: Any) -> np.ndarray:
    return everywhere(aggregate(volume_of(costs), *arguments))


EVEN = np.full((7, 9, 3), 90.0, np.float32)
LEVEL = (np.zeros((7, 9), np.float32), np.zeros((7, 9), np.float32))


def plainly(
    volume: np.ndarray,
    next_plane: int,
    any_plane: int,
    picture: np.ndarray,
    slants: tuple[np.ndarray, np.ndarray],
    directions: int,
) -> np.ndarray:
    """L(p, d) = C(p, d) + min(L(p', d'), L(p', d' +- 1) + next, min L(p', .) + any) - min L(p', .), in all directions.

    d' is d less the rise of the surface from p' to p.
    """
    cost = volume.astype(int)
    rows, columns, planes = cost.shape
    total = np.zeros_like(cost)
    for offset_v, right in PATH_DIRECTIONS[:directions]:
        path, carried = np.zeros_like(cost), np.zeros((rows, columns))
        for v in range(rows)[:: offset_v or 1]:
            for u in range(columns)[:: right or 1]:
                before_v, before_u = v - offset_v, u - right
                path[v, u] = cost[v, u]
                if not (0 <= before_v < rows and 0 <= before_u < columns):
                    continue
                before = path[before_v, before_u]
                rise = carried[before_v, before_u] + right * slants[0][v, u] + offset_v * slants[1][v, u]
                shift = int(np.floor(rise + 0.5))
                carried[v, u] = rise - shift
                edge = np.round(np.abs(picture[v, u] - picture[before_v, before_u]).max() * EDGE_STEPS) / EDGE_STEPS
                kept = EDGE_FLOOR + (1 - EDGE_FLOOR) * np.exp(-edge / EDGE_GREY)
                jump = int(max(1.5 * next_plane, any_plane * kept))
                for d in range(planes):
                    ways = [before.min() + jump]
                    ways += [
                        before[other - shift] + (next_plane if other != d else 0)
                        for other in (d - 1, d, d + 1)
                        if 0 <= other - shift < planes
                    ]
                    path[v, u, d] += min(ways) - before.min()
        total += path
    return total


@pytest.mark.parametrize(("next_plane", "any_plane"), [(3, 20), (0, 0), (10, 1000)])
@pytest.mark.parametrize("slanted", [False, True])
@pytest.mark.parametrize("directions", [4, 8])
def test_paths_are_the_cheapest(next_plane: int, any_plane: int, slanted: bool, directions: int) -> None:
    random = np.random.default_rng(0)
    volume = random.integers(0, 60, (7, 9, 6)).astype(np.uint16)
    picture = random.uniform(0, 40, (7, 9, 3)).astype(np.float32)
    slants = LEVEL
    if slanted:
        offset_u, offset_v = random.uniform(-1.3, 1.3, (2, 7, 9)).astype(np.float32)
        slants = (offset_u, offset_v)
    expected = plainly(volume, next_plane, any_plane, picture, slants, directions)
    for found in (
        summed(volume, picture, slants, (next_plane, any_plane), map, directions),
        summed(volume, picture, slants, (next_plane, any_plane), ThreadPoolExecutor(2).map, directions),
    ):
        # The penalty of an edge is rounded down: by at most one in each direction.
        assert np.abs(found.astype(int) - expected).max() <= (0 if any_plane == 0 else directions)


@pytest.mark.parametrize("slanted", [False, True])
def test_paths_over_ranges_equal_those_of_a_search_limited_to_them(slanted: bool) -> None:
    random = np.random.default_rng(3)
    shape, planes = (7, 9), 12
    low = random.integers(0, 7, shape).astype(np.int32)
    count = random.integers(3, 6, shape).astype(np.int32)
    costs = random.integers(0, 60, (*shape, planes)).astype(np.uint16)
    plane = np.arange(planes)
    inside = (plane >= low[..., None]) & (plane < (low + count)[..., None])
    slants = LEVEL
    if slanted:
        offset_u, offset_v = random.uniform(-1.3, 1.3, (2, *shape)).astype(np.float32)
        slants = (offset_u, offset_v)
    found = aggregate(Volume(Ranges.of(low, count), costs[inside]), EVEN, slants, (3, 20))
    # Far more expensive than any path: never on the cheapest one.
    expected = plainly(np.where(inside, costs.astype(int), 5000), 3, 20, EVEN, slants, 8)
    assert np.abs(found.costs.astype(int) - expected[inside]).max() <= 8
    best = lowest_cost(found, 400.0)
    assert np.abs(best.planes - np.where(inside, expected, 10**6).argmin(axis=2)).max() <= 0.5 or not slanted


def test_without_penalties_pixels_are_independent() -> None:
    volume = np.random.default_rng(1).integers(0, 60, (7, 9, 5)).astype(np.uint16)
    assert np.array_equal(summed(volume, EVEN, LEVEL, (0, 0)), 8 * volume)


def test_pixels_without_costs_follow_their_neighbours_slant() -> None:
    volume = np.full((7, 9, 9), 30, np.uint16)
    volume[:, :3, 2] = volume[:, 6:, 2] = 0
    assert (summed(volume, EVEN, LEVEL, (5, 100)).argmin(axis=2) == 2).all()
    volume[:] = 30
    volume[:, [0, 1], [0, 1]] = 0
    rising = (np.ones((7, 9), np.float32), np.zeros((7, 9), np.float32))
    assert (summed(volume, EVEN, rising, (5, 100)).argmin(axis=2) == np.arange(9)).all()


def test_the_best_plane_its_margin_and_its_rivals() -> None:
    total = np.full((8, 8, 12), 900, np.uint16)
    total[..., 4] = 100
    total[..., [3, 5]] = [400, 200]
    total[..., 9] = 300
    found = lowest_cost(volume_of(total), 400.0)
    np.testing.assert_allclose(found.planes, 4.0 + 0.5 * (400 - 200) / (400 + 200 - 200))
    np.testing.assert_allclose(found.margin, 200.0)
    np.testing.assert_allclose(found.rivals, (1 - 0.5**2) ** 2 / 3, rtol=1e-6)


SURELY = np.full((60, 80), CERTAIN_MARGIN, np.float32)


def test_slants_match_a_plane_and_ignore_a_jump() -> None:
    v, u = np.mgrid[:60, :80].astype(np.float32)
    planes = 0.3 * u - 0.7 * v + np.where(u > 60, np.float32(20.0), np.float32(0.0))
    offset_u, offset_v = surface_slants(planes, SURELY)
    # To an eight-bit code of 4 planes a pixel.
    np.testing.assert_allclose(offset_u[:, :50], 0.3, atol=0.02)
    np.testing.assert_allclose(offset_v[:, :50], -0.7, atol=0.02)
    assert (surface_slants(np.zeros((60, 80), np.float32), SURELY)[0] == 0).all()


def test_uncertain_pixels_get_the_slant_of_certain_neighbours() -> None:
    u = np.mgrid[:60, :80][1].astype(np.float32)
    planes = 0.3 * u
    planes[40:] = 24.0 - 0.4 * u[40:]
    margin = SURELY.copy()
    margin[40:] = 0.3
    offset_u = surface_slants(planes, margin)[0]
    np.testing.assert_allclose(offset_u[:30], 0.3, atol=0.02)
    np.testing.assert_allclose(offset_u[50:], 0.3, atol=0.05)
    assert (surface_slants(planes, SURELY)[0][55:, 20:60] < -0.3).all()
