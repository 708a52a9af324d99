"""Correlation of corner errors within a frame, which least squares assumes to be absent.

A ghost image, an asymmetric blur, a lens whose focus drifts, or a board that sags differently each time puts similar
errors on many corners, which then carry less information than their number suggests. The scores of whole frames show
it (Liang and Zeger 1986, "Longitudinal data analysis using generalized linear models").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import global_names, residuals_with_jacobians

SIGNIFICANT_CHANCE = 1e-3


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
