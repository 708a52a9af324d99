"""How sure depth is: a standard deviation, and the probability of being right.

The forms follow from what is measured: the error of a surface that is smoothed at inverse variance SMOOTH grows with
about a root of noise over information, and the odds of being right fall with the number of other places that are about
as cheap. Their constants were fitted to public scenes with true depth, by quantile and by logistic regression;
`python -m benchmarks.light_field_depth scenes` prints how true they are.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.depth.refine import Match, jumps, unshared

Float32 = NDArray[np.float32]

AVERAGED_PX = 7
SIGMA_PX = 0.043
"""Standard deviation, px of the farthest view's motion, at INFORMATION and at margins of SURE_MARGIN and more."""
INFORMATION = 50.0
ROOT, MARGIN_ROOT, ROUGH_POWER = 0.18, 0.14, 7
LEAST_NOISE, LEAST_INFORMATION = 0.3, 0.5
SURE_MARGIN, LEAST_MARGIN = 12.0, 0.1
LEAST_SMOOTH = 0.5
HALVED = 1.7
"""Factor of a search at half size."""
RIGHT_PX = 0.5
"""The probability is that of an error below that, px of the farthest view's motion."""
DOUBTFUL_MARGIN = 9.0
"""Margin from which on another place is no rival, in the unit of the penalties of eight views."""
AT_EDGE, NEAR_EDGE, ELSEWHERE = 1.27, 1.59, 1.65
"""Logarithm of the odds of being right at a depth edge, within NEAR_EDGE_PX, and elsewhere."""
NEAR_EDGE_PX = 3
RIVALS, FEWEST_RIVALS, SMOOTH, HALVED_ODDS = -0.81, 0.02, 1.2, -1.33
"""What the logarithm of the number of rivals, smoothness, and a search at half size add to it."""

CORRELATED_PX = 41
UNRELATED, RELATED = 0.04, 0.16
"""Correlation of slopes up to which views show different things, and from which on they show the same."""
LEAST_ENERGY = 1e-3
USUAL_RIVALS = 2.0
"""Number of rivals that a first search leaves since it does not separate places near each other."""


def _mean(values: Float32) -> Any:
    return cv2.blur(values, (AVERAGED_PX, AVERAGED_PX))


def standard_deviation_px(
    match: Match, smooth: Float32, margin: Float32, views: int, halved: bool, range_px: float
) -> Float32:
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
    halved
        Whether planes were searched at half size.
    range_px
        Motion of the farthest view between the nearest and the farthest plane.
    """
    weight = np.maximum(match.agreeing, np.float32(1e-3))
    noise = np.maximum(_mean(match.residual * weight) / _mean(weight) / 2.0, LEAST_NOISE)
    information = np.maximum(_mean(match.information) * unshared(views), LEAST_INFORMATION)
    least: Any = cv2.erode(margin, np.ones((3, 3), np.uint8))
    unsure = (SURE_MARGIN / np.clip(least, LEAST_MARGIN, SURE_MARGIN)) ** MARGIN_ROOT
    rough = np.clip(_mean(smooth), LEAST_SMOOTH, 1.0) ** -ROUGH_POWER
    sigma = SIGMA_PX * np.power(noise / information * INFORMATION, ROOT) * unsure * rough * (HALVED if halved else 1.0)
    return np.minimum(sigma, range_px / np.sqrt(12.0)).astype(np.float32)


def probability(
    moved: Float32, match: Match, rivals: Float32, everywhere: Float32, smooth: Float32, halved: bool
) -> Float32:
    """Probability (v, u) that a depth map is right to RIGHT_PX.

    Parameters
    ----------
    moved
        Places (v, u), px of the farthest view's motion: at edges, pixels are of two surfaces.
    match
        The match of the views there: where, over CORRELATED_PX, their slopes of brightness are not correlated with
        those of the reference view, no depth of the range is right.
    rivals
        Number (v, u) of other places that are about as cheap, of those searched last.
    everywhere
        The same of all places, by the first search: many where nothing is determined; one of all these is right then.
    smooth
        Weight (v, u), 0 to 1, of the surface's being smooth.
    halved
        Whether planes were searched at half size.
    """
    away: Any = cv2.distanceTransform((~jumps(moved)).astype(np.uint8), cv2.DIST_L2, 3)
    odds = np.where(away < 1, AT_EDGE, np.where(away < NEAR_EDGE_PX, NEAR_EDGE, ELSEWHERE)) + SMOOTH * smooth
    odds += RIVALS * np.log(rivals + FEWEST_RIVALS) + (HALVED_ODDS if halved else 0.0)
    energies = cv2.blur(match.energies, (CORRELATED_PX, CORRELATED_PX))
    correlation = cv2.blur(match.products, (CORRELATED_PX, CORRELATED_PX)) / np.maximum(energies, LEAST_ENERGY)
    # Where there is no texture at all, rivals show that.
    alike = np.where(energies > LEAST_ENERGY, correlation, 1.0)
    shown = np.clip((alike - UNRELATED) / (RELATED - UNRELATED), 0.0, 1.0)
    shared = 1.0 + np.maximum(everywhere - USUAL_RIVALS, 0.0)
    return np.asarray(shown / ((1.0 + np.exp(-odds)) * shared), dtype=np.float32)
