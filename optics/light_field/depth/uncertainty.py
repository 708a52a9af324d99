"""How sure depth is: a standard deviation, and the probability of being right.

The forms follow from what is measured: the error of a surface that is smoothed at inverse variance SMOOTH grows with
about the fourth root of noise over information. Their constants were set on rendered scenes with true depth;
`python -m benchmarks.light_field_depth_scenes` prints how true they are.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.refine import Match, jumps

Float32 = NDArray[np.float32]

AVERAGED_PX = 7
SIGMA_PX = 0.036
"""Standard deviation, px of the farthest view's motion, at INFORMATION and at margins of SURE_MARGIN and more."""
INFORMATION = 50.0
ROOT = 0.2
VIEWS_ROOT = 0.2
"""Views see one texture by one interpolation: their errors go together, and eight say nearly what eighty do."""
LEAST_NOISE = 0.3
SURE_MARGIN, LEAST_MARGIN = 12.0, 0.1
LEAST_SMOOTH = 0.2
RIGHT_PX = 0.5
"""The probability is that of an error below that, px of the farthest view's motion."""
DOUBTFUL_MARGIN = 9.0
"""Margin from which on another place is no rival, in the unit of the penalties of eight views."""
AT_EDGE, NEAR_EDGE, ELSEWHERE = 0.85, 0.97, 0.995
"""Probability of being right where the margin says nothing against it: at a depth edge, within 3 px, and elsewhere."""
NEAR_EDGE_PX = 3
POOR_MATCH = 0.75
"""Part of the largest matching cost from which on depth is less likely right, down to never."""


def _mean(values: Float32) -> Any:
    return cv2.blur(values, (AVERAGED_PX, AVERAGED_PX))


def standard_deviation_px(match: Match, smooth: Float32, margin: Float32, views: int, range_px: float) -> Float32:
    """Standard deviation (v, u) of the place, px of the farthest view's motion, that of an even `range_px` at most.

    Parameters
    ----------
    match
        The match of the views at the place.
    smooth
        Weight (v, u), 0 to 1, of the surface's being smooth.
    margin
        By how much (v, u) the next best place is dearer, in the unit of the penalties of eight views.
    views
        Number of views but the reference view.
    """
    weight = np.maximum(match.agreeing, np.float32(1e-3))
    noise = np.maximum(_mean(match.residual * weight) / _mean(weight) / 2.0, LEAST_NOISE)
    information = np.maximum(_mean(match.information) * (8.0 / max(views, 8)) ** VIEWS_ROOT, 0.5)
    least: Any = cv2.erode(margin, np.ones((3, 3), np.uint8))
    unsure = SURE_MARGIN / np.clip(least, LEAST_MARGIN, SURE_MARGIN)
    rough = np.clip(_mean(smooth), LEAST_SMOOTH, 1.0) ** -3
    sigma = SIGMA_PX * np.power(noise / information * INFORMATION, ROOT) * unsure * rough
    return np.minimum(sigma, range_px / np.sqrt(12.0)).astype(np.float32)


def probability(moved: Float32, rivals: Float32, mismatch: Float32) -> Float32:
    """Probability (v, u) that places (v, u), px of the farthest view's motion, are right to RIGHT_PX.

    One of all places that are about as cheap; less at depth edges, where pixels are of two surfaces, and where hardly
    any view shows the same.
    """
    shown = np.clip((1.0 - mismatch) * np.float32(1.0 / (1.0 - POOR_MATCH)), 0.0, 1.0)
    right = shown / (1.0 + rivals)
    away: Any = cv2.distanceTransform((~jumps(moved)).astype(np.uint8), cv2.DIST_L2, 3)
    edge = np.where(away < 1, AT_EDGE, np.where(away < NEAR_EDGE_PX, NEAR_EDGE, ELSEWHERE))
    return np.asarray(right * edge, dtype=np.float32)
