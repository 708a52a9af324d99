"""Cross-validation over frames: folds of similar poses, and residuals of frames that a fit has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, fit, minimise
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals


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
