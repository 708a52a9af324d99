"""Matching cost of depths across views: truncated differences of pictures, of the best half of the views.

A pixel beside what stands before it is hidden from the views on one side and seen by those on the other: its cost is
the least of the means over all views and over those to the left, right, top and bottom of the reference view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.light_field.depth.geometry import other_views, parallax
from mirrorcam.optics.light_field.depth.semiglobal import Map
from mirrorcam.optics.light_field.light_field import Views

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
WARP_PX = 0.1
"""Largest error at a picture's edge, where a shift stands for shift and stretch."""
AXIS_SHARE = 0.25
"""A view lies to a side if it is that part of the farthest view's offset away along the axis."""


def sides(views: Views) -> list[list[int]]:
    """Views of each side of the reference view that has any, as indices into `other_views`."""
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


@dataclass(frozen=True, eq=False)
class _Block:
    """Neighbouring planes between which a view's picture only shifts, but for less than `WARP_PX`.

    Attributes
    ----------
    matrix
        Affine transform (2, 3) from pixels of a padded picture to those of the view, for the middle plane of the block.
    size
        Width and height of the padded picture.
    """

    matrix: FloatArray
    size: tuple[int, int]


class Planes:
    """Planes across the view axis, and which of their pixels the views do not see; built once for a geometry.

    Parameters
    ----------
    views
        Geometry of the views, with the size of the pictures to come.
    seen
        Mask (t, s, v, u), float32: 1 where a view has a sample and 0 elsewhere.
    inverse_distances
        Inverse distances (n,) of the planes from the reference view, 1/mm, evenly spaced.
    """

    def __init__(self, views: Views, seen: NDArray[np.float32], inverse_distances: FloatArray):
        self.size = views.width_px, views.height_px
        self.groups = sides(views)
        others = other_views(views)
        self._blocks: list[list[_Block]] = []
        # Of each plane and view: which block, the middle of the picture in its padded one, and what is not seen.
        self._views: list[list[tuple[int, tuple[float, float], NDArray[np.bool_] | None]]] = [
            [] for _ in inverse_distances
        ]
        for index in others:
            matrices = [parallax(views, index).affine(q) for q in inverse_distances]
            blocks: list[_Block] = []
            for planes in self._runs(matrices):
                block, middles = self._block([matrices[plane] for plane in planes])
                for plane, middle in zip(planes, middles, strict=True):
                    gap = self._gap(seen[index], matrices[plane])
                    self._views[plane].append((len(blocks), middle, gap))
                blocks.append(block)
            self._blocks.append(blocks)

    def _runs(self, matrices: Sequence[FloatArray]) -> list[range]:
        """The planes, cut where a picture would stretch too much against the first of a run."""
        longest = 2.0 * WARP_PX / (max(self.size) / 2.0)
        starts = [0]
        for plane, matrix in enumerate(matrices):
            if abs(matrix[0, 0] / matrices[starts[-1]][0, 0] - 1.0) > longest:
                starts.append(plane)
        return [range(start, stop) for start, stop in zip(starts, [*starts[1:], len(matrices)], strict=True)]

    def _block(self, matrices: Sequence[FloatArray]) -> tuple[_Block, list[tuple[float, float]]]:
        """The block of planes with these matrices, and where each has the middle of the picture."""
        middle = np.array([(length - 1) / 2.0 for length in self.size])
        central = matrices[len(matrices) // 2]
        places = np.array([(m[:, :2] @ middle + m[:, 2] - central[:, 2]) / central[0, 0] for m in matrices])
        margin = np.ceil(np.abs(places - middle).max(axis=0)) + 2.0
        padded = central.copy()
        padded[:, 2] -= central[0, 0] * margin
        size = (self.size[0] + 2 * int(margin[0]), self.size[1] + 2 * int(margin[1]))
        return _Block(padded, size), [(float(x), float(y)) for x, y in places + margin]

    def _gap(self, seen: NDArray[np.float32], matrix: FloatArray) -> NDArray[np.bool_] | None:
        """Mask of the pixels (v, u) of a plane that a view does not see; None where it sees all."""
        gap = np.asarray(_warped(seen, matrix, self.size) < 1.0 - 1e-3)
        return gap if gap.any() else None

    def prepared(self, pictures: Sequence[Grey], run: Map = map) -> list[list[Grey]]:
        """The pictures (v, u) of the other views, warped to the middle planes of the blocks: the input of `cost`."""

        def one(picture: Grey, blocks: Sequence[_Block]) -> list[Grey]:
            return [_warped(picture, block.matrix, block.size) for block in blocks]

        return list(run(one, pictures, self._blocks))

    def cost(self, plane: int, prepared: Sequence[Sequence[Grey]], reference: Grey) -> Cost:
        """The cost (v, u) of a plane, of `prepared` pictures of the other views and that of the reference view."""
        costs: list[Grey] = []
        for pictures, (block, middle, gap) in zip(prepared, self._views[plane], strict=True):
            shown: Any = cv2.getRectSubPix(pictures[block], self.size, middle)
            cv2.absdiff(shown, reference, shown)
            np.minimum(shown, np.uint8(TRUNCATION), out=shown)
            if gap is not None:
                np.copyto(shown, np.uint8(UNSEEN), where=gap)
            costs.append(shown)
        return best_half(costs, self.groups)


def _warped(picture: Any, matrix: FloatArray, size: tuple[int, int]) -> Any:
    return cv2.warpAffine(picture, matrix, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
