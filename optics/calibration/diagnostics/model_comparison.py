"""Comparison of two nested models: likelihood ratio, information criterion and cross-validation over frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_distribution
from scipy.stats import norm, wilcoxon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.solver.levenberg_marquardt import (
    BoolArray,
    Solution,
    UndeterminedError,
    fit,
    minimise,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals

FOLDS = 3
SUPPORTED_CHANCE = 1e-3
MIN_GAIN_SIGMAS = 2.0
"""Standard errors by which the prediction of held-out frames must improve."""


@dataclass(frozen=True)
class ModelComparison:
    """A fitted model, compared with the model nested in it.

    Attributes
    ----------
    name
        Name of the model, such as `joint+bend`.
    against
        Name of the nested model; None for the smallest model.
    parameters
        Number of free parameters besides the board's poses. Parameters of single frames under a prior count as far as
        the corners determine them.
    rms_px
        Rms residual per axis over the inliers.
    sigma_px
        Standard deviation of a typical corner's residual, corrected for the number of unknowns.
    drop
        Decrease of the sum of squared standardised residuals of the same corners, in units of their variance.
    chance
        Probability of such a decrease by noise alone (F test of the likelihood ratio).
    information_gain
        Decrease of the Bayesian information criterion.
    held_out_rms_px
        Rms residual of frames predicted by a fit without them.
    held_out_gain
        Significance of its improvement over frames, in standard deviations of a normal distribution. Both are NaN if
        not computed: the likelihood already rejects the model, or another addition gains more.
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


def smallest_model(fitted: Fitted) -> ModelComparison:
    """Return the entry of the smallest model, which is compared with no other."""
    solution = fitted.solution
    return ModelComparison(
        name=fitted.name,
        against=None,
        parameters=round(_parameters(solution)),
        rms_px=float(np.sqrt(np.mean(solution.residuals[solution.inliers] ** 2))),
        sigma_px=solution.sigma_px,
        drop=np.nan,
        chance=np.nan,
        information_gain=np.nan,
        held_out_rms_px=np.nan,
        held_out_gain=np.nan,
        supported=True,
    )


def _parameters(solution: Solution) -> float:
    return len(solution.parameters) + solution.effective_frame_terms


def compare(larger: Fitted, smaller: Fitted, observations: Observations) -> ModelComparison:
    """Compare a model with the model nested in it, by likelihood and by cross-validation."""
    return cross_validated(compare_likelihood(larger, smaller, observations), larger, smaller, observations)


def compare_likelihood(larger: Fitted, smaller: Fitted, observations: Observations) -> ModelComparison:
    """Compare two nested models by likelihood, on the inliers of the larger one.

    Priors count as part of the likelihood, so parameters that they alone determine neither cost nor gain anything.
    """
    rows = larger.solution.inliers
    inliers = observations.where(rows)
    # Without noise, as in simulated corners, rounding errors would become significant.
    floor = 2.0 * float(np.sum((NEGLIGIBLE_PX / inliers.sigma_px) ** 2))
    squares = float(np.sum(larger.solution.standardised[rows] ** 2)) + floor
    squares += larger.model.prior_squares(larger.solution.estimate)
    at_smaller = _at_minimum(smaller, observations, rows)
    errors_smaller = inliers.standardised(residuals(at_smaller, inliers, smaller.model.board))
    squares_smaller = float(np.sum(errors_smaller**2)) + floor + smaller.model.prior_squares(at_smaller)
    extra_parameters = max(_parameters(larger.solution) - _parameters(smaller.solution), 1.0)
    degrees_of_freedom = 2 * len(inliers) - _parameters(larger.solution) - 6 * len(at_smaller.rig_from_board)
    drop = max(squares_smaller - squares, 0.0) / (squares / degrees_of_freedom)
    return replace(
        smallest_model(larger),
        against=smaller.name,
        drop=drop,
        chance=float(f_distribution.sf(drop / extra_parameters, extra_parameters, degrees_of_freedom)),
        information_gain=2 * len(inliers) * float(np.log(squares_smaller / squares))
        - extra_parameters * float(np.log(2 * len(inliers))),
        supported=False,
    )


def _at_minimum(fitted: Fitted, observations: Observations, rows: BoolArray) -> Estimate:
    """Return the estimate of a model that minimises the cost over the given rows."""
    if np.array_equal(rows, fitted.solution.inliers):
        return fitted.solution.estimate
    return minimise(fitted.solution.estimate, observations.where(rows), fitted.model)[0]


def cross_validated(
    comparison: ModelComparison, larger: Fitted, smaller: Fitted, observations: Observations
) -> ModelComparison:
    """Complete a comparison by cross-validation over frames, unless the likelihood rejects the larger model.

    The gain is the significance of the frames' gains, which are independent even if the corners of a frame are not. The
    model is not supported if there are too few frames to hold any out.
    """
    inlier_rows = observations.where(larger.solution.inliers)
    enough = len(np.unique(inlier_rows.frame)) >= FOLDS
    if not (comparison.chance < SUPPORTED_CHANCE and comparison.information_gain > 0.0 and enough):
        return comparison
    fold = balanced_folds(smaller.solution.estimate, inlier_rows, smaller.model.board, FOLDS)
    # A frame's own parameters could also fit the errors of a held-out frame, so its corners must predict each other.
    frame_terms_differ = larger.model.frame_terms != smaller.model.frame_terms
    predict = held_out_corners if frame_terms_differ else held_out_residuals
    squares, rms_px = [], []
    for fitted in (larger, smaller):
        try:
            errors = predict(fitted.solution.estimate, inlier_rows, fitted.model, fold)
        except UndeterminedError:
            return comparison
        squares.append(np.bincount(inlier_rows.frame, weights=np.sum(inlier_rows.standardised(errors) ** 2, axis=1)))
        rms_px.append(float(np.sqrt(np.mean(errors**2))))
    gain = gain_sigmas(np.asarray(squares[1] - squares[0], dtype=np.float64))
    return replace(
        comparison,
        held_out_rms_px=rms_px[0],
        held_out_gain=gain,
        supported=gain > MIN_GAIN_SIGMAS,
    )


def gain_sigmas(gains: FloatArray) -> float:
    """Return the significance of the gains (f,) of frames, in standard deviations of a normal distribution.

    It is the larger of two figures: the mean in standard errors, and Wilcoxon's signed-rank test, which detects whether
    nearly all frames gain even if a few, at the border of a wrong lens, gain far more than the others.
    """
    error = float(np.std(gains, ddof=1)) * float(np.sqrt(len(gains)))
    if error == 0.0 or gains.sum() <= 0.0:
        return min(float(gains.sum()) / error, 0.0) if error > 0.0 else 0.0
    ranks = float(norm.isf(max(wilcoxon(gains, alternative="greater").pvalue, 1e-300)))
    return max(float(gains.sum()) / error, ranks)


@dataclass(frozen=True)
class HeldOut:
    """Prediction of frames by a fit without them; only their board poses are fitted to them.

    Attributes
    ----------
    estimate
        The fit without the frames, with their poses (f, 4, 4).
    observations
        Corners (n) of the frames.
    residuals
        Predicted minus observed pixels (n, 2).
    inliers
        Mask (n,) of the inliers.
    board
        The board with its shape fitted without the frames.
    """

    estimate: Estimate
    observations: Observations
    residuals: FloatArray
    inliers: BoolArray
    board: Board

    @property
    def rms_px(self) -> FloatArray:
        """Rms residual (2,) per axis over the inliers."""
        return np.sqrt(np.mean(self.residuals[self.inliers] ** 2, axis=0))

    @property
    def rms_sigmas(self) -> float:
        """Rms residual of the inliers, in stated standard deviations of the corners."""
        return float(np.sqrt(np.mean(self.observations.standardised(self.residuals)[self.inliers] ** 2)))


def frames_of(observations: Observations, estimate: Estimate, frames: BoolArray) -> tuple[Observations, Estimate]:
    """Select rows and poses of some frames (f,), renumbered from 0."""
    number = np.cumsum(frames) - 1
    rows = observations.where(frames[observations.frame])
    return replace(rows, frame=number[rows.frame]), estimate.of_frames(frames)


def _frame_problem(fitted: Estimate, model: Model, held_out: Estimate) -> tuple[Estimate, Model]:
    """Return the global parameters of one estimate with the frames of another, and the model with only these free."""
    shaped = Board.rigid(model.board.shaped(fitted.shape))
    frames = replace(
        fitted,
        rig_from_board=held_out.rig_from_board,
        camera_rotation=held_out.camera_rotation,
        bow_mm=held_out.bow_mm,
        motion=held_out.motion,
        shape=np.zeros(0),
    )
    frames_model = Model(
        (), thickness=False, curvature=False, board=shaped, mirrors=False, frame_terms=model.frame_terms
    )
    return frames, frames_model


def predict_held_out(start: Estimate, observations: Observations, model: Model, is_held_out: BoolArray) -> HeldOut:
    """Predict the frames of the mask `is_held_out` (f,) by a robust fit without them."""
    training, training_start = frames_of(observations, start, ~is_held_out)
    fitted = fit(training_start, training, model).estimate
    held_out, held_out_start = frames_of(observations, start, is_held_out)
    start_of_frames, frames = _frame_problem(fitted, model, held_out_start)
    solution = fit(start_of_frames, held_out, frames)
    return HeldOut(solution.estimate, held_out, solution.residuals, solution.inliers, frames.board)


def held_out_residuals(start: Estimate, observations: Observations, model: Model, fold: IntArray) -> FloatArray:
    """Residuals (n, 2), px, of every frame predicted by a fit to the other folds; `fold` (f,) numbers the folds.

    All rows are used, so that models are compared on equal terms.
    """
    errors = np.empty((len(observations), 2))
    for is_held_out, start_of_frames, held_out, frames in _held_out_folds(start, observations, model, fold):
        fitted, _ = minimise(start_of_frames, held_out, frames)
        errors[is_held_out[observations.frame]] = residuals(fitted, held_out, frames.board)
    return errors


def held_out_corners(start: Estimate, observations: Observations, model: Model, fold: IntArray) -> FloatArray:
    """Residuals (n, 2), px, of every corner predicted by a fit to the other folds and half of its own frame's corners.

    A frame's own parameters are fitted to every other corner of each view, and predict the corners between them.
    """
    errors = np.empty((len(observations), 2))
    for is_held_out, start_of_frames, held_out, frames in _held_out_folds(start, observations, model, fold):
        in_fold = np.empty((len(held_out), 2))
        for half in (0, 1):
            hidden = held_out.corner % 2 == half
            fitted, _ = minimise(start_of_frames, held_out.where(~hidden), frames)
            in_fold[hidden] = residuals(fitted, held_out.where(hidden), frames.board)
        errors[is_held_out[observations.frame]] = in_fold
    return errors


def _held_out_folds(
    start: Estimate, observations: Observations, model: Model, fold: IntArray
) -> Iterator[tuple[BoolArray, Estimate, Observations, Model]]:
    """Yield for each fold the mask (f,) of its frames, a start fitted to the other folds, its rows, and its model."""
    for number in range(int(fold.max()) + 1):
        is_held_out = fold == number
        training, training_start = frames_of(observations, start, ~is_held_out)
        fitted, _ = minimise(training_start, training, model)
        held_out, held_out_start = frames_of(observations, start, is_held_out)
        start_of_frames, frames = _frame_problem(fitted, model, held_out_start)
        yield is_held_out, start_of_frames, held_out, frames


def is_mirrored(observations: Observations, frames: int) -> BoolArray:
    """Mask (f,) of the frames with a mirrored view; all frames of a bare camera, which has none."""
    mirrored = np.isin(np.arange(frames), observations.frame[observations.view != DIRECT])
    return mirrored if mirrored.any() else np.ones(frames, dtype=bool)


def balanced_folds(estimate: Estimate, observations: Observations, board: Board, parts: int) -> IntArray:
    """Assign each frame (f,) to one of `parts` folds so that every fold holds similar board poses.

    Frames with and without mirrors are assigned separately. Each kind is ordered along a path of similar poses and
    dealt to the folds back and forth, which balances changes along the path.
    """
    part = np.empty(len(estimate.rig_from_board), dtype=np.int64)
    mirrored = is_mirrored(observations, len(part))
    corners = board.corners_in_board_mm
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    poses = estimate.rig_from_board
    centroids = poses[:, :3, :3] @ corners.mean(axis=0) + poses[:, :3, 3]
    # A rotation by one radian counts as much as a shift by the board's size.
    features = np.concatenate([centroids, size * poses[:, :3, :3].reshape(-1, 9) / np.sqrt(2.0)], axis=1)
    back_and_forth = [*range(parts), *reversed(range(parts))]
    path = [frame for kind in (mirrored, ~mirrored) for frame in _path(features, np.flatnonzero(kind))]
    for position, frame in enumerate(path):
        part[frame] = back_and_forth[position % len(back_and_forth)]
    return part


def _path(points: FloatArray, members: IntArray) -> list[int]:
    """Order members along a greedy path, from the outermost member always to the nearest remaining one."""
    remaining = list(members)
    if not remaining:
        return []
    centre = points[members].mean(axis=0)
    path = [remaining.pop(int(np.argmax(np.linalg.norm(points[remaining] - centre, axis=1))))]
    while remaining:
        path.append(remaining.pop(int(np.argmin(np.linalg.norm(points[remaining] - points[path[-1]], axis=1)))))
    return [int(frame) for frame in path]


def split_by_distance(estimate: Estimate, observations: Observations, board: Board) -> IntArray:
    """Number mirrored frames by board distance, 0 below and 1 above the median; the other frames are balanced."""
    part = balanced_folds(estimate, observations, board, 2)
    mirrored = np.flatnonzero(is_mirrored(observations, len(part)))
    poses = estimate.rig_from_board[mirrored]
    centroids = poses[:, :3, :3] @ board.corners_in_board_mm.mean(axis=0) + poses[:, :3, 3]
    distances = np.linalg.norm(centroids, axis=1)
    order = np.argsort(distances, kind="stable")
    part[mirrored[order]] = np.arange(len(order)) >= len(order) // 2
    return part
