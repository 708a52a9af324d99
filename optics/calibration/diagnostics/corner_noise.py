"""Noise of corners: by view, from its scatter about a smooth field of residuals, and its correlation within a frame.

The fit of a corner gives its standard deviation by the noise of the pixels around it, but not by errors that these
share: blur by motion, resampling, compression, edges that lie along the rows of the sensor. These differ severalfold
between the views of one frame, and show as scatter of its corners. A wrong model does not: its residuals are smooth
over a view, and are subtracted.

The remaining scatter has longer tails than a normal distribution: dust, glare, a corner near an edge. It is modelled by
Student's t distribution, whose degrees of freedom are estimated from the corners, and each corner's variance is its
estimate of maximum likelihood (Lange, Little and Taylor 1989, "Robust statistical modeling using the t distribution").

A ghost image, an asymmetric blur, a lens whose focus drifts, or a board that sags differently each time puts similar
errors on many corners, which then carry less information than their number suggests. The scores of whole frames show it
(Liang and Zeger 1986, "Longitudinal data analysis using generalized linear models").
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.solver.levenberg_marquardt import FIND_SIGMAS, Solution
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import global_names, residuals_with_jacobians

CORNERS_OF_DEGREE = ((3, 40), (2, 16), (1, 8))
"""Degree of the smooth field, by the number of a view's corners; with fewer than the last, it is constant."""
REACH_SIGMAS = 2.5  # residuals beyond count as this many: outliers
CLIPPED_VARIANCE = float(chi2.cdf(REACH_SIGMAS**2, 3) + REACH_SIGMAS**2 * chi2.sf(REACH_SIGMAS**2, 1))
"""Mean of min(x^2, REACH_SIGMAS^2) for a normal variable x."""
PRIOR_FREEDOM = 8.0
"""Degrees of freedom of the prior that all views give for each: a view of few corners is near the others."""
STEPS = 20
TAILS = (3.0, 5.0, 9.0, 17.0, 33.0, np.inf)
"""Degrees of freedom of the t distributions that are tried."""
SIGNIFICANT_CHANCE = 1e-3


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


@dataclass(frozen=True)
class CorrelatedErrors:
    """Spread of the parameters relative to that of independent errors.

    Errors that are the same in all frames do not show in it.

    Attributes
    ----------
    ratio
        Root mean square in sigmas; 1 on average where errors are independent.
    chance
        Probability of a larger ratio where they are independent.
    """

    ratio: float
    chance: float

    @property
    def widening(self) -> float:
        """Factor by which standard deviations are too small: the ratio, where it is significant."""
        return max(self.ratio, 1.0) if self.chance < SIGNIFICANT_CHANCE else 1.0


def correlated_errors(solution: Solution, observations: Observations, model: Model) -> CorrelatedErrors:
    """Compare the scores of whole frames with those that independent errors of the inliers would have.

    Residuals r and their derivatives are standardised. Let G be the derivatives by the free globals, less what the
    frame's pose and other own numbers explain of them, N_f = G_f^T G_f, and N the sum of N_f and of the priors of the
    lens. At the minimum, independent errors give the scores s_f = G_f^T r_f the covariance
    scale^2 (N_f - N_f N^-1 N_f), so that, in coordinates where N = 1, sum |s_f|^2 / scale^2 has the mean
    sum tr N_f - sum tr N_f^2, whose first sum is g without priors, and the variance
    2 (sum tr (N_f^2 - 2 N_f^3) + tr (sum N_f^2)^2). Its distribution is approximated by a scaled chi squared
    distribution.
    """
    if solution.sigma_px < NEGLIGIBLE_PX:
        return CorrelatedErrors(1.0, 1.0)
    rows = observations.where(solution.inliers)
    mirrors = len(solution.estimate.virtual_centres_in_rig_mm)
    names = global_names(solution.estimate.camera.intrinsic_names, mirrors, len(model.board.modes))
    places = [names.index(name) for name in solution.parameters]
    r, by_global, by_frame = (
        found / rows.sigma_px.reshape(-1, *[1] * (found.ndim - 1))
        for found in residuals_with_jacobians(solution.estimate, rows, model.board)
    )
    terms = model.frame_terms
    priors, values = np.diag(terms.weights), terms.values(solution.estimate)
    scores, squares = [], []
    for frame in np.unique(rows.frame):
        of = rows.frame == frame
        # Priors are rows of their own, on which the globals have no effect.
        own = np.concatenate([by_frame[of][:, :, terms.free].reshape(-1, len(priors)), priors])
        globals_ = by_global[of][:, :, places].reshape(-1, len(places))
        globals_ = np.concatenate([globals_, np.zeros((len(priors), len(places)))])
        left = globals_ - own @ np.linalg.lstsq(own, globals_, rcond=None)[0]
        scores.append(left.T @ np.concatenate([r[of].ravel(), values[frame]]))
        squares.append(left.T @ left)
    every, lens = np.sum(squares, axis=0), np.zeros(len(places))
    lens[: len(model.intrinsics)] = model.intrinsic_priors(solution.estimate.camera)
    every += np.diag(lens**2)
    scale = 1.0 / np.sqrt(np.diag(every))
    values, vectors = np.linalg.eigh(every * np.outer(scale, scale))
    # A direction that only a prior determines, such as the common rotation of two mirrors, has no score.
    determined = values > len(values) * np.finfo(float).eps * values[-1]
    white = scale[:, None] * vectors[:, determined] / np.sqrt(values[determined])
    squared = float(np.sum((np.array(scores) @ white) ** 2)) / solution.scale**2
    n = white.T @ np.array(squares) @ white
    n2 = n @ n
    mean = white.shape[1] - float(np.sum((lens[:, None] * white) ** 2)) - float(np.trace(n2.sum(axis=0)))
    spread = float(np.trace(n2.sum(axis=0) - 2.0 * np.sum(n2 @ n, axis=0))) + float(np.sum(n2.sum(axis=0) ** 2))
    if mean <= 1e-6 * len(places):  # one frame, whose score is zero at the minimum
        return CorrelatedErrors(1.0, 1.0)
    freedom = mean**2 / spread
    return CorrelatedErrors(float(np.sqrt(squared / mean)), float(chi2.sf(squared / mean * freedom, freedom)))
