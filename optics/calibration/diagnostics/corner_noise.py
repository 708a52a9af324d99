"""Noise of corners by view, from how they scatter about a smooth field of residuals, whatever the model explains.

A corner's own fit tells its standard deviation as far as the noise of the pixels around it goes. What those share, it
does not tell: blur by motion, resampling, compression, edges that lie along the rows of the sensor. That differs
severalfold between the views of one frame, and shows as scatter of its corners. A wrong model does not: what it leaves
is smooth over a view, and is subtracted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.solver.observations import Observations

CORNERS_OF_DEGREE = ((3, 40), (2, 16), (1, 8))
"""Degree of the smooth field, by the number of a view's corners; with fewer than the last, it is constant."""
REACH_SIGMAS = 2.5  # residuals beyond count as this many: outliers
CLIPPED_VARIANCE = float(chi2.cdf(REACH_SIGMAS**2, 3) + REACH_SIGMAS**2 * chi2.sf(REACH_SIGMAS**2, 1))
"""Mean of min(x^2, REACH_SIGMAS^2) for a normal variable x."""
PRIOR_FREEDOM = 8.0
"""Degrees of freedom of what all views say about each: a view of few corners is near to the others."""
STEPS = 20


def with_noise_of_views(observations: Observations, residuals_px: FloatArray) -> Observations:
    """Observations whose standard deviations are scaled, view by view, to how their corners scatter.

    The variance of a view is that of its corners about a polynomial field, drawn towards the median of all views in
    proportion to what few corners leave open (the mean of the posterior of a scaled inverse chi squared prior).

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
    variance, freedom = np.array([_variance(observations.where(mask), residuals_px[mask]) for mask in masks]).T
    if not (freedom > 0.0).any():
        return observations
    typical = float(np.median(variance[freedom > 0.0]))
    shrunk = (freedom * variance + PRIOR_FREEDOM * typical) / (freedom + PRIOR_FREEDOM)
    sigma_px = observations.sigma_px * np.sqrt(shrunk)[group]
    return replace(observations, sigma_px=np.maximum(sigma_px, NEGLIGIBLE_PX))


def _variance(view: Observations, residuals_px: FloatArray) -> tuple[float, float]:
    """Variance of a view's standardised residuals (n, 2) about a smooth field, and its degrees of freedom.

    Huber's second proposal: squares beyond the reach count as the reach, whose own scale is the result.
    """
    terms = _terms(view.pixels)
    freedom = 2.0 * (len(view) - terms.shape[1])
    if freedom <= 0.0:
        return 0.0, 0.0
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
    return scale**2, freedom


def _terms(pixels: FloatArray) -> FloatArray:
    """Powers (n, k) of pixels (n, 2), of a degree that so many corners determine."""
    degree = next((degree for degree, corners in CORNERS_OF_DEGREE if len(pixels) >= corners), 0)
    centred = pixels - pixels.mean(axis=0)
    x, y = (centred / max(float(np.abs(centred).max()), 1e-9)).T
    return np.stack([x ** (total - power) * y**power for total in range(degree + 1) for power in range(total + 1)], 1)
