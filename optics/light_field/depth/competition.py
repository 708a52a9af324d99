"""Competition of views, sector by sector: the matching cost of a point from the views in each direction."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]

UNITS = 64
"""Costs are differences relative to the local contrast of the reference view, in integer multiples of 1 / UNITS."""
INVALID_COST = 1e6
"""Cost of a point that no view of a sector sees: sorted last, then left out."""
TRUNCATION = 6.0
"""Maximum cost of one view: an occluder may look like anything."""
BEST_FRACTION, VISIBLE_FRACTION = 0.4, 0.6
"""Fraction of directions (of lowest cost) that decides: of all, or of those that see the point at a first depth."""
HALF_SURCHARGE = 1.0
"""Surcharge on the cost if half of that fraction decides alone."""
OCCLUSION_SURCHARGE, USUAL_OCCLUSION = 3.0, 0.5
"""Surcharge on the cost per excess of the occluded fraction of the views over the usual fraction.

Few views match by chance, and an edge hides an adjacent point from at most half of the views.
"""


class Work(NamedTuple):
    """Work arrays: sums of costs and weights per sector, for all views and for those that see the point."""

    sums: Any
    weights: Any
    sectors: Any
    ring: Any
    cost: Any
    lines: Any
    decided: Any


# Each loop runs over few arrays, and over slices, whose indices cannot be negative, and loads all values that it
# selects from: this lets the compiler vectorise.


@compiled
def _sort(costs: Float32, count: int) -> None:
    """Sort the first `count` columns of costs (m, u) along the first axis in place (odd-even transposition)."""
    rows = len(costs)
    for pass_number in range(rows):
        for row in range(pass_number % 2, rows - 1, 2):
            first, second = costs[row, :count], costs[row + 1, :count]
            for x in range(count):
                a, b = first[x], second[x]
                first[x] = a if a < b else b
                second[x] = b if a < b else a


@compiled
def _add_lowest(costs: Float32, used: Float32, half_used: Float32, weight: Float32, work: Work, total: Float32) -> None:
    """Add weight (u,) times the mean of the `used` (u,) lowest of the sorted costs (m, u), or of `half_used` if less.

    Both numbers are at least 1, and fractional.
    """
    zero, one, surcharge = np.float32(0.0), np.float32(1.0), np.float32(HALF_SURCHARGE)
    mean, half_mean = work.ring[5, : len(total)], work.ring[6, : len(total)]
    mean[:], half_mean[:] = 0.0, 0.0
    for row in range(len(costs)):
        cost, rank = costs[row, : len(total)], np.float32(row)
        for x in range(len(total)):
            mean[x] += max(min(used[x] - rank, one), zero) * cost[x]
            half_mean[x] += max(min(half_used[x] - rank, one), zero) * cost[x]
    for x in range(len(total)):
        total[x] += weight[x] * min(mean[x] / used[x], half_mean[x] / half_used[x] + surcharge)


@compiled
def decide(rings: Int64, occlusion_known: bool, work: Work, count: int) -> None:
    """Write the costs `decided` of `count` pixels from the sums of the sectors.

    `rings` (r + 1,) holds the first sector of each ring and the number of sectors; `occlusion_known` states whether
    a first depth gives the occlusion.
    """
    zero, half, one, two = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
    out = work.decided[:count]
    visible_count, used, fraction = work.ring[0, :count], work.ring[1, :count], work.ring[2, :count]
    weight, total_weight = work.ring[3, :count], work.ring[4, :count]
    all_views_weight = work.ring[7, :count]
    out[:], total_weight[:], all_views_weight[:] = 0.0, 0.0, 0.0
    for ring in range(len(rings) - 1):
        first, last = rings[ring], rings[ring + 1]
        visible_count[:], used[:], weight[:] = 0.0, 0.0, 0.0
        if occlusion_known:
            for sector in range(first, last):
                visible = work.weights[1, sector, :count]
                for x in range(count):
                    visible_count[x] += one if visible[x] > zero else zero
        for x in range(count):
            fraction[x] = np.float32(VISIBLE_FRACTION) if visible_count[x] >= two else np.float32(BEST_FRACTION)
        costs = work.sectors[: last - first]
        for sector in range(first, last):
            sums, weights = work.sums[0, sector, :count], work.weights[0, sector, :count]
            for x in range(count):
                all_views_weight[x] += weights[x]
            if occlusion_known:
                visible_sums, visible_weights = work.sums[1, sector, :count], work.weights[1, sector, :count]
                for x in range(count):
                    own, visible_own = sums[x], visible_sums[x]
                    sums[x] = visible_own if visible_count[x] >= two else own
                for x in range(count):
                    own, visible_own = weights[x], visible_weights[x]
                    weights[x] = visible_own if visible_count[x] >= two else own
            cost = costs[sector - first, :count]
            for x in range(count):
                own = sums[x] / weights[x]
                cost[x] = own if weights[x] > zero else np.float32(INVALID_COST)
            for x in range(count):
                used[x] += one if weights[x] > zero else zero
            for x in range(count):
                weight[x] += weights[x]
        _sort(costs, count)
        half_used = visible_count
        for x in range(count):
            total_weight[x] += weight[x]
            deciding = fraction[x] * used[x]
            used[x] = max(deciding, one)
            half_used[x] = max(half * deciding, one)
        _add_lowest(costs, used, half_used, weight, work, out)
    for x in range(count):
        occluded_fraction = one - total_weight[x] / all_views_weight[x]
        surcharge = np.float32(OCCLUSION_SURCHARGE) * max(occluded_fraction - np.float32(USUAL_OCCLUSION), zero)
        out[x] = out[x] / total_weight[x] + surcharge if total_weight[x] > zero else np.float32(TRUNCATION)
