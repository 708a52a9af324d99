"""Aggregation, against the recursion written out pixel by pixel."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.semiglobal import aggregate


def plainly(volume: np.ndarray, next_plane: int, any_plane: int) -> np.ndarray:
    """L(p, d) = C(p, d) + min(L(p', d), L(p', d +- 1) + next, min L(p', .) + any) - min L(p', .), over four ways."""
    cost = volume.transpose(0, 2, 1).astype(int)
    rows, columns, planes = cost.shape
    total = np.zeros_like(cost)
    for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        path = np.zeros_like(cost)
        for v in range(rows)[:: down or 1]:
            for u in range(columns)[:: right or 1]:
                before_v, before_u = v - down, u - right
                path[v, u] = cost[v, u]
                if not (0 <= before_v < rows and 0 <= before_u < columns):
                    continue
                before = path[before_v, before_u]
                for d in range(planes):
                    ways = [before[d], before.min() + any_plane]
                    ways += [before[other] + next_plane for other in (d - 1, d + 1) if 0 <= other < planes]
                    path[v, u, d] += min(ways) - before.min()
        total += path
    return total.transpose(0, 2, 1)


@pytest.mark.parametrize(("next_plane", "any_plane"), [(3, 20), (0, 0), (10, 1000)])
def test_paths_are_the_cheapest(next_plane: int, any_plane: int) -> None:
    volume = np.random.default_rng(0).integers(0, 60, (7, 5, 9)).astype(np.uint16)
    expected = plainly(volume, next_plane, any_plane)
    assert np.array_equal(aggregate(volume, next_plane, any_plane), expected)
    assert np.array_equal(aggregate(volume, next_plane, any_plane, ThreadPoolExecutor(2).map), expected)


def test_without_prices_each_pixel_stands_alone() -> None:
    volume = np.random.default_rng(1).integers(0, 60, (4, 6, 5)).astype(np.uint16)
    assert np.array_equal(aggregate(volume, 0, 0), 4 * volume)


def test_what_is_told_nothing_follows_its_neighbours() -> None:
    volume = np.full((9, 6, 9), 30, np.uint16)
    volume[:, 2, :3] = volume[:, 2, 6:] = 0
    assert (aggregate(volume, 5, 100).argmin(axis=1) == 2).all()
    assert (volume.argmin(axis=1)[:, 4] == 0).all()
