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


def smallest_model(fitted: Fitted) -> ModelComparison:
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
        smallest_model(larger),
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


@dataclass(frozen=True)
class HeldOut:
    """Prediction of frames by a fit without them; only their board poses are fitted to them.

    Attributes
    ----------
    estimate
        The fit without the frames, with their poses (f, 4, 4).
    observations
        Their corners (n).
    residuals
        Predicted minus observed pixels (n, 2).
    inliers
        Which corners are no outliers (n,).
    board
        The board with the shape that the fit without the frames found.
    """

    estimate: Estimate
    observations: Observations
    residuals: FloatArray
    inliers: BoolArray
    board: Board

    @property
    def rms_px(self) -> FloatArray:
        """Root mean square residual (2,) per axis over the inliers."""
        return np.sqrt(np.mean(self.residuals[self.inliers] ** 2, axis=0))

    @property
    def rms_sigmas(self) -> float:
        """Root mean square residual of the inliers in standard deviations of the corners, as the observations state."""
        return float(np.sqrt(np.mean(self.observations.standardised(self.residuals)[self.inliers] ** 2)))


def frames_of(observations: Observations, estimate: Estimate, frames: BoolArray) -> tuple[Observations, Estimate]:
    """The rows and poses of some frames (f,), renumbered from 0."""
    number = np.cumsum(frames) - 1
    rows = observations.where(frames[observations.frame])
    return replace(rows, frame=number[rows.frame]), estimate.of_frames(frames)


def _frames_alone(fitted: Estimate, model: Model, rest: Estimate) -> tuple[Estimate, Model]:
    """The globals of one estimate with the frames of another, and the model in which only these frames are free."""
    shaped = Board.rigid(model.board.shaped(fitted.shape))
    frames = replace(
        fitted,
        rig_from_board=rest.rig_from_board,
        camera_turn=rest.camera_turn,
        bow_mm=rest.bow_mm,
        shape=np.zeros(0),
    )
    alone = Model((), thickness=False, curvature=False, board=shaped, mirrors=False, frame_terms=model.frame_terms)
    return frames, alone


def held_out(start: Estimate, observations: Observations, model: Model, out: BoolArray) -> HeldOut:
    """Predict the frames `out` (f,) by a robust fit without them."""
    kept, kept_start = frames_of(observations, start, ~out)
    fitted = fit(kept_start, kept, model).estimate
    rest, rest_start = frames_of(observations, start, out)
    placed, frames = _frames_alone(fitted, model, rest_start)
    solution = fit(placed, rest, frames)
    return HeldOut(solution.estimate, rest, solution.residuals, solution.inliers, frames.board)


def held_out_residuals(start: Estimate, observations: Observations, model: Model, fold: IntArray) -> FloatArray:
    """Residuals (n, 2) px of every frame, as a fit to the other folds predicts it; `fold` (f,) numbers the folds.

    All rows take part, so that models can be compared on the same ones.
    """
    left = np.empty((len(observations), 2))
    for out, placed, rest, frames in _left_out(start, observations, model, fold):
        found, _ = minimise(placed, rest, frames)
        left[out[observations.frame]] = residuals(found, rest, frames.board)
    return left


def held_out_corners(start: Estimate, observations: Observations, model: Model, fold: IntArray) -> FloatArray:
    """Residuals (n, 2) px of every corner, as a fit to the other folds and half of its own frame's corners predict it.

    A frame's own numbers are fitted to every other corner of each view, and predict those between them.
    """
    left = np.empty((len(observations), 2))
    for out, placed, rest, frames in _left_out(start, observations, model, fold):
        errors = np.empty((len(rest), 2))
        for half in (0, 1):
            hidden = rest.corner % 2 == half
            found, _ = minimise(placed, rest.where(~hidden), frames)
            errors[hidden] = residuals(found, rest.where(hidden), frames.board)
        left[out[observations.frame]] = errors
    return left


def _left_out(
    start: Estimate, observations: Observations, model: Model, fold: IntArray
) -> Iterator[tuple[BoolArray, Estimate, Observations, Model]]:
    """For each fold: its frames (f,), a start with the globals of a fit to the others, its rows, and their model."""
    for number in range(int(fold.max()) + 1):
        out = fold == number
        kept, kept_start = frames_of(observations, start, ~out)
        fitted, _ = minimise(kept_start, kept, model)
        rest, rest_start = frames_of(observations, start, out)
        placed, frames = _frames_alone(fitted, model, rest_start)
        yield out, placed, rest, frames


def is_mirrored(observations: Observations, frames: int) -> BoolArray:
    """Mask (f,) of the frames that show anything through a mirror."""
    return np.isin(np.arange(frames), observations.frame[observations.view != DIRECT])


def balanced_folds(estimate: Estimate, observations: Observations, board: Board, parts: int) -> IntArray:
    """Assign each frame (f,) to one of `parts` folds so that every fold holds similar board poses.

    Frames with and without mirrors are assigned separately. Each kind is ordered along a path from one pose to the next
    most similar one and dealt to the folds back and forth, so that what changes along the path is balanced.
    """
    part = np.empty(len(estimate.rig_from_board), dtype=np.int64)
    mirrored = is_mirrored(observations, len(part))
    corners = board.corners_in_board_mm
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    poses = estimate.rig_from_board
    middles = poses[:, :3, :3] @ corners.mean(axis=0) + poses[:, :3, 3]
    # A board turned by a radian is as unlike as one shifted by its own size.
    likeness = np.concatenate([middles, size * poses[:, :3, :3].reshape(-1, 9) / np.sqrt(2.0)], axis=1)
    to_and_fro = [*range(parts), *reversed(range(parts))]
    walk = [frame for kind in (mirrored, ~mirrored) for frame in _path(likeness, np.flatnonzero(kind))]
    for turn, frame in enumerate(walk):
        part[frame] = to_and_fro[turn % len(to_and_fro)]
    return part


def _path(points: FloatArray, members: IntArray) -> list[int]:
    """Members in the order of a greedy path: from the outermost one always on to the nearest one left."""
    left = list(members)
    if not left:
        return []
    middle = points[members].mean(axis=0)
    walk = [left.pop(int(np.argmax(np.linalg.norm(points[left] - middle, axis=1))))]
    while left:
        walk.append(left.pop(int(np.argmin(np.linalg.norm(points[left] - points[walk[-1]], axis=1)))))
    return [int(frame) for frame in walk]


def near_and_far(estimate: Estimate, observations: Observations, board: Board) -> IntArray:
    """Mirrored frames with the board nearer (0) or farther (1) than their median; the other frames are balanced."""
    part = balanced_folds(estimate, observations, board, 2)
    mirrored = np.flatnonzero(is_mirrored(observations, len(part)))
    poses = estimate.rig_from_board[mirrored]
    middles = poses[:, :3, :3] @ board.corners_in_board_mm.mean(axis=0) + poses[:, :3, 3]
    distances = np.linalg.norm(middles, axis=1)
    order = np.argsort(distances, kind="stable")
    part[mirrored[order]] = np.arange(len(order)) >= len(order) // 2
    return part
