"""Comparison of two nested models: likelihood ratio, information criterion and cross-validation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_distribution
from scipy.stats import norm, wilcoxon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.cross_validation import (
    balanced_folds,
    held_out_corners,
    held_out_residuals,
)
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, Solution, UndeterminedError, minimise
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate, residuals

FOLDS = 3
SUPPORTED_CHANCE = 1e-3
MIN_GAIN_SIGMAS = 2.0
"""Standard errors by which held-out frames must be predicted better."""


@dataclass(frozen=True)
class ModelComparison:
    """A fitted model, compared with the model nested in it.

    Attributes
    ----------
    name
        Level of the model, as `joint+bend`.
    against
        Level of the nested model; None for the smallest model.
    parameters
        Number of free parameters besides the board's poses; of those that single frames have under a prior, as many as
        the corners determine.
    rms_px
        Root mean square residual per axis over the inliers.
    sigma_px
        Standard deviation of a residual of a typical corner, which accounts for the number of unknowns.
    drop
        Decrease of the sum of squared standardised residuals of the same corners, in units of their variance.
    chance
        Probability of such a decrease by noise alone (F test of the likelihood ratio).
    information_gain
        Decrease of the Bayesian information criterion.
    held_out_rms_px
        Root mean square residual of frames that a fit without them predicts.
    held_out_gain
        Significance of its improvement over frames, in standard deviations of a normal distribution. Both are NaN where
        they were not computed: the likelihood rejects the model already, or another addition gains more.
    supported
        Whether the data support the model over the nested one.
    """

    name: str
    against: str | None
    parameters: int
    rms_px: float
    sigma_px: float
    drop: float
    chance: float
    information_gain: float
    held_out_rms_px: float
    held_out_gain: float
    supported: bool


def smallest(fitted: Fitted) -> ModelComparison:
    """The entry of the smallest model, which is compared with none."""
    solution = fitted.solution
    return ModelComparison(
        name=fitted.name,
        against=None,
        parameters=round(_parameters(solution)),
        rms_px=_rms(solution),
        sigma_px=solution.sigma_px,
        drop=np.nan,
        chance=np.nan,
        information_gain=np.nan,
        held_out_rms_px=np.nan,
        held_out_gain=np.nan,
        supported=True,
    )


def _parameters(solution: Solution) -> float:
    return len(solution.parameters) + solution.frame_terms


def _rms(solution: Solution) -> float:
    return float(np.sqrt(np.mean(solution.residuals[solution.inliers] ** 2)))


def compare(larger: Fitted, smaller: Fitted, observations: Observations) -> ModelComparison:
    """Compare a model with the one nested in it, by likelihood and by cross-validation."""
    return cross_validated(compare_likelihood(larger, smaller, observations), larger, smaller, observations)


def compare_likelihood(larger: Fitted, smaller: Fitted, observations: Observations) -> ModelComparison:
    """Compare two nested models by likelihood, on the inliers of the larger one.

    Priors count as likelihood: numbers that they hold neither cost nor gain anything.
    """
    rows = larger.solution.inliers
    seen = observations.where(rows)
    # Simulated corners without noise would turn rounding errors into significance.
    floor = 2.0 * float(np.sum((NEGLIGIBLE_PX / seen.sigma_px) ** 2))
    squares = float(np.sum(larger.solution.standardised[rows] ** 2)) + floor
    squares += larger.model.prior_squares(larger.solution.estimate)
    at_smaller = _at_minimum(smaller, observations, rows)
    left = seen.standardised(residuals(at_smaller, seen, smaller.model.board))
    squares_smaller = float(np.sum(left**2)) + floor + smaller.model.prior_squares(at_smaller)
    added = max(_parameters(larger.solution) - _parameters(smaller.solution), 1.0)
    spare = 2 * len(seen) - _parameters(larger.solution) - 6 * len(at_smaller.rig_from_board)
    drop = max(squares_smaller - squares, 0.0) / (squares / spare)
    return replace(
        smallest(larger),
        against=smaller.name,
        drop=drop,
        chance=float(f_distribution.sf(drop / added, added, spare)),
        information_gain=2 * len(seen) * float(np.log(squares_smaller / squares))
        - added * float(np.log(2 * len(seen))),
        supported=False,
    )


def _at_minimum(fitted: Fitted, observations: Observations, rows: BoolArray) -> Estimate:
    """The estimate of a model at the minimum over other rows than its own inliers."""
    if np.array_equal(rows, fitted.solution.inliers):
        return fitted.solution.estimate
    return minimise(fitted.solution.estimate, observations.where(rows), fitted.model)[0]


def cross_validated(
    comparison: ModelComparison, larger: Fitted, smaller: Fitted, observations: Observations
) -> ModelComparison:
    """Complete a comparison by cross-validation over frames, unless the likelihood rejects the larger model.

    The gain is the significance of the gains of frames, which are independent where corners of one frame may not be. A
    model is not supported where there are too few frames to hold any out.
    """
    seen = observations.where(larger.solution.inliers)
    enough = len(np.unique(seen.frame)) >= FOLDS
    if not (comparison.chance < SUPPORTED_CHANCE and comparison.information_gain > 0.0 and enough):
        return comparison
    fold = balanced_folds(smaller.solution.estimate, seen, smaller.model.board, FOLDS)
    # What a frame has of its own would also fit the errors of a frame that is left out: its corners predict each other.
    across = larger.model.frame_terms != smaller.model.frame_terms
    predict = held_out_corners if across else held_out_residuals
    squares, rms_px = [], []
    for fitted in (larger, smaller):
        try:
            left = predict(fitted.solution.estimate, seen, fitted.model, fold)
        except UndeterminedError:
            return comparison
        squares.append(np.bincount(seen.frame, weights=np.sum(seen.standardised(left) ** 2, axis=1)))
        rms_px.append(float(np.sqrt(np.mean(left**2))))
    gain = gain_sigmas(np.asarray(squares[1] - squares[0], dtype=np.float64))
    return replace(
        comparison,
        held_out_rms_px=rms_px[0],
        held_out_gain=gain,
        supported=gain > MIN_GAIN_SIGMAS,
    )


def gain_sigmas(gains: FloatArray) -> float:
    """How significant the gains (f,) of frames are, in standard deviations of a normal distribution.

    The larger of two figures: the mean in its standard errors, and Wilcoxon's signed-rank test, which sees that nearly
    all frames gain where a few, at the border of a wrong lens, gain far more than the others.
    """
    error = float(np.std(gains, ddof=1)) * float(np.sqrt(len(gains)))
    if error == 0.0 or gains.sum() <= 0.0:
        return min(float(gains.sum()) / error, 0.0) if error > 0.0 else 0.0
    ranks = float(norm.isf(max(wilcoxon(gains, alternative="greater").pvalue, 1e-300)))
    return max(float(gains.sum()) / error, ranks)
