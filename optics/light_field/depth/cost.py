"""Matching cost of planes across all views, with what hides a place reasoned for each view.

Colours and slopes of brightness are compared. Before anything is known of what hides what, views at like distance
from the reference view compete: something near hides a place from the views of some directions only, so the better
half of the directions decides. Once a first depth is known, the views from which something nearer hides the place
are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.cost_kernels import Pictures, average_weak, fill_costs
from mirrorcam.optics.light_field.depth.sweep import Sweep
from mirrorcam.optics.light_field.depth.volume import Ranges, Volume, whole_range

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

CHANNELS = 5
COLOUR, SLOPE = 1.0, 2.0
"""Weights of the mean difference of three colours and of the difference of each of the two slopes of brightness."""
CONTRAST_PX = 7
CONTRAST_GREY = 4.0
CONTRAST_FLOOR = 0.3
HIDING_PX = 1.5
"""Motion of the farthest view by which a surface must be nearer to hide another."""
WEAK_PX = 5
WEAK_GREY = 1.5
"""Slope of brightness, per px, below which costs are averaged over a square of WEAK_PX; at twice that they are not."""
BAND_ROWS = 16


def channels(colours: Float32) -> Float32:
    """What is compared of a picture (v, u, 3), 0 to 255: its colours and the two slopes of brightness.

    Of (5, v + 1, u + 1): the last row and column are there twice, so that each sample has a next one.
    """
    grey: Any = cv2.cvtColor(colours, cv2.COLOR_RGB2GRAY)
    slopes = [cv2.Sobel(grey, cv2.CV_32F, *way, ksize=1, scale=0.5) for way in ((1, 0), (0, 1))]
    return np.stack(
        [cv2.copyMakeBorder(each, 0, 1, 0, 1, cv2.BORDER_REPLICATE) for each in (*cv2.split(colours), *slopes)]
    )


def mean_slope(reference: Float32, side_px: int) -> Float32:
    """Mean sum (v, u) of both absolute slopes of brightness over a square, of `channels` of the reference view."""
    across, down = reference[3:, :-1, :-1]
    return np.asarray(cv2.blur(np.abs(across) + np.abs(down), (side_px, side_px)))


def bands(rows: int) -> list[tuple[int, int]]:
    """First and last row, exclusive, of bands of a picture, to be worked on side by side."""
    return [(first, min(first + BAND_ROWS, rows)) for first in range(0, rows, BAND_ROWS)]


def _wider(maps: Float32) -> Float32:
    """Maps (K, v, u) with their last column twice."""
    return np.concatenate([maps, maps[:, :, -1:]], axis=2)


def matching_costs(
    reference: Float32,
    others: Float32,
    seen: NDArray[np.uint8],
    planes: Sweep,
    run: Map = map,
    nearest: Float32 | None = None,
    ranges: Ranges | None = None,
) -> Volume:
    """Costs of planes of a sweep at each pixel of the reference view, in UNITS-ths of a contrast.

    Parameters
    ----------
    reference
        `channels` of the reference view.
    others
        Those of the other views, (K, 5, v + 1, u + 1).
    seen
        (K, v, u), 1 where a view has samples within the pixel and the next ones, else 0.
    planes
        The sweep of these views.
    run
        `map`, or that of a pool of threads.
    nearest
        Plane (K, v, u) of the nearest surface that each view sees by a first depth, as `nearest_planes` has it.
    ranges
        The planes that are searched at each pixel; all by default.
    """
    slope = mean_slope(reference, CONTRAST_PX)
    shape = slope.shape
    pictures = Pictures(
        reference,
        others,
        np.array([COLOUR / 3.0] * 3 + [SLOPE] * 2, np.float32),
        np.float32(CONTRAST_GREY) / (np.float32(CONTRAST_FLOOR * CONTRAST_GREY) + slope),
        seen,
        np.empty((0, shape[0], shape[1] + 1), np.float32) if nearest is None else _wider(nearest),
        np.float32(HIDING_PX / planes.reach_px),
    )
    volume = Volume.empty(whole_range(shape, planes.planes) if ranges is None else ranges)
    list(run(lambda band: fill_costs(*band, pictures, planes.motion, volume.ranges, volume.costs), bands(shape[0])))
    weak = np.clip(np.float32(2.0) - mean_slope(reference, CONTRAST_PX + 2) / np.float32(WEAK_GREY), 0.0, 1.0)
    if not weak.any():
        return volume
    result = Volume.empty(volume.ranges)
    reach = WEAK_PX // 2
    list(run(lambda band: average_weak(*band, weak, reach, volume.ranges, volume.costs, result.costs), bands(shape[0])))
    return result
