"""The depth search at one pyramid level: over all planes, or over those near the result of a coarser level."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.processes.threads import MapFunction
from mirrorcam.optics.light_field.depth.competition import UNITS
from mirrorcam.optics.light_field.depth.cost import channels, matching_costs
from mirrorcam.optics.light_field.depth.enlargement import doubled
from mirrorcam.optics.light_field.depth.parallax import MAX_PLANES, halved, plane_inverse_distances
from mirrorcam.optics.light_field.depth.photometry import ViewPicture
from mirrorcam.optics.light_field.depth.semiglobal import (
    PATH_DIRECTIONS,
    LowestCost,
    aggregate,
    lowest_cost,
    surface_slants,
)
from mirrorcam.optics.light_field.depth.sweep import Ranges, Sweep, nearest_planes, sweep
from mirrorcam.optics.light_field.depth.uncertainty import DOUBTFUL_MARGIN
from mirrorcam.optics.light_field.light_field import Views

Float32 = NDArray[np.float32]

FINE_PX, COARSE_PX = 0.5, 1.0
"""Step of disparity at the longest baseline from plane to plane, in pixels of the pyramid level: fine and coarse."""
MAX_FINE_PLANES = 192
"""Maximum number of planes of a search over all planes at fine spacing; more are spaced coarsely."""
NEXT_PLANE_PENALTY, JUMP_PENALTY = 2.5, 12.0
"""P1 and P2 of semi-global matching, as matching costs, for eight views besides the reference view."""


@dataclass(frozen=True, eq=False)
class PyramidLevel:
    """A pyramid level to search: number of halvings, resulting size (v, u) in px, and the sweep at that size."""

    halvings: int
    shape: tuple[int, int]
    sweep: Sweep

    @classmethod
    def of(
        cls, views: Views, near_mm: float, far_mm: float, halvings: int, max_planes: int = MAX_PLANES
    ) -> PyramidLevel:
        """Return the level after `halvings`, with planes between two depths: finely spaced if at most `max_planes`."""
        for _ in range(halvings):
            views = halved(views)
        planes = plane_inverse_distances(views, near_mm, far_mm, COARSE_PX)
        if len(planes) * COARSE_PX / FINE_PX <= max_planes:
            planes = plane_inverse_distances(views, near_mm, far_mm, FINE_PX)
        return cls(halvings, (views.height_px, views.width_px), sweep(views, planes))

    @property
    def cost_count(self) -> int:
        """Number of pixels times planes."""
        return self.shape[0] * self.shape[1] * self.sweep.plane_count

    def shrunk(self, picture: ViewPicture) -> ViewPicture:
        """Return a full-size picture at this level."""
        for _ in range(self.halvings):
            picture = picture.halved
        return picture

    def enlarged(self, result: LowestCost, coarser: PyramidLevel) -> LowestCost:
        """Return the result of a coarser level at this size and in this sweep's planes."""
        maps = {name: getattr(result, name) for name in ("planes", "margin", "rivals")}
        for halvings in range(coarser.halvings - 1, self.halvings - 1, -1):
            shape = self.shape if halvings == self.halvings else None
            maps = {name: doubled(values, shape) for name, values in maps.items()}
        maps["planes"] = self.sweep.planes(coarser.sweep.inverse_distance(maps["planes"]))
        return LowestCost(**maps)


@dataclass(frozen=True, eq=False)
class LevelViews:
    """The views at one level, as `matching_costs` compares them, for all searches there.

    Attributes
    ----------
    reference, others
        `channels` (v + 1, 4 (u + 1)) of the reference view and (K, v + 1, 4 (u + 1)) of the others.
    valid
        (K, v, u), 1 where a view has samples in the pixel and its neighbours, else 0.
    """

    reference: Float32
    others: Float32
    valid: NDArray[np.uint8]

    @classmethod
    def of(
        cls, level: PyramidLevel, reference: ViewPicture, others: Sequence[ViewPicture], run: MapFunction = map
    ) -> LevelViews:
        """Return the views at a level, from equalised ones at full size."""
        pictures = list(run(level.shrunk, [reference, *others]))
        first, *rest = run(lambda picture: channels(picture.brightness, picture.chroma), pictures)
        return cls(first, np.stack(rest), np.stack([picture.interior for picture in pictures[1:]]))


def search(
    level: PyramidLevel,
    colours: Float32,
    views: LevelViews,
    run: MapFunction = map,
    *,
    directions: int = len(PATH_DIRECTIONS),
    rounds: int = 0,
    earlier: LowestCost | None = None,
    ranges: Ranges | None = None,
) -> LowestCost:
    """Return the planes of lowest cost at a level, with margins as matching costs, normalised to eight views.

    Parameters
    ----------
    level
        Pyramid level, with its sweep.
    colours
        Colours (v, u, 3) of the reference view at this level, 0 to 255; depth edges are likely at colour edges.
    views
        The views at this level.
    run
        `map`, or the `map` of a thread pool.
    directions
        Number of PATH_DIRECTIONS that paths follow.
    rounds
        Number of further passes along the slanted surfaces of the pass before.
    earlier
        Earlier result at this level: gives occlusion and the slant of surfaces.
    ranges
        Planes to search at each pixel; all by default.
    """
    # A matching cost of 1, scaled as the noise of the mean of this number of views.
    unit = UNITS * math.sqrt(8.0 / len(views.others))
    penalties = round(NEXT_PLANE_PENALTY * unit), round(JUMP_PENALTY * unit)
    volume = matching_costs(
        views.reference,
        views.others,
        views.valid,
        level.sweep,
        run,
        None if earlier is None else nearest_planes(earlier.planes, level.sweep, run),
        ranges,
    )

    def search_along(slants: tuple[Float32, Float32]) -> LowestCost:
        total = aggregate(volume, colours, slants, penalties, run, directions)
        result = lowest_cost(total, DOUBTFUL_MARGIN * directions * unit, run)
        return replace(result, margin=result.margin * np.float32(1.0 / (directions * unit)))

    flat = np.zeros(level.shape, np.float32)
    result = search_along((flat, flat) if earlier is None else surface_slants(earlier.planes, earlier.margin))
    for _ in range(rounds):
        result = search_along(surface_slants(result.planes, result.margin))
    return result
