"""Uncertainty of depth: a standard deviation, and the probability that the depth is right.

The forms follow from measurement: the error of a surface smoothed with inverse variance SMOOTH grows with a root of
noise over information, and the odds of a right depth fall with the number of other places of about the same cost. The
constants were fitted to public scenes with true depth, by quantile and by logistic regression;
`python -m benchmarks.light_field_depth scenes` prints how well they hold.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.refine import Match, jumps, unshared

Float32 = NDArray[np.float32]

AVERAGE_PX = 7
SIGMA_PX = 0.043
"""Standard deviation, px of the farthest view's motion, at INFORMATION and at a margin of SURE_MARGIN or more."""
INFORMATION = 50.0
ROOT, MARGIN_ROOT, ROUGH_POWER = 0.18, 0.14, 7
MIN_NOISE, MIN_INFORMATION = 0.3, 0.5
SURE_MARGIN, MIN_MARGIN = 12.0, 0.1
MIN_SMOOTH = 0.5
HALVED = 1.7
"""Factor for a search at half size."""
RIGHT_PX = 0.5
"""A depth is right if its error is below this, px of the farthest view's motion."""
DOUBTFUL_MARGIN = 9.0
"""Margin above which another place is no rival, in contrasts of eight views."""
AT_EDGE, NEAR_EDGE, ELSEWHERE = 1.27, 1.59, 1.65
"""Logarithm of the odds of being right at a depth edge, within NEAR_EDGE_PX, and elsewhere."""
NEAR_EDGE_PX = 3
RIVALS, MIN_RIVALS, SMOOTH, HALVED_ODDS = -0.81, 0.02, 1.2, -1.33
"""Addends to the log odds: per logarithm of the number of rivals, per smoothness, for a search at half size."""

CORRELATION_PX = 41
UNRELATED, RELATED = 0.04, 0.16
"""Correlation of gradients below which views show unrelated things, and above which they show the same."""
MIN_ENERGY = 1e-3
USUAL_RIVALS = 2.0
"""Number of rivals that a first search always leaves, because it does not separate adjacent places."""


def _mean(values: Float32) -> Any:
    return cv2.blur(values, (AVERAGE_PX, AVERAGE_PX))


def standard_deviation_px(
    match: Match, smooth: Float32, margin: Float32, views: int, halved: bool, range_px: float
) -> Float32:
    """Standard deviation (v, u), px of the farthest view's motion, at most that of a uniform distribution.

    Parameters
    ----------
    match
        The match of the views at the depth map.
    smooth
        Weight (v, u), 0 to 1, of the surface's smoothness.
    margin
        Cost difference (v, u) to the next best place, in contrasts of eight views.
    views
        Number of views without the reference view.
    halved
        Whether the planes were searched at half size.
    range_px
        Motion of the farthest view between the nearest and the farthest plane, px.
    """
    weight = np.maximum(match.agreeing, np.float32(1e-3))
    noise = np.maximum(_mean(match.residual * weight) / _mean(weight) / 2.0, MIN_NOISE)
    information = np.maximum(_mean(match.information) * unshared(views), MIN_INFORMATION)
    nearby_margin: Any = cv2.erode(margin, np.ones((3, 3), np.uint8))
    doubt = (SURE_MARGIN / np.clip(nearby_margin, MIN_MARGIN, SURE_MARGIN)) ** MARGIN_ROOT
    rough = np.clip(_mean(smooth), MIN_SMOOTH, 1.0) ** -ROUGH_POWER
    sigma = SIGMA_PX * np.power(noise / information * INFORMATION, ROOT) * doubt * rough * (HALVED if halved else 1.0)
    return np.minimum(sigma, range_px / np.sqrt(12.0)).astype(np.float32)


def probability(
    moved: Float32, match: Match, rivals: Float32, everywhere: Float32, smooth: Float32, halved: bool
) -> Float32:
    """Probability (v, u) that a depth map is right to RIGHT_PX.

    Parameters
    ----------
    moved
        Depth map (v, u) in px of the farthest view's motion; its jumps mark depth edges.
    match
        The match of the views there. Where their gradients do not correlate with the reference view's over
        CORRELATION_PX, no depth in the range is right.
    rivals
        Number (v, u) of other places of about the same cost in the last search.
    everywhere
        The same for the first search, over all planes: many where the depth is undetermined, and only one is right.
    smooth
        Weight (v, u), 0 to 1, of the surface's smoothness.
    halved
        Whether the planes were searched at half size.
    """
    edge_px: Any = cv2.distanceTransform((~jumps(moved)).astype(np.uint8), cv2.DIST_L2, 3)
    odds = np.where(edge_px < 1, AT_EDGE, np.where(edge_px < NEAR_EDGE_PX, NEAR_EDGE, ELSEWHERE)) + SMOOTH * smooth
    odds += RIVALS * np.log(rivals + MIN_RIVALS) + (HALVED_ODDS if halved else 0.0)
    energies = cv2.blur(match.energies, (CORRELATION_PX, CORRELATION_PX))
    correlation = cv2.blur(match.products, (CORRELATION_PX, CORRELATION_PX)) / np.maximum(energies, MIN_ENERGY)
    # Without texture, the rivals already lower the probability.
    correlated = np.where(energies > MIN_ENERGY, correlation, 1.0)
    shown = np.clip((correlated - UNRELATED) / (RELATED - UNRELATED), 0.0, 1.0)
    shared = 1.0 + np.maximum(everywhere - USUAL_RIVALS, 0.0)
    return np.asarray(shown / ((1.0 + np.exp(-odds)) * shared), dtype=np.float32)
