"""The competition of sectors, against explicit sorting and averaging."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.competition import (
    BEST_FRACTION,
    HALF_SURCHARGE,
    OCCLUSION_SURCHARGE,
    TRUNCATION,
    USUAL_OCCLUSION,
    VISIBLE_FRACTION,
    Work,
    decide,
)

PIXELS = 50


def reference_cost(sums: Any, weights: Any, rings: Any, known: bool) -> float:
    """The cost of one pixel of sums and weights (2, sectors)."""
    total = total_weight = 0.0
    views = weights[0].sum()
    for first, last in pairwise(rings):
        visible = known and (weights[1, first:last] > 0).sum() >= 2
        kind = 1 if visible else 0
        weight, cost = weights[kind, first:last], sums[kind, first:last]
        ordered = np.sort(cost[weight > 0] / weight[weight > 0])
        if len(ordered) == 0:
            continue

        def mean(used: float, of: Any = ordered) -> float:
            terms = np.clip(used - np.arange(len(of)), 0.0, 1.0)
            return float((terms * of).sum() / used)

        fraction = VISIBLE_FRACTION if visible else BEST_FRACTION
        used, half_used = max(fraction * len(ordered), 1.0), max(0.5 * fraction * len(ordered), 1.0)
        total += weight.sum() * min(mean(used), mean(half_used) + HALF_SURCHARGE)
        total_weight += weight.sum()
    surcharge = (
        OCCLUSION_SURCHARGE * max(1.0 - total_weight / views - USUAL_OCCLUSION, 0.0) if total_weight > 0 else 0.0
    )
    return total / total_weight + surcharge if total_weight > 0 else TRUNCATION


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("rings", [[0, 8], [0, 5, 8], [0, 1]])
def test_the_better_half_of_each_ring_counts(known: bool, rings: list[int]) -> None:
    random = np.random.default_rng(0)
    weights = random.integers(1, 4, (2, rings[-1], PIXELS)) * (random.uniform(size=(2, rings[-1], PIXELS)) < 0.8)
    # A view that sees a point has samples there.
    weights[1] = weights[0] * (random.uniform(size=weights[1].shape) < 0.5)
    weights[:, :, 0] = 0.0
    sums = weights * random.uniform(0.0, TRUNCATION, weights.shape)
    expected = [reference_cost(sums[:, :, x], weights[:, :, x], rings, known) for x in range(PIXELS)]
    work = Work(
        sums.astype(np.float32),
        weights.astype(np.float32),
        np.empty((16, PIXELS), np.float32),
        np.empty((8, PIXELS), np.float32),
        np.empty((3, PIXELS), np.float32),
        np.empty(PIXELS + 1, np.float32),
        np.empty(PIXELS, np.float32),
    )
    decide(np.array(rings), known, work, PIXELS)
    np.testing.assert_allclose(work.decided, expected, rtol=1e-4)
