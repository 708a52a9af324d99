"""The depth search at one picture size: over all planes, or over those near the result of a smaller size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.competition import UNITS
from mirrorcam.optics.light_field.depth.cost import CHANNELS, channels, matching_costs
from mirrorcam.optics.light_field.depth.parallax import MAX_PLANES, halved, plane_inverse_distances
from mirrorcam.optics.light_field.depth.photometry import ViewPicture
from mirrorcam.optics.light_field.depth.semiglobal import PATH_DIRECTIONS, Cheapest, aggregate, cheapest, slants_of
from mirrorcam.optics.light_field.depth.sweep import Ranges, Sweep, nearest_planes, sweep
from mirrorcam.optics.light_field.depth.uncertainty import DOUBTFUL_MARGIN
from mirrorcam.optics.light_field.light_field import Views

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

FINE_PX, COARSE_PX = 0.5, 1.0
"""Motion of the farthest view from plane to plane, in pixels of the searched size: fine and coarse."""
MAX_SEARCHED = 192
"""Largest number of planes of a search over all planes at fine spacing; more are spaced coarsely."""
NEXT_PLANE, ANY_PLANE = 2.5, 18.0
"""Penalties, in contrasts of eight views; more views justify larger ones."""
PENALTY_POWER = 0.55


@dataclass(frozen=True, eq=False)
class Size:
    """A picture size to search at: number of halvings, resulting size (v, u) in px, and the sweep at that size."""

    halvings: int
    shape: tuple[int, int]
    sweep: Sweep

    @classmethod
    def of(cls, views: Views, near_mm: float, far_mm: float, halvings: int, most: int = MAX_PLANES) -> Size:
        """Return the size after `halvings`, with planes between two depths: finely spaced if at most `most`."""
        for _ in range(halvings):
            views = halved(views)
        planes = plane_inverse_distances(views, near_mm, far_mm, COARSE_PX)
        if len(planes) * COARSE_PX / FINE_PX <= most:
            planes = plane_inverse_distances(views, near_mm, far_mm, FINE_PX)
        return cls(halvings, (views.height_px, views.width_px), sweep(views, planes))

    @property
    def cells(self) -> int:
        """Number of pixels times planes."""
        return self.shape[0] * self.shape[1] * self.sweep.planes

    def picture(self, picture: ViewPicture) -> ViewPicture:
        """Return a full-size picture at this size."""
        for _ in range(self.halvings):
            picture = picture.halved()
        return picture

    def enlarged(self, found: Cheapest, smaller: Size) -> Cheapest:
        """Return a smaller size's result at this size and in this sweep's planes."""
        maps = {name: getattr(found, name) for name in ("planes", "margin", "rivals")}
        for halvings in range(smaller.halvings - 1, self.halvings - 1, -1):
            shape = self.shape if halvings == self.halvings else None
            maps = {name: _doubled(each, shape) for name, each in maps.items()}
        first, step = np.float32(self.sweep.inverse_distances[0]), np.float32(1.0 / self.sweep.step)
        maps["planes"] = np.asarray((smaller.sweep.inverse_distance(maps["planes"]) - first) * step)
        return Cheapest(**maps)


def _doubled(small: Float32, shape: tuple[int, int] | None) -> Float32:
    """Return a map (v, u) at twice the size; an odd last row or column repeats the previous one."""
    full = cv2.resize(small, (2 * small.shape[1], 2 * small.shape[0]), interpolation=cv2.INTER_LINEAR)
    if shape is None:
        return np.asarray(full)
    bottom, right = shape[0] - full.shape[0], shape[1] - full.shape[1]
    return np.asarray(cv2.copyMakeBorder(full, 0, bottom, 0, right, cv2.BORDER_REPLICATE))


def _stacked(pictures: Sequence[ViewPicture], run: Map) -> Float32:
    """Stack `channels` of pictures."""
    height, width = pictures[0].known.shape
    result = np.empty((len(pictures), CHANNELS, height + 1, width + 1), np.float32)

    def fill(number: int) -> None:
        result[number] = channels(pictures[number].colours)

    list(run(fill, range(len(pictures))))
    return result


def search(
    size: Size,
    reference: ViewPicture,
    others: Sequence[ViewPicture],
    run: Map = map,
    *,
    rounds: int = 0,
    known: Cheapest | None = None,
    ranges: Ranges | None = None,
) -> Cheapest:
    """Return the cheapest planes at a size, with margins in contrasts of eight views.

    Parameters
    ----------
    size
        Picture size and sweep.
    reference, others
        The views, at full size and equalised.
    run
        `map`, or the `map` of a thread pool.
    rounds
        Number of further passes along the surfaces found before.
    known
        Earlier result at this size: gives occlusion and the slant of surfaces.
    ranges
        Planes to search at each pixel; all by default.
    """
    small_reference, *small_others = run(size.picture, [reference, *others])
    # One contrast in path costs, for up to eight views.
    unit = UNITS * ((8.0 / len(others)) ** PENALTY_POWER if len(others) > 8 else 1.0)
    penalties = round(NEXT_PLANE * unit), round(ANY_PLANE * unit)
    volume = matching_costs(
        channels(small_reference.colours),
        _stacked(small_others, run),
        np.stack([each.seen for each in small_others]),
        size.sweep,
        run,
        None if known is None else nearest_planes(known.planes, size.sweep, run),
        ranges,
    )

    def search_along(slants: tuple[Float32, Float32]) -> Cheapest:
        total = aggregate(volume, small_reference.colours, slants, penalties, run)
        found = cheapest(total, DOUBTFUL_MARGIN * len(PATH_DIRECTIONS) * unit, run)
        return replace(found, margin=found.margin * np.float32(1.0 / (len(PATH_DIRECTIONS) * unit)))

    level = np.zeros(size.shape, np.float32)
    found = search_along((level, level) if known is None else slants_of(known.planes, known.margin))
    for _ in range(rounds):
        found = search_along(slants_of(found.planes, found.margin))
    return found
