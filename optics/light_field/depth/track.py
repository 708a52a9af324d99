"""What the depth of a frame of a video passes on to the next frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.photometry import halved_picture
from mirrorcam.optics.light_field.depth.search import PyramidLevel
from mirrorcam.optics.light_field.depth.semiglobal import LowestCost
from mirrorcam.optics.light_field.depth.sweep import TILE_PX, Ranges, tracked_range

Float32 = NDArray[np.float32]

REFRESH_FRAMES = 8
"""Frames of a video after which each tile was searched over all planes at least once."""


@dataclass(frozen=True, eq=False)
class Track:
    """Results of a frame of a video that the next frame starts from.

    Attributes
    ----------
    gains
        Gains (v, u) that equalise the other views to the reference view.
    first
        Result of the first search.
    planes
        Refined planes (j, i) at the last level to search.
    noise_ratio
        Noise of the views, see `ViewComparison.noise_ratio`.
    frame
        Number of frames so far.
    """

    gains: list[Float32 | float]
    first: LowestCost
    planes: Float32
    noise_ratio: float
    frame: int

    def first_ranges(self, level: PyramidLevel, changed: NDArray[np.bool_]) -> Ranges:
        """Return the ranges of the next frame's first search, at its level: all planes where it has `changed` (v, u).

        Every row of tiles gets all planes once in REFRESH_FRAMES frames.
        """
        unknown = changed.astype(np.float32)
        for _ in range(level.halvings):
            unknown = halved_picture(unknown)
        rows = np.arange(TILE_PX // 2, level.shape[0], TILE_PX)
        unknown[rows[self.frame % REFRESH_FRAMES :: REFRESH_FRAMES]] = 1.0
        return tracked_range([self.first.planes], level.sweep.plane_count, unknown > 0)
