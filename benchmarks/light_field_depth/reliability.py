"""Errors of a depth map in px and in sigmas, and how often its stated probabilities hold.

Errors are in px of the farthest view: the confidence of a depth map is the probability of less than half of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.light_field_depth.stereo import BORDER_PX, Disparity
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth import DepthMap

EDGE_PX = 4
EDGE_STEP_PX = 0.12
"""Second difference of the truth, px per view step of the full grid, that is a depth edge."""
RIGHT_PX = 0.5
BLOCK_PX = 32
"""Side of the squares within which errors are taken to be dependent: their pixels count as fewer than they are."""
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class MeasuredScene:
    """Depth of a scene's central view, and its truth.

    Attributes
    ----------
    disparity_px, truth_px : ndarray of float32
        (v, u), px per view step of the full grid; NaN where not known.
    sigma_px, confidence : ndarray
        (v, u), of the depth map: standard deviation in px of the farthest view, and probability.
    reach : float
        Steps of the full grid from the central to the farthest view, along an axis.
    """

    disparity_px: Disparity
    truth_px: Disparity
    sigma_px: FloatArray
    confidence: NDArray[np.float32]
    reach: float

    @cached_property
    def error_px(self) -> FloatArray:
        """Absolute error (v, u) in px of the farthest view; NaN where there is no depth or no truth, and at the
        border that the benchmark leaves out."""
        error = np.full(self.truth_px.shape, np.nan)
        inner = (slice(BORDER_PX, -BORDER_PX),) * 2
        error[inner] = (np.abs(self.disparity_px.astype(np.float64) - self.truth_px) * self.reach)[inner]
        return error

    @cached_property
    def judged(self) -> Mask:
        """Mask (v, u) of the pixels with an error."""
        return np.isfinite(self.error_px)

    @cached_property
    def flat_sigmas(self) -> FloatArray:
        """Errors (n,) in sigmas, of pixels away from depth edges."""
        flat = self.judged & ~at_edges(self.truth_px)
        return np.asarray(self.error_px[flat] / self.sigma_px[flat])

    @cached_property
    def blocks(self) -> NDArray[np.int64]:
        """Number (v, u) of the square of BLOCK_PX that a pixel is in."""
        height, width = self.truth_px.shape
        v, u = np.mgrid[:height, :width] // BLOCK_PX
        return np.asarray(v * (width // BLOCK_PX + 1) + u, dtype=np.int64)


@dataclass(frozen=True)
class Class:
    """Pixels whose stated probability lies between two bounds.

    `stated` is the mean of it, `right` the share of them that are right to RIGHT_PX, between `low` and `high` with
    95 % probability.
    """

    count: int
    stated: float
    right: float
    low: float
    high: float


def at_edges(truth_px: Disparity) -> Mask:
    """Mask (v, u) of pixels within EDGE_PX of an edge of disparity (v, u), px per view step of the full grid."""
    bend = np.abs(cv2.Laplacian(np.nan_to_num(truth_px), cv2.CV_32F, ksize=1))
    side = 2 * EDGE_PX + 1
    return np.asarray(cv2.dilate((bend > EDGE_STEP_PX).astype(np.uint8), np.ones((side, side), np.uint8))) > 0


def sigma_px(found: DepthMap) -> FloatArray:
    """Standard deviation (v, u) in px of the farthest view's motion."""
    views = found.views
    distance = found.depth_mm.astype(np.float64) - views.reference_view_depth_mm
    reach = views.focal_px * float(np.abs(views.positions_mm[..., :2]).max())
    return np.asarray(found.sigma_mm / np.square(distance) * reach)


def reliability(scenes: Sequence[MeasuredScene], bounds: Sequence[float]) -> list[Class]:
    """How often depth is right, by classes of its stated probability between neighbouring bounds, the last of which
    belongs to its class; classes of no pixel are left out.

    The interval is Wilson's of a binomial share, of as many independent pixels as give the share the variance that
    it has between blocks of BLOCK_PX (Kish 1965, the design effect).
    """
    stated = np.concatenate([each.confidence[each.judged] for each in scenes]).astype(np.float64)
    right = np.concatenate([each.error_px[each.judged] < RIGHT_PX for each in scenes])
    starts = np.cumsum([0, *(int(each.blocks.max()) + 1 for each in scenes)])
    block = np.concatenate([each.blocks[each.judged] + start for each, start in zip(scenes, starts, strict=False)])
    number = np.clip(np.searchsorted(bounds, stated, "right") - 1, 0, len(bounds) - 2)
    classes = []
    for each in range(len(bounds) - 1):
        within = number == each
        if count := int(within.sum()):
            share = float(right[within].mean())
            by_block = np.bincount(block[within], weights=right[within] - share)
            variance = max(float(np.square(by_block).sum()) / count**2, share * (1.0 - share) / count)
            independent = share * (1.0 - share) / variance if variance else float(len(np.unique(block[within])))
            classes.append(Class(count, float(stated[within].mean()), share, *wilson(share, independent)))
    return classes


def wilson(share: float, count: float, z: float = 1.96) -> tuple[float, float]:
    """Ends of the interval of a binomial share of `count` trials, z sigmas wide either way (Wilson 1927)."""
    middle = (share + z**2 / (2.0 * count)) / (1.0 + z**2 / count)
    half = z / (1.0 + z**2 / count) * float(np.sqrt(share * (1.0 - share) / count + z**2 / (4.0 * count**2)))
    return max(middle - half, 0.0), min(middle + half, 1.0)
