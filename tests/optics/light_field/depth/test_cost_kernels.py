"""Loops of the cost that `test_cost` does not reach: averages beside the ends of ranges."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.light_field.depth.cost_kernels import average_weak
from mirrorcam.optics.light_field.depth.volume import Ranges


def test_what_a_neighbour_has_no_cost_of_counts_as_the_pixels_own() -> None:
    random = np.random.default_rng(0)
    shape, planes, reach = (9, 11), 8, 2
    ranges = Ranges.of(random.integers(0, 4, shape).astype(np.int32), random.integers(3, 5, shape).astype(np.int32))
    costs = random.integers(0, 300, ranges.cells).astype(np.uint16)
    weak = random.uniform(-0.5, 1.0, shape).astype(np.float32).clip(0.0)
    found = np.zeros_like(costs)
    average_weak(0, 9, weak, reach, ranges, costs, found)
    known = np.full((*shape, planes), -1.0)
    for v, u in np.ndindex(shape):
        low, count, start = (int(each[v, u]) for each in ranges)
        known[v, u, low : low + count] = costs[start : start + count]
    for v, u in np.ndindex(shape):
        low, count, start = (int(each[v, u]) for each in ranges)
        beside = np.arange(-reach, reach + 1)
        square_of = np.ix_(np.clip(v + beside, 0, shape[0] - 1), np.clip(u + beside, 0, shape[1] - 1))
        for plane in range(low, low + count):
            square = known[square_of][..., plane]
            own = known[v, u, plane]
            mean = np.where(square >= 0, square, own).mean()
            expected = (1.0 - weak[v, u]) * own + weak[v, u] * mean
            assert abs(float(found[start + plane - low]) - expected) < 0.51
