"""Uncertainty of depth: a standard deviation, and the probability that the depth is right.

The forms follow from measurement: the error of a smoothed surface grows with a power of noise over information, and the
odds of a right depth fall with the number of other candidates of about the same cost. The constants were fitted to
public scenes with true depth, by quantile regression and by logistic regression;
`python -m benchmarks.light_field_depth scenes` prints how well they hold.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.refine import Match, depth_edges, information_fraction

Float32 = NDArray[np.float32]

AVERAGE_PX = 7
SIGMA_PX = 0.043
"""Standard deviation, px of disparity at the longest baseline, for INFORMATION and a margin of at least SURE_MARGIN."""
INFORMATION = 50.0
NOISE_EXPONENT, MARGIN_EXPONENT, ROUGHNESS_EXPONENT = 0.18, 0.14, 7
MIN_NOISE, MIN_INFORMATION = 0.3, 0.5
SURE_MARGIN, MIN_MARGIN = 12.0, 0.1
MIN_SMOOTHNESS = 0.5
HALVED_FACTOR = 1.7
"""Factor on the standard deviation for a search at half size."""
COVERED = 0.683
"""Probability that one standard deviation covers; wrong depths that are less likely than the rest do not widen it."""
RIGHT_PX = 0.5
"""A depth is right if its error is below this, in px of disparity at the longest baseline."""
DOUBTFUL_MARGIN = 9.0
"""Margin above which another candidate is not a rival, as a matching cost of eight views."""
AT_EDGE, NEAR_EDGE, ELSEWHERE = 1.27, 1.59, 1.65
"""Log odds of being right at a depth edge, within NEAR_EDGE_PX of one, and elsewhere."""
NEAR_EDGE_PX = 3
RIVALS, MIN_RIVALS, SMOOTHNESS, HALVED_SEARCH = -0.81, 0.02, 1.2, -1.33
"""Terms of the log odds: per logarithm of (rivals + MIN_RIVALS), per smoothness, and for a search at half size."""

CORRELATION_PX = 41
UNRELATED, RELATED = 0.04, 0.16
"""Correlation of gradients below which views show unrelated things, and above which they show the same thing."""
MIN_ENERGY = 1e-3
USUAL_RIVALS = 2.0
"""Number of rivals that a first search always leaves, because it does not separate adjacent candidates."""


def _mean(values: Float32) -> Any:
    return cv2.blur(values, (AVERAGE_PX, AVERAGE_PX))


def standard_deviation_px(
    match: Match, smoothness: Float32, margin: Float32, right: Float32, views: int, halved: bool, range_px: float
) -> Float32:
    """Return standard deviations (v, u), px of disparity at the longest baseline.

    A wrong depth may be anywhere in the search. Where the probability of being right is below COVERED, the standard
    deviation includes a uniform distribution over as much of the range as covers the rest; where nothing determines the
    depth, over all of it.

    Parameters
    ----------
    match
        The match of the views at the depth map.
    smoothness
        Weight (v, u), 0 to 1, of the surface's smoothness.
    margin
        Cost difference (v, u) to the next best candidate, as a matching cost of eight views.
    right
        Probability (v, u) that the depth is right.
    views
        Number of views without the reference view.
    halved
        Whether the planes were searched at half size.
    range_px
        Difference in disparity at the longest baseline between the nearest and the farthest plane.
    """
    weight = np.maximum(match.weight_sum, np.float32(1e-3))
    noise = np.maximum(_mean(match.residual * weight) / _mean(weight) / 2.0, MIN_NOISE)
    information = np.maximum(_mean(match.information) * information_fraction(views), MIN_INFORMATION)
    nearby_margin: Any = cv2.erode(margin, np.ones((3, 3), np.uint8))
    doubt = (SURE_MARGIN / np.clip(nearby_margin, MIN_MARGIN, SURE_MARGIN)) ** MARGIN_EXPONENT
    roughness = np.clip(_mean(smoothness), MIN_SMOOTHNESS, 1.0) ** -ROUGHNESS_EXPONENT
    narrow = (
        SIGMA_PX
        * np.power(noise / information * INFORMATION, NOISE_EXPONENT)
        * doubt
        * roughness
        * (HALVED_FACTOR if halved else 1.0)
    )
    covered = np.maximum(COVERED - right, 0.0) / np.maximum(1.0 - right, 1.0 - COVERED) / COVERED
    uniform = range_px / np.sqrt(12.0)
    return np.minimum(np.hypot(narrow, covered * uniform), uniform).astype(np.float32)


def probability(
    disparity_px: Float32, match: Match, rivals: Float32, first_rivals: Float32, smoothness: Float32, halved: bool
) -> Float32:
    """Return the probability (v, u) that a depth map is right to within RIGHT_PX.

    Parameters
    ----------
    disparity_px
        Depth map (v, u), as disparity at the longest baseline; its jumps mark depth edges.
    match
        The match of the views at this map. Where their gradients do not correlate with the reference view's over
        CORRELATION_PX, no depth in the range is right.
    rivals
        Number (v, u) of other candidates of about the same cost in the last search.
    first_rivals
        Number (v, u) of rivals in the first search, over all planes: large where the depth is undetermined.
    smoothness
        Weight (v, u), 0 to 1, of the surface's smoothness.
    halved
        Whether the planes were searched at half size.
    """
    edge_px: Any = cv2.distanceTransform((~depth_edges(disparity_px)).astype(np.uint8), cv2.DIST_L2, 3)
    log_odds = (
        np.where(edge_px < 1, AT_EDGE, np.where(edge_px < NEAR_EDGE_PX, NEAR_EDGE, ELSEWHERE)) + SMOOTHNESS * smoothness
    )
    log_odds += RIVALS * np.log(rivals + MIN_RIVALS) + (HALVED_SEARCH if halved else 0.0)
    energies = cv2.blur(match.energies, (CORRELATION_PX, CORRELATION_PX))
    correlation = cv2.blur(match.products, (CORRELATION_PX, CORRELATION_PX)) / np.maximum(energies, MIN_ENERGY)
    # Without texture, the rivals already lower the probability.
    correlated = np.where(energies > MIN_ENERGY, correlation, 1.0)
    agreement = np.clip((correlated - UNRELATED) / (RELATED - UNRELATED), 0.0, 1.0)
    candidates = 1.0 + np.maximum(first_rivals - USUAL_RIVALS, 0.0)
    return np.asarray(agreement / ((1.0 + np.exp(-log_odds)) * candidates), dtype=np.float32)
