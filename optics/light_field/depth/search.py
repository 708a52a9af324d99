"""The search for depth at one size of the pictures: of all planes, or of those near what a smaller size found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.competition import UNITS
from mirrorcam.optics.light_field.depth.cost import CHANNELS, channels, matching_costs
from mirrorcam.optics.light_field.depth.parallax import MOST_PLANES, halved, plane_inverse_distances
from mirrorcam.optics.light_field.depth.photometry import ViewPicture
from mirrorcam.optics.light_field.depth.semiglobal import WAYS, Cheapest, aggregate, cheapest, leans_of
from mirrorcam.optics.light_field.depth.sweep import Ranges, Sweep, nearest_planes, sweep
from mirrorcam.optics.light_field.depth.uncertainty import DOUBTFUL_MARGIN
from mirrorcam.optics.light_field.light_field import Views

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

FINE_PX, COARSE_PX = 0.5, 1.0
"""How far the farthest view moves from one plane to the next, in pixels of the size that is searched at."""
MOST_SEARCHED = 192
"""More planes than that are taken farther apart, where all of them are searched."""
NEXT_PLANE, ANY_PLANE = 2.5, 18.0
"""Penalties, in contrasts, of eight views; more views are surer."""
PENALTY_POWER = 0.55


@dataclass(frozen=True, eq=False)
class Size:
    """A size that is searched at: pictures halved so often, of (v, u) px then, and the sweep at that size."""

    halvings: int
    shape: tuple[int, int]
    sweep: Sweep

    @classmethod
    def of(cls, views: Views, near_mm: float, far_mm: float, halvings: int, most: int = MOST_PLANES) -> Size:
        """The size of views halved so often, with planes between two depths: fine ones if no more than most."""
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
        """A picture of full size at this one."""
        for _ in range(self.halvings):
            picture = picture.halved()
        return picture

    def enlarged(self, found: Cheapest, smaller: Size) -> Cheapest:
        """What was found at a smaller size, at this one and in its planes."""
        maps = {name: getattr(found, name) for name in ("planes", "margin", "rivals")}
        for halvings in range(smaller.halvings - 1, self.halvings - 1, -1):
            shape = self.shape if halvings == self.halvings else None
            maps = {name: _doubled(each, shape) for name, each in maps.items()}
        first, step = np.float32(self.sweep.inverse_distances[0]), np.float32(1.0 / self.sweep.step)
        maps["planes"] = np.asarray((smaller.sweep.inverse_distance(maps["planes"]) - first) * step)
        return Cheapest(**maps)


def _doubled(small: Float32, shape: tuple[int, int] | None) -> Float32:
    """A map of two by two pixels (v, u) at twice the size; an odd last row or column repeats the one before."""
    full = cv2.resize(small, (2 * small.shape[1], 2 * small.shape[0]), interpolation=cv2.INTER_LINEAR)
    if shape is None:
        return np.asarray(full)
    below, right = shape[0] - full.shape[0], shape[1] - full.shape[1]
    return np.asarray(cv2.copyMakeBorder(full, 0, below, 0, right, cv2.BORDER_REPLICATE))


def _stacked(pictures: Sequence[ViewPicture], run: Map) -> Float32:
    """`channels` of pictures."""
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
    """The planes of a size that cost least, and how sure that is: margins in contrasts of eight views.

    Parameters
    ----------
    size
        Size and sweep.
    reference, others
        The views, at full size and equally bright.
    run
        `map`, or that of a pool of threads.
    rounds
        So often paths are followed again, along the surfaces that were found.
    known
        What is known already, at this size: of what hides what, and of how surfaces lean.
    ranges
        The planes that are searched at each pixel; all by default.
    """
    own, *small = run(size.picture, [reference, *others])
    # One contrast of the cost of a path where there are eight views.
    unit = UNITS * ((8.0 / len(others)) ** PENALTY_POWER if len(others) > 8 else 1.0)
    penalties = round(NEXT_PLANE * unit), round(ANY_PLANE * unit)
    volume = matching_costs(
        channels(own.colours),
        _stacked(small, run),
        np.stack([each.seen for each in small]),
        size.sweep,
        run,
        None if known is None else nearest_planes(known.planes, size.sweep, run),
        ranges,
    )

    def chosen(leans: tuple[Float32, Float32]) -> Cheapest:
        total = aggregate(volume, own.colours, leans, penalties, run)
        found = cheapest(total, DOUBTFUL_MARGIN * len(WAYS) * unit, run)
        return replace(found, margin=found.margin * np.float32(1.0 / (len(WAYS) * unit)))

    level = np.zeros(size.shape, np.float32)
    found = chosen((level, level) if known is None else leans_of(known.planes, known.margin))
    for _ in range(rounds):
        found = chosen(leans_of(found.planes, found.margin))
    return found
