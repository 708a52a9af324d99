"""Competition of views, sector by sector: the cost of a place from the views in each direction."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]

UNITS = 64
"""Costs are stored as integer multiples of 1 / UNITS."""
UNSEEN = 1e6
"""Cost of a place that no view of a sector sees: sorted last, then left out."""
TRUNCATION = 6.0
"""Largest difference that counts, in contrasts: an occluder may look like anything."""
BEST_SHARE, SEEING_SHARE = 0.4, 0.6
"""Share of the cheapest directions that decides: of all, and of those that see the place by a first depth."""
HALF_SURCHARGE = 1.0
"""Surcharge, in contrasts, if half of that share decides alone."""
OCCLUSION_SURCHARGE, USUAL_OCCLUSION = 3.0, 0.5
"""Surcharge, in contrasts per share of the views, for each share above the usual from which a place is hidden.

Few views match by chance, and an edge hides an adjacent place from at most half of the views.
"""


class Work(NamedTuple):
    """Work arrays: sums of costs and weights per sector, for all views and for those that see the place."""

    sums: Any
    weights: Any
    sectors: Any
    ring: Any
    cost: Any
    line: Any
    decided: Any


# Each loop runs over few arrays, and over slices, whose indices cannot be negative: this lets the compiler vectorise.


@compiled
def _sort(costs: Float32, count: int) -> None:
    """Sort the first `count` columns of costs (m, u) along the first axis in place (odd-even transposition)."""
    rows = len(costs)
    for pass_number in range(rows):
        for number in range(pass_number % 2, rows - 1, 2):
            lower, upper = costs[number, :count], costs[number + 1, :count]
            for x in range(count):
                a, b = lower[x], upper[x]
                lower[x] = a if a < b else b
                upper[x] = b if a < b else a


@compiled
def _add_cheapest(costs: Float32, count: Float32, share: Float32, weight: Float32, work: Work, total: Float32) -> None:
    """Add weight (u,) times the mean of the cheapest share (u,) of the `count` (u,) sorted costs (m, u)."""
    zero, one, half, fewer = np.float32(0.0), np.float32(1.0), np.float32(0.5), np.float32(HALF_SURCHARGE)
    mean, mean_of_less = work.ring[5, : len(total)], work.ring[6, : len(total)]
    mean[:], mean_of_less[:] = 0.0, 0.0
    for number in range(len(costs)):
        cost, before = costs[number, : len(total)], np.float32(number)
        for x in range(len(total)):
            take = max(share[x] * count[x], one)
            mean[x] += max(min(take - before, one), zero) * cost[x]
            less = max(half * share[x] * count[x], one)
            mean_of_less[x] += max(min(less - before, one), zero) * cost[x]
    for x in range(len(total)):
        take = max(share[x] * count[x], one)
        less = max(half * share[x] * count[x], one)
        total[x] += weight[x] * min(mean[x] / take, mean_of_less[x] / less + fewer)


@compiled
def decide(rings: Int64, known: bool, work: Work, count: int) -> None:
    """Write the costs `decided` of `count` pixels from the sums of the sectors.

    `rings` (r + 1,) holds the first sector of each ring and the number of sectors; `known`: whether a first depth is
    known.
    """
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    out = work.decided[:count]
    seeing, taken, share = work.ring[0, :count], work.ring[1, :count], work.ring[2, :count]
    weight, total_weight = work.ring[3, :count], work.ring[4, :count]
    all_views = work.ring[7, :count]
    out[:], total_weight[:], all_views[:] = 0.0, 0.0, 0.0
    for ring in range(len(rings) - 1):
        first, last = rings[ring], rings[ring + 1]
        seeing[:], taken[:], weight[:] = 0.0, 0.0, 0.0
        if known:
            for sector in range(first, last):
                sees = work.weights[1, sector, :count]
                for x in range(count):
                    seeing[x] += one if sees[x] > zero else zero
        for x in range(count):
            share[x] = np.float32(SEEING_SHARE) if seeing[x] >= two else np.float32(BEST_SHARE)
        costs = work.sectors[: last - first]
        for sector in range(first, last):
            sums, weights = work.sums[0, sector, :count], work.weights[0, sector, :count]
            for x in range(count):
                all_views[x] += weights[x]
            if known:
                sums_seeing, weights_seeing = work.sums[1, sector, :count], work.weights[1, sector, :count]
                for x in range(count):
                    sums[x] = sums_seeing[x] if seeing[x] >= two else sums[x]
                for x in range(count):
                    weights[x] = weights_seeing[x] if seeing[x] >= two else weights[x]
            cost = costs[sector - first, :count]
            for x in range(count):
                cost[x] = sums[x] / weights[x] if weights[x] > zero else np.float32(UNSEEN)
            for x in range(count):
                taken[x] += one if weights[x] > zero else zero
            for x in range(count):
                weight[x] += weights[x]
        _sort(costs, count)
        for x in range(count):
            total_weight[x] += weight[x]
        _add_cheapest(costs, taken, share, weight, work, out)
    for x in range(count):
        hidden_share = one - total_weight[x] / all_views[x]
        surcharge = np.float32(OCCLUSION_SURCHARGE) * max(hidden_share - np.float32(USUAL_OCCLUSION), zero)
        out[x] = out[x] / total_weight[x] + surcharge if total_weight[x] > zero else np.float32(0.5 * TRUNCATION)
