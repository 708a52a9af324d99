"""Noise of corners: per view, from the scatter about a smooth field of residuals, and its correlation within frames.

The fit of a corner gives its standard deviation from the noise of the pixels around it. It misses errors common to
these pixels: motion blur, resampling, compression, edges along the sensor's rows. These differ severalfold between the
views of a frame, and appear as scatter of a view's corners. Errors of the model do not: they are smooth over a view and
are subtracted.

The remaining scatter has longer tails than a normal distribution: dust, glare, a corner near an edge. It is modelled by
Student's t distribution with degrees of freedom estimated from the corners, and each corner gets its maximum-likelihood
variance (Lange, Little and Taylor 1989, "Robust statistical modeling using the t distribution").

A ghost image, an asymmetric blur, a lens whose focus drifts, or a board that sags differently each time causes similar
errors in many corners, which then carry less information than their number suggests. The scores of entire frames reveal
this (Liang and Zeger 1986, "Longitudinal data analysis using generalized linear models").
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

MIN_CORNERS_BY_DEGREE = ((3, 40), (2, 16), (1, 8))
"""Degrees of the smooth field, each with the minimum number of a view's corners; with fewer, it is constant."""
CLIP_SIGMAS = 2.5  # larger residuals are outliers and are clipped to this
CLIPPED_VARIANCE = float(chi2.cdf(CLIP_SIGMAS**2, 3) + CLIP_SIGMAS**2 * chi2.sf(CLIP_SIGMAS**2, 1))
"""Mean of min(x^2, CLIP_SIGMAS^2) for a normal variable x."""
PRIOR_DEGREES_OF_FREEDOM = 8.0
"""Degrees of freedom of the prior from all views: a view with few corners gets nearly the median variance."""
STEPS = 20
TAILS = (3.0, 5.0, 9.0, 17.0, 33.0, np.inf)
"""Trial degrees of freedom of the t distribution."""
SIGNIFICANT_CHANCE = 1e-3


def with_view_noise(observations: Observations, residuals_px: FloatArray) -> Observations:
    """Scale the standard deviations of observations, view by view, to the scatter of their corners.

    The variance of a view is estimated about a polynomial field, and shrunk towards the median of all views according
    to its degrees of freedom (posterior mean under a scaled inverse chi-squared prior). Corners in the tails get larger
    standard deviations according to their own deviation, up to `FIND_SIGMAS`; beyond it, they do not, so that a fit can
    reject them as outliers.

    Parameters
    ----------
    observations
        Corners (n), with standard deviations up to a factor for each view.
    residuals_px
        Residuals (n, 2) of any fit whose errors are smooth over a view.
    """
    if not len(observations):
        return observations
    _, group = np.unique(np.stack([observations.frame, observations.view]), axis=1, return_inverse=True)
    masks = [group == number for number in range(int(group.max()) + 1)]
    scatters = [_scatter(observations.where(mask), residuals_px[mask]) for mask in masks]
    variance, freedom = np.array([[scatter.variance, scatter.freedom] for scatter in scatters]).T
    if not (freedom > 0.0).any():
        return observations
    typical = max(float(np.median(variance[freedom > 0.0])), NEGLIGIBLE_PX**2)
    shrunk = (freedom * variance + PRIOR_DEGREES_OF_FREEDOM * typical) / (freedom + PRIOR_DEGREES_OF_FREEDOM)
    sigma_px = observations.sigma_px * np.sqrt(shrunk)[group]
    scatter_px = np.empty_like(residuals_px)
    for mask, scatter in zip(masks, scatters, strict=True):
        scatter_px[mask] = scatter.scatter_px * np.sqrt(2.0 * mask.sum() / max(scatter.freedom, 1.0))
    sigma_px *= _tail_factors(scatter_px / sigma_px[:, None])
    return replace(observations, sigma_px=np.maximum(sigma_px, NEGLIGIBLE_PX))


def _tail_factors(standardised: FloatArray) -> FloatArray:
    """Factors (n,) on the standard deviations of residuals (n, 2), from the most likely t distribution."""
    inner = np.abs(standardised).max(axis=1) <= FIND_SIGMAS
    squared = np.sum(standardised[inner] ** 2, axis=1)
    factors = np.ones(len(standardised))
    if len(squared):
        fits = [_t_distribution(squared, freedom) for freedom in TAILS]
        factors[inner] = max(fits, key=lambda fit: fit[0])[1]
    return factors


def _t_distribution(squared: FloatArray, freedom: float) -> tuple[float, FloatArray]:
    """Log likelihood of squared lengths (n,) of vectors under a scaled t distribution, and its factors (n,)."""
    scale2 = float(np.mean(squared)) / 2.0
    if np.isinf(freedom) or scale2 == 0.0:
        return -len(squared) * (float(np.log(max(scale2, 1e-300))) + 1.0), np.full(len(squared), np.sqrt(scale2))
    for _ in range(STEPS):
        variance = (freedom + squared / scale2) / (freedom + 2.0)
        scale2 = float(np.mean(squared / variance)) / 2.0
    # The density of a vector of squared length s is (1 + s / (f scale2))^(-f / 2 - 1) / (2 pi scale2).
    likelihood = -np.sum(np.log(scale2) + (freedom / 2.0 + 1.0) * np.log1p(squared / (freedom * scale2)))
    return float(likelihood), np.sqrt(scale2 * (freedom + squared / scale2) / (freedom + 2.0))


@dataclass(frozen=True)
class _Scatter:
    """Residuals (n, 2) of a view minus a smooth field, their standardised variance, and degrees of freedom."""

    scatter_px: FloatArray
    variance: float
    freedom: float


def _scatter(view: Observations, residuals_px: FloatArray) -> _Scatter:
    """Estimate the scatter of a view's residuals (n, 2) about a smooth field.

    Uses Huber's proposal 2: squares are clipped at a limit that is proportional to the estimated scale.
    """
    terms = _terms(view.pixels)
    freedom = 2.0 * (len(view) - terms.shape[1])
    if freedom <= 0.0:
        return _Scatter(np.zeros_like(residuals_px), 0.0, 0.0)
    weights = 1.0 / view.sigma_px[:, None]
    standardised = residuals_px * weights
    scale, root_weights = np.inf, np.ones((len(view), 1))
    for _ in range(STEPS):
        basis, _ = np.linalg.qr(terms * weights * root_weights)
        residuals = standardised - (basis @ (basis.T @ (standardised * root_weights))) / root_weights
        squared = np.minimum(residuals**2, (CLIP_SIGMAS * scale) ** 2)
        expected_square = CLIPPED_VARIANCE if np.isfinite(scale) else 1.0
        previous, scale = scale, float(np.sqrt(squared.sum() / (expected_square * freedom)))
        if scale == 0.0 or abs(scale - previous) < 1e-3 * scale:
            break
        size = np.abs(residuals).max(axis=1, keepdims=True)
        root_weights = np.sqrt(CLIP_SIGMAS * scale / np.maximum(size, CLIP_SIGMAS * scale))
    return _Scatter(residuals / weights, scale**2, freedom)


def _terms(pixels: FloatArray) -> FloatArray:
    """Monomials (n, k) of pixels (n, 2), up to a degree that depends on their number."""
    degree = next((degree for degree, corners in MIN_CORNERS_BY_DEGREE if len(pixels) >= corners), 0)
    centred = pixels - pixels.mean(axis=0)
    x, y = (centred / max(float(np.abs(centred).max()), 1e-9)).T
    return np.stack([x ** (total - power) * y**power for total in range(degree + 1) for power in range(total + 1)], 1)


@dataclass(frozen=True)
class CorrelatedErrors:
    """Spread of the parameters relative to independent errors.

    Errors common to all frames do not affect it.

    Attributes
    ----------
    ratio
        Rms in sigmas; 1 on average for independent errors.
    chance
        Probability of a larger ratio for independent errors.
    """

    ratio: float
    chance: float

    @property
    def inflation(self) -> float:
        """Factor by which standard deviations are too small: the ratio if significant, else 1."""
        return max(self.ratio, 1.0) if self.chance < SIGNIFICANT_CHANCE else 1.0


def correlated_errors(solution: Solution, observations: Observations, model: Model) -> CorrelatedErrors:
    """Compare the scores of entire frames with their expectation for independent errors of the inliers.

    Residuals r and their derivatives are standardised. G holds the derivatives with respect to the free global
    parameters, after projecting out the pose and other parameters of the frame; N_f = G_f^T G_f, and N is the sum of
    all N_f and of the lens's priors. At the minimum, independent errors give the scores s_f = G_f^T r_f the covariance
    scale^2 (N_f - N_f N^-1 N_f). In coordinates with N = 1, sum |s_f|^2 / scale^2 thus has the mean sum tr N_f - sum tr
    N_f^2 (the first sum is g without priors) and the variance 2 (sum tr (N_f^2 - 2 N_f^3) + tr (sum N_f^2)^2). Its
    distribution is approximated by a scaled chi-squared distribution.
    """
    if solution.sigma_px < NEGLIGIBLE_PX:
        return CorrelatedErrors(1.0, 1.0)
    rows = observations.where(solution.inliers)
    mirrors = len(solution.estimate.virtual_centres_in_rig_mm)
    names = global_names(solution.estimate.camera.intrinsic_names, mirrors, len(model.board.modes))
    columns = [names.index(name) for name in solution.parameters]
    r, d_global, d_frame = (
        array / rows.sigma_px.reshape(-1, *[1] * (array.ndim - 1))
        for array in residuals_with_jacobians(solution.estimate, rows, model.board)
    )
    terms = model.frame_terms
    priors, values = np.diag(terms.weights), terms.values(solution.estimate)
    scores, squares = [], []
    for frame in np.unique(rows.frame):
        in_frame = rows.frame == frame
        # Priors are separate rows, which the global parameters do not affect.
        d_own = np.concatenate([d_frame[in_frame][:, :, terms.free].reshape(-1, len(priors)), priors])
        d_globals = d_global[in_frame][:, :, columns].reshape(-1, len(columns))
        d_globals = np.concatenate([d_globals, np.zeros((len(priors), len(columns)))])
        projected = d_globals - d_own @ np.linalg.lstsq(d_own, d_globals, rcond=None)[0]
        scores.append(projected.T @ np.concatenate([r[in_frame].ravel(), values[frame]]))
        squares.append(projected.T @ projected)
    information, lens = np.sum(squares, axis=0), np.zeros(len(columns))
    lens[: len(model.intrinsics)] = model.intrinsic_priors(solution.estimate.camera)
    information += np.diag(lens**2)
    scale = 1.0 / np.sqrt(np.diag(information))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    # A direction that only a prior determines, such as the common rotation of two mirrors, has no score.
    determined = values > len(values) * np.finfo(float).eps * values[-1]
    white = scale[:, None] * vectors[:, determined] / np.sqrt(values[determined])
    squared = float(np.sum((np.array(scores) @ white) ** 2)) / solution.scale**2
    n = white.T @ np.array(squares) @ white
    n2 = n @ n
    mean = white.shape[1] - float(np.sum((lens[:, None] * white) ** 2)) - float(np.trace(n2.sum(axis=0)))
    variance = float(np.trace(n2.sum(axis=0) - 2.0 * np.sum(n2 @ n, axis=0))) + float(np.sum(n2.sum(axis=0) ** 2))
    if mean <= 1e-6 * len(columns):  # one frame, whose score is zero at the minimum
        return CorrelatedErrors(1.0, 1.0)
    degrees_of_freedom = mean**2 / variance
    return CorrelatedErrors(
        float(np.sqrt(squared / mean)), float(chi2.sf(squared / mean * degrees_of_freedom, degrees_of_freedom))
    )
