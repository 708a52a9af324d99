"""Costs of planes, of each pixel those of a range of its own: near what is known from a smaller size, or of all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]

TILE_PX = 8
"""Pixels of a tile of that side have the same range."""
AROUND_PX = 8
"""What is known within that distance of the tile is searched, too: edges are found anew."""
MARGIN_PLANES = 6
"""Planes that are searched nearer and farther than what is known."""
FEWEST_PLANES = 3


class Ranges(NamedTuple):
    """The planes that are searched at each pixel (v, u), tile by tile, and where their costs lie, one after the other.

    Attributes
    ----------
    low, planes
        First plane and number of planes, int32.
    start
        Index of the cost of the first plane, int64.
    """

    low: NDArray[np.int32]
    planes: NDArray[np.int32]
    start: NDArray[np.int64]

    @property
    def cells(self) -> int:
        """Number of costs."""
        return int(self.start[-1, -1] + self.planes[-1, -1])

    @classmethod
    def of(cls, low: NDArray[np.int32], count: NDArray[np.int32]) -> Ranges:
        """Ranges of given first planes and numbers of planes (v, u)."""
        ends = np.cumsum(count.ravel(), dtype=np.int64).reshape(count.shape)
        return cls(np.ascontiguousarray(low), np.ascontiguousarray(count), ends - count)


def whole_range(shape: tuple[int, int], planes: int) -> Ranges:
    """All planes at every pixel (v, u)."""
    return Ranges.of(np.zeros(shape, np.int32), np.full(shape, planes, np.int32))


def range_around(known: Float32, planes: int) -> Ranges:
    """The ranges near a map of planes (v, u), tile by tile, within the number of `planes` that there are."""
    side = TILE_PX + 2 * AROUND_PX
    # OpenCV's kernels of even sides reach one pixel farther up and left; tiles are sampled so that they are centred.
    height, width = known.shape
    rows, columns = -(-height // TILE_PX), -(-width // TILE_PX)
    grown = cv2.copyMakeBorder(
        known,
        AROUND_PX,
        rows * TILE_PX - height + AROUND_PX,
        AROUND_PX,
        columns * TILE_PX - width + AROUND_PX,
        cv2.BORDER_REPLICATE,
    )
    kernel = np.ones((side, side), np.uint8)
    nearest = cv2.dilate(grown, kernel, anchor=(0, 0))[::TILE_PX, ::TILE_PX][:rows, :columns]
    farthest = cv2.erode(grown, kernel, anchor=(0, 0))[::TILE_PX, ::TILE_PX][:rows, :columns]
    low = np.clip(np.floor(farthest) - MARGIN_PLANES, 0, planes - FEWEST_PLANES).astype(np.int32)
    high = np.clip(np.ceil(nearest) + (MARGIN_PLANES + 1), low + FEWEST_PLANES, planes).astype(np.int32)

    def each(tiles: NDArray[np.int32]) -> NDArray[np.int32]:
        return np.repeat(np.repeat(tiles, TILE_PX, axis=0), TILE_PX, axis=1)[:height, :width]

    return Ranges.of(each(low), each(high - low))


@dataclass(frozen=True, eq=False)
class Volume:
    """Costs (cells,), uint16, of the planes of ranges."""

    ranges: Ranges
    costs: NDArray[np.uint16]

    @classmethod
    def empty(cls, ranges: Ranges) -> Volume:
        """Costs to be filled in."""
        return cls(ranges, np.empty(ranges.cells, np.uint16))
