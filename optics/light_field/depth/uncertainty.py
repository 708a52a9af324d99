"""Standard deviation of depth.

The form follows from measurement: the error of a smoothed surface grows with a power of noise over information. The
constants were fitted to public scenes with true depth by quantile regression; `python -m benchmarks.light_field_depth
scenes` prints how well they hold.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.refine import Match, information_fraction

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
NOISE_PX, NOISE_RATIO_LIMIT = 0.08, 5.0
"""Standard deviation, px, that noise adds per unit of the noise ratio while that is small, and the ratio at half of it.

Noise that neighbouring pixels share does not show in the residuals of a smoothed picture."""
COVERED = 0.683
"""Probability that one standard deviation covers; wrong depths that are less likely than the rest do not widen it."""
DOUBTFUL_MARGIN = 9.0
"""Margin above which another candidate is not a rival, as a matching cost of eight views."""


def _mean(values: Float32) -> Any:
    return cv2.blur(values, (AVERAGE_PX, AVERAGE_PX))


def standard_deviation_px(
    match: Match,
    smoothness: Float32,
    margin: Float32,
    right: Float32,
    *,
    views: int,
    halved: bool,
    range_px: float,
    noise_ratio: float,
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
    noise_ratio
        Noise of the views relative to their texture, see `ViewComparison.noise_ratio`.
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
    by_noise = np.float32(NOISE_PX * noise_ratio / (1.0 + noise_ratio / NOISE_RATIO_LIMIT))
    covered = np.maximum(COVERED - right, 0.0) / np.maximum(1.0 - right, 1.0 - COVERED) / COVERED
    uniform = range_px / np.sqrt(12.0)
    return np.minimum(np.hypot(np.hypot(narrow, by_noise), covered * uniform), uniform).astype(np.float32)
