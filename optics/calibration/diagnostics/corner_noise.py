"""Noise of corners by view, from how they scatter about a smooth field of residuals, whatever the model explains.

A corner's own fit tells its standard deviation as far as the noise of the pixels around it goes. What those share, it
does not tell: blur by motion, resampling, compression, edges that lie along the rows of the sensor. That differs
severalfold between the views of one frame, and shows as scatter of its corners. A wrong model does not: what it leaves
is smooth over a view, and is subtracted.

What is left has longer tails than a normal distribution: dust, glare, a corner near an edge. It is taken for Student's
t distribution, whose degrees of freedom the corners tell, and each corner's variance is that which maximum likelihood
gives it (Lange, Little and Taylor 1989, "Robust statistical modeling using the t distribution").
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.solver.levenberg_marquardt import FIND_SIGMAS
from mirrorcam.optics.calibration.solver.observations import Observations

CORNERS_OF_DEGREE = ((3, 40), (2, 16), (1, 8))
"""Degree of the smooth field, by the number of a view's corners; with fewer than the last, it is constant."""
REACH_SIGMAS = 2.5  # residuals beyond count as this many: outliers
CLIPPED_VARIANCE = float(chi2.cdf(REACH_SIGMAS**2, 3) + REACH_SIGMAS**2 * chi2.sf(REACH_SIGMAS**2, 1))
"""Mean of min(x^2, REACH_SIGMAS^2) for a normal variable x."""
PRIOR_FREEDOM = 8.0
"""Degrees of freedom of what all views say about each: a view of few corners is near to the others."""
STEPS = 20
TAILS = (3.0, 5.0, 9.0, 17.0, 33.0, np.inf)
"""Degrees of freedom of the t distributions that are tried."""


def with_noise_of_views(observations: Observations, residuals_px: FloatArray) -> Observations:
    """Observations whose standard deviations are scaled, view by view, to how their corners scatter.

    The variance of a view is that of its corners about a polynomial field, drawn towards the median of all views in
    proportion to what few corners leave open (the mean of the posterior of a scaled inverse chi squared prior). Corners
    in the tails of the distribution are wider by what they are off; those off by more than `FIND_SIGMAS` are not, so
    that a fit finds them as outliers.

    Parameters
    ----------
    observations
        Corners (n), with standard deviations up to a factor for each view.
    residuals_px
        Their residuals (n, 2) to a fit of any model whose errors are smooth over a view.
    """
    if not len(observations):
        return observations
    _, group = np.unique(np.stack([observations.frame, observations.view]), axis=1, return_inverse=True)
    masks = [group == number for number in range(int(group.max()) + 1)]
    scattered = [_scatter(observations.where(mask), residuals_px[mask]) for mask in masks]
    variance, freedom = np.array([[each.variance, each.freedom] for each in scattered]).T
    if not (freedom > 0.0).any():
        return observations
    typical = max(float(np.median(variance[freedom > 0.0])), NEGLIGIBLE_PX**2)
    shrunk = (freedom * variance + PRIOR_FREEDOM * typical) / (freedom + PRIOR_FREEDOM)
    sigma_px = observations.sigma_px * np.sqrt(shrunk)[group]
    left_px = np.empty_like(residuals_px)
    for mask, each in zip(masks, scattered, strict=True):
        left_px[mask] = each.left_px * np.sqrt(2.0 * mask.sum() / max(each.freedom, 1.0))
    sigma_px *= _tails(left_px / sigma_px[:, None])
    return replace(observations, sigma_px=np.maximum(sigma_px, NEGLIGIBLE_PX))


def _tails(standardised: FloatArray) -> FloatArray:
    """Factors (n,) on the standard deviations of residuals (n, 2), by the t distribution that suits them best."""
    inner = np.abs(standardised).max(axis=1) <= FIND_SIGMAS
    squared = np.sum(standardised[inner] ** 2, axis=1)
    factors = np.ones(len(standardised))
    if len(squared):
        fits = [_t_distribution(squared, freedom) for freedom in TAILS]
        factors[inner] = max(fits, key=lambda fit: fit[0])[1]
    return factors


def _t_distribution(squared: FloatArray, freedom: float) -> tuple[float, FloatArray]:
    """Log likelihood of squared lengths (n,) of pairs under a t distribution of any scale, and factors (n,) by it."""
    scale2 = float(np.mean(squared)) / 2.0
    if np.isinf(freedom) or scale2 == 0.0:
        return -len(squared) * (float(np.log(max(scale2, 1e-300))) + 1.0), np.full(len(squared), np.sqrt(scale2))
    for _ in range(STEPS):
        variance = (freedom + squared / scale2) / (freedom + 2.0)
        scale2 = float(np.mean(squared / variance)) / 2.0
    # The density of a pair of squared length s is (1 + s / (f scale2))^(-f / 2 - 1) / (2 pi scale2).
    likelihood = -np.sum(np.log(scale2) + (freedom / 2.0 + 1.0) * np.log1p(squared / (freedom * scale2)))
    return float(likelihood), np.sqrt(scale2 * (freedom + squared / scale2) / (freedom + 2.0))


@dataclass(frozen=True)
class _Scatter:
    """What a smooth field leaves of a view's residuals (n, 2), the variance of it standardised, degrees of freedom."""

    left_px: FloatArray
    variance: float
    freedom: float


def _scatter(view: Observations, residuals_px: FloatArray) -> _Scatter:
    """Scatter of a view's residuals (n, 2) about a smooth field.

    Huber's second proposal: squares beyond the reach count as the reach, whose own scale is the result.
    """
    terms = _terms(view.pixels)
    freedom = 2.0 * (len(view) - terms.shape[1])
    if freedom <= 0.0:
        return _Scatter(np.zeros_like(residuals_px), 0.0, 0.0)
    weights = 1.0 / view.sigma_px[:, None]
    seen = residuals_px * weights
    scale, root = np.inf, np.ones((len(view), 1))
    for _ in range(STEPS):
        basis, _ = np.linalg.qr(terms * weights * root)
        left = seen - (basis @ (basis.T @ (seen * root))) / root
        squared = np.minimum(left**2, (REACH_SIGMAS * scale) ** 2)
        reached = CLIPPED_VARIANCE if np.isfinite(scale) else 1.0
        previous, scale = scale, float(np.sqrt(squared.sum() / (reached * freedom)))
        if scale == 0.0 or abs(scale - previous) < 1e-3 * scale:
            break
        size = np.abs(left).max(axis=1, keepdims=True)
        root = np.sqrt(REACH_SIGMAS * scale / np.maximum(size, REACH_SIGMAS * scale))
    return _Scatter(left / weights, scale**2, freedom)


def _terms(pixels: FloatArray) -> FloatArray:
    """Powers (n, k) of pixels (n, 2), of a degree that their number determines."""
    degree = next((degree for degree, corners in CORNERS_OF_DEGREE if len(pixels) >= corners), 0)
    centred = pixels - pixels.mean(axis=0)
    x, y = (centred / max(float(np.abs(centred).max()), 1e-9)).T
    return np.stack([x ** (total - power) * y**power for total in range(degree + 1) for power in range(total + 1)], 1)
