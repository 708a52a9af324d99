"""Ranges of planes, against minima and maxima written out."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.volume import (
    AROUND_PX,
    FEWEST_PLANES,
    MARGIN_PLANES,
    TILE_PX,
    Ranges,
    Volume,
    range_around,
    whole_range,
)
from tests.optics.light_field.depth.surfaces import everywhere


def test_costs_lie_one_after_the_other() -> None:
    ranges = Ranges.of(np.array([[2, 0], [5, 1]], np.int32), np.array([[3, 4], [1, 2]], np.int32))
    assert ranges.cells == 10
    assert ranges.start.tolist() == [[0, 3], [7, 8]]
    assert everywhere(Volume.empty(whole_range((2, 3), 5))).shape == (2, 3, 5)


@pytest.mark.parametrize("shape", [(40, 64), (37, 51), (9, 8)])
def test_a_tile_is_searched_around_all_that_is_known_near_it(shape: tuple[int, int]) -> None:
    known = np.random.default_rng(0).uniform(0, 60, shape).astype(np.float32)
    known[:, shape[1] // 2 :] = 25.3
    ranges = range_around(known, 60)
    for v in range(0, shape[0], TILE_PX):
        for u in range(0, shape[1], TILE_PX):
            tile = slice(v, v + TILE_PX), slice(u, u + TILE_PX)
            near = known[
                max(v - AROUND_PX, 0) : v + TILE_PX + AROUND_PX, max(u - AROUND_PX, 0) : u + TILE_PX + AROUND_PX
            ]
            low = np.clip(np.floor(near.min()) - MARGIN_PLANES, 0, 60 - FEWEST_PLANES)
            high = min(np.ceil(near.max()) + MARGIN_PLANES + 1, 60)
            assert (ranges.low[tile] == low).all()
            assert (ranges.low[tile] + ranges.planes[tile] == high).all()


def test_where_there_are_few_planes_all_are_searched() -> None:
    ranges = range_around(np.full((16, 16), 1.0, np.float32), FEWEST_PLANES)
    assert (ranges.low == 0).all()
    assert (ranges.planes == FEWEST_PLANES).all()
