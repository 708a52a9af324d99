"""Errors of a depth map in px and in sigmas, and whether its stated probabilities are right.

Errors are disparities at the longest baseline, px: the confidence of a depth map is the probability that its error is
less than 0.5 px there.
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
"""Second difference of the truth, px per view step of the full grid, above which there is a depth edge."""
MAX_ERROR_PX = 0.5
BLOCK_PX = 32
"""Side of the squares within which errors are assumed to be dependent, so that their pixels count as fewer."""
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class MeasuredScene:
    """Depth of a scene's central view, and its truth.

    Attributes
    ----------
    disparity_px, truth_px : ndarray of float32
        (v, u), px per view step of the full grid; NaN where unknown.
    sigma_px, confidence : ndarray
        (v, u), of the depth map: standard deviation of the disparity at the longest baseline, px, and probability.
    farthest_steps : float
        Steps of the full grid from the central to the farthest view, along an axis.
    """

    disparity_px: Disparity
    truth_px: Disparity
    sigma_px: FloatArray
    confidence: NDArray[np.float32]
    farthest_steps: float

    @cached_property
    def error_px(self) -> FloatArray:
        """Absolute error (v, u) of the disparity at the longest baseline, px; NaN without depth or truth, and at the
        border that the benchmark excludes."""
        error = np.full(self.truth_px.shape, np.nan)
        inner = (slice(BORDER_PX, -BORDER_PX),) * 2
        error[inner] = (np.abs(self.disparity_px.astype(np.float64) - self.truth_px) * self.farthest_steps)[inner]
        return error

    @cached_property
    def has_error(self) -> Mask:
        """Mask (v, u) of the pixels with an error."""
        return np.isfinite(self.error_px)

    @cached_property
    def flat_sigmas(self) -> FloatArray:
        """Errors (n,) in sigmas, of pixels away from depth edges."""
        flat = self.has_error & ~at_edges(self.truth_px)
        return np.asarray(self.error_px[flat] / self.sigma_px[flat])

    @cached_property
    def blocks(self) -> NDArray[np.int64]:
        """Number (v, u) of the square of BLOCK_PX that contains a pixel."""
        height, width = self.truth_px.shape
        v, u = np.mgrid[:height, :width] // BLOCK_PX
        return np.asarray(v * (width // BLOCK_PX + 1) + u, dtype=np.int64)


@dataclass(frozen=True)
class Class:
    """Pixels whose stated probability lies between two bounds.

    `stated` is its mean, `right` the fraction of pixels with errors up to MAX_ERROR_PX, with the 95 % interval `low` to
    `high`.
    """

    count: int
    stated: float
    right: float
    low: float
    high: float


def at_edges(truth_px: Disparity) -> Mask:
    """Return the mask (v, u) of pixels within EDGE_PX of an edge of disparity (v, u), px per step of the full grid."""
    curvature = np.abs(cv2.Laplacian(np.nan_to_num(truth_px), cv2.CV_32F, ksize=1))
    side = 2 * EDGE_PX + 1
    return np.asarray(cv2.dilate((curvature > EDGE_STEP_PX).astype(np.uint8), np.ones((side, side), np.uint8))) > 0


def sigma_px(depth: DepthMap) -> FloatArray:
    """Return the standard deviation (v, u) of the disparity at the longest baseline, px."""
    views = depth.views
    distance = depth.depth_mm.astype(np.float64) - views.reference_view_depth_mm
    scale = views.focal_px * float(np.abs(views.positions_mm[..., :2]).max())
    return np.asarray(depth.sigma_mm / np.square(distance) * scale)


def reliability(scenes: Sequence[MeasuredScene], bounds: Sequence[float]) -> list[Class]:
    """Return how often depth is right, by classes of stated probability between adjacent bounds, the last included.

    Empty classes are omitted. The interval is Wilson's of a binomial fraction, for the number of independent pixels
    that gives the fraction the variance that it has between blocks of BLOCK_PX (Kish 1965, the design effect).
    """
    stated = np.concatenate([scene.confidence[scene.has_error] for scene in scenes]).astype(np.float64)
    right = np.concatenate([scene.error_px[scene.has_error] < MAX_ERROR_PX for scene in scenes])
    starts = np.cumsum([0, *(int(scene.blocks.max()) + 1 for scene in scenes)])
    block = np.concatenate(
        [scene.blocks[scene.has_error] + start for scene, start in zip(scenes, starts, strict=False)]
    )
    number = np.clip(np.searchsorted(bounds, stated, "right") - 1, 0, len(bounds) - 2)
    classes = []
    for index in range(len(bounds) - 1):
        within = number == index
        if count := int(within.sum()):
            fraction = float(right[within].mean())
            by_block = np.bincount(block[within], weights=right[within] - fraction)
            variance = max(float(np.square(by_block).sum()) / count**2, fraction * (1.0 - fraction) / count)
            independent = fraction * (1.0 - fraction) / variance if variance else float(len(np.unique(block[within])))
            classes.append(Class(count, float(stated[within].mean()), fraction, *wilson(fraction, independent)))
    return classes


def wilson(fraction: float, count: float, z: float = 1.96) -> tuple[float, float]:
    """Return the interval of a binomial fraction of `count` trials, `z` sigmas to either side (Wilson 1927)."""
    centre = (fraction + z**2 / (2.0 * count)) / (1.0 + z**2 / count)
    half = z / (1.0 + z**2 / count) * float(np.sqrt(fraction * (1.0 - fraction) / count + z**2 / (4.0 * count**2)))
    return max(centre - half, 0.0), min(centre + half, 1.0)
