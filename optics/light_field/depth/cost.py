"""How badly the views agree on a depth: truncated differences of pictures, of the best half of the views.

A pixel beside what stands before it is hidden from the views on one side and seen by those on the other: its cost is
the least of the means over all views and over those to the left, right, top and bottom of the reference view.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from optics.light_field.depth.geometry import other_views, parallax
from optics.light_field.light_field import Views
from optics.values import FloatArray

Grey = NDArray[np.uint8]
Cost = NDArray[np.uint16]

TRUNCATION = 80
"""Largest difference that counts as such: what is hidden from a view may look like anything."""
UNSEEN = TRUNCATION // 2
"""What a view adds that does not see the place: neither for nor against."""
UNITS = 4
"""Costs are in parts of a grey level, one UNITS-th each."""
ONE_SIDE = 6 * UNITS
"""Surcharge on views of one side alone, so that without need all views decide."""
AXIS_SHARE = 0.25
"""A view lies to a side if it is that part of the farthest view's offset away along the axis."""


def sides(views: Views) -> list[list[int]]:
    """For each side of the reference view that has any, the views there, as indices into `other_views`."""
    offsets = np.array([views.positions_mm[index][:2] for index in other_views(views)])
    reach = np.abs(offsets).max() * AXIS_SHARE
    ways = [np.nonzero(sign * offsets[:, axis] > reach)[0].tolist() for axis in (0, 1) for sign in (-1, 1)]
    return [way for way in ways if way]


def best_half(costs: Sequence[Grey], groups: Sequence[Sequence[int]]) -> Cost:
    """The least mean (v, u) of all costs, up to TRUNCATION, and with a surcharge of each group, in UNITS-ths."""

    kind: Any = np.uint16 if TRUNCATION * UNITS * len(costs) < 2**16 else np.uint32
    wide = [cost.astype(kind) for cost in costs]

    def mean(members: Sequence[int]) -> Cost:
        total: Any = wide[members[0]].copy()
        for member in members[1:]:
            total += wide[member]
        total *= kind(UNITS)
        total //= kind(len(members))
        return np.asarray(total, dtype=np.uint16)

    best = mean(range(len(costs)))
    for group in groups:
        if len(group) < len(costs):
            np.minimum(best, mean(group) + np.uint16(ONE_SIDE), out=best)
    return best


class Planes:
    """Planes across the view axis, and which of their pixels the views do not see; built once for a geometry.

    Args:
        views: of the size of the pictures to come.
        seen: (t, s, v, u) float32, 1 where a view has a sample and 0 elsewhere.
        inverse_distances: of the planes (n,).
    """

    def __init__(self, views: Views, seen: NDArray[np.float32], inverse_distances: FloatArray):
        self.size = views.width_px, views.height_px
        self.others = other_views(views)
        self.groups = sides(views)
        self.matrices = [[parallax(views, index).affine(q) for index in self.others] for q in inverse_distances]
        self.unseen = [
            [self._gap(seen[index], matrix) for index, matrix in zip(self.others, row, strict=True)]
            for row in self.matrices
        ]

    def _gap(self, seen: NDArray[np.float32], matrix: FloatArray) -> NDArray[np.bool_] | None:
        """Which pixels (v, u) of a plane a view does not see; None where it sees all."""
        gap = np.asarray(self._warped(seen, matrix) < 1.0 - 1e-3)
        return gap if gap.any() else None

    def _warped(self, picture: Any, matrix: FloatArray) -> Any:
        return cv2.warpAffine(picture, matrix, self.size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)

    def cost(self, plane: int, pictures: Sequence[Grey], reference: Grey) -> Cost:
        """The cost (v, u) of a plane, of the pictures (v, u) of the other views and of the reference view."""
        costs: list[Grey] = []
        for picture, matrix, unseen in zip(pictures, self.matrices[plane], self.unseen[plane], strict=True):
            cost: Any = cv2.absdiff(self._warped(picture, matrix), reference)
            np.minimum(cost, np.uint8(TRUNCATION), out=cost)
            if unseen is not None:
                np.copyto(cost, np.uint8(UNSEEN), where=unseen)
            costs.append(cost)
        return best_half(costs, self.groups)
