"""Does a calibration predict what it has not seen, and do its halves agree as well as it claims?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    NOTHING_PX,
    derivatives_held_in,
    grid_px,
    points_at_pixels,
    project,
    uncertainty_of,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import (
    BoolArray,
    Solution,
    UndeterminedError,
    fit,
    minimise,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, global_names, residuals
from mirrorcam.optics.geometry.layout import Layout

ALARM_RATIO = 2.0
ALARM_CHANCE = 1e-3
MIN_HALF = 3
"""Mirrored frames that a half must have."""


@dataclass(frozen=True)
class Split:
    """What two halves of the frames, each solved alone, make of the same camera.

    Per mirror view (m,), root mean square over its sub-image at the working range: `difference_px` between the halves,
    `predicted_px` by the covariances of both, and `chance` of so large a difference where both are right; each also
    `relative`, for points held in the reference view. Over all parameters, `overall_ratio` is the root of the squared
    difference in standard deviations per parameter, 1 on average, `overall_chance` its chance.
    """

    how: str
    frames: tuple[int, int]
    difference_px: FloatArray
    predicted_px: FloatArray
    chance: FloatArray
    relative_difference_px: FloatArray
    relative_predicted_px: FloatArray
    relative_chance: FloatArray
    overall_ratio: float
    overall_chance: float

    @property
    def ratio(self) -> FloatArray:
        """Difference per predicted difference (m,) of each view."""
        return self.difference_px / self.predicted_px

    @property
    def relative_ratio(self) -> FloatArray:
        """The same against the reference view (m,); NaN for that view itself."""
        predicted = self.relative_predicted_px
        return np.divide(
            self.relative_difference_px, predicted, out=np.full(len(predicted), np.nan), where=predicted > 0
        )

    @property
    def _worst(self) -> tuple[float, str]:
        """The largest ratio that is over twice what was predicted, and hardly by chance, and its words; 1 without."""
        enough = ALARM_CHANCE / len(self.chance)
        ratios = [(self.overall_ratio, self.overall_chance < ALARM_CHANCE, "the halves differ overall")]
        for where, in_views, chances, differences in (
            ("", self.ratio, self.chance, self.difference_px),
            (" against the reference view", self.relative_ratio, self.relative_chance, self.relative_difference_px),
        ):
            worst = int(np.argmax(np.nan_to_num(in_views)))
            said = f"mirror {worst} differs by {differences[worst]:.2g} px{where}"
            ratios.append((float(np.nan_to_num(in_views[worst])), bool(chances[worst] < enough), said))
        alarming = [(ratio, said) for ratio, is_unlikely, said in ratios if ratio > ALARM_RATIO and is_unlikely]
        return max(alarming, default=(1.0, ""))

    @property
    def alarm(self) -> str | None:
        """What differs by over twice what was predicted, and hardly by chance, in words; None where nothing does."""
        ratio, said = self._worst
        if not said:
            return None
        return f"split {self.how}, {said}: {ratio:.1f} times what the halves' uncertainties predict"

    @property
    def widening(self) -> float:
        """The factor by which standard deviations are too small to allow for what raised the alarm; 1 without."""
        return self._worst[0]


@dataclass(frozen=True)
class HeldOut:
    """What a fit without some frames says of them, their board poses aside: estimate and residuals (n, 2) px.

    `board` is the shape of the board, held at what the fit without them found.
    """

    estimate: Estimate
    observations: Observations
    residuals: FloatArray
    inliers: BoolArray
    board: Board

    @property
    def rms_px(self) -> FloatArray:
        """Root mean square residual (2,) per axis, outliers aside."""
        return np.sqrt(np.mean(self.residuals[self.inliers] ** 2, axis=0))


def frames_of(observations: Observations, estimate: Estimate, frames: BoolArray) -> tuple[Observations, Estimate]:
    """The rows and poses of some frames (f,), renumbered from 0."""
    number = np.cumsum(frames) - 1
    rows = observations.where(frames[observations.frame])
    renumbered = Observations(number[rows.frame], rows.view, rows.corner, rows.pixels)
    return renumbered, replace(estimate, rig_from_board=estimate.rig_from_board[frames])


def _poses_alone(estimate: Estimate, board: Board) -> tuple[Estimate, Model]:
    """Everything held but the board's poses."""
    shaped = Board.rigid(board.shaped(estimate.shape))
    return replace(estimate, shape=np.zeros(0)), Model(
        (), thickness=False, curvature=False, board=shaped, mirrors=False
    )


def held_out(start: Estimate, observations: Observations, model: Model, out: BoolArray) -> HeldOut:
    """How well a calibration without the frames `out` (f,) predicts them."""
    kept, kept_start = frames_of(observations, start, ~out)
    fitted = fit(kept_start, kept, model).estimate
    rest, rest_start = frames_of(observations, start, out)
    alone, poses = _poses_alone(replace(fitted, rig_from_board=rest_start.rig_from_board), model.board)
    solution = fit(alone, rest, poses)
    return HeldOut(solution.estimate, rest, solution.residuals, solution.inliers, poses.board)


def held_out_residuals(start: Estimate, observations: Observations, model: Model, fold: IntArray) -> FloatArray:
    """Residuals (n, 2) px of every frame as the other folds' fit predicts it; `fold` (f,) says which fold it is in.

    All rows take part, so that models can be compared on the same ones.
    """
    left = np.empty((len(observations), 2))
    for number in range(int(fold.max()) + 1):
        out = fold == number
        kept, kept_start = frames_of(observations, start, ~out)
        fitted, _ = minimise(kept_start, kept, model)
        rest, rest_start = frames_of(observations, start, out)
        alone, poses = _poses_alone(replace(fitted, rig_from_board=rest_start.rig_from_board), model.board)
        placed, _ = minimise(alone, rest, poses)
        left[out[observations.frame]] = residuals(placed, rest, poses.board)
    return left


def is_mirrored(observations: Observations, frames: int) -> BoolArray:
    """Which of the frames (f,) show anything by way of a mirror."""
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
    """Members in the order of a walk from the one farthest out to the nearest not yet met."""
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


def splits(
    solution: Solution,
    observations: Observations,
    model: Model,
    layout: Layout,
    *,
    reference: int,
    range_mm: float,
) -> tuple[tuple[Split, ...], tuple[str, ...]]:
    """Both splits of a calibration: into halves alike, and into near and far boards, which a wrong model tells apart.

    `layout` is the calibrated one. What is predicted is what independent errors of the corners make, however much the
    uncertainties of `layout` were widened since: a difference beyond it is an error of the model even where they allow
    for it. A split is left out, and a note says so, where a half has under 3 mirrored frames or determines no camera.
    """
    if solution.sigma_px < NOTHING_PX:
        return (), ("not split: the corners have no noise that halves could differ by",)
    rows = observations.where(solution.inliers)
    shown = [_shown(layout, view, reference, range_mm) for view in range(len(layout.mirrors))]
    found, notes = [], []
    for how, part in (
        ("into halves alike", balanced_folds(solution.estimate, rows, model.board, 2)),
        ("into near and far boards", near_and_far(solution.estimate, rows, model.board)),
    ):
        mirrored = is_mirrored(rows, len(part))
        if min(np.sum(mirrored & (part == half)) for half in (0, 1)) < MIN_HALF:
            notes.append(f"not split {how}: a half would have under {MIN_HALF} mirrored frames")
            continue
        try:
            halves = [_half(solution.estimate, rows, model, part == half) for half in (0, 1)]
        except UndeterminedError as error:
            notes.append(f"not split {how}: a half does not determine camera and mirrors ({error})")
            continue
        found.append(_compared(how, halves, uncertainty_of(layout).parameters, shown))
    return tuple(found), tuple(notes)


def _half(estimate: Estimate, observations: Observations, model: Model, frames: BoolArray) -> Solution:
    rows, start = frames_of(observations, estimate, frames)
    return fit(start, rows, model)


def _shown(layout: Layout, view: int, reference: int, range_mm: float) -> tuple[FloatArray, FloatArray]:
    """Derivatives (n, 2, g) of a view's pixels by the parameters: of points held in rig, and in the reference view."""
    points = points_at_pixels(layout, view, grid_px(layout, view), range_mm)
    shown = project(layout, view, points)
    return shown.by_parameter, shown.by_parameter + shown.by_point @ derivatives_held_in(layout, reference, points)


def _compared(
    how: str, halves: Sequence[Solution], names: Sequence[str], shown: Sequence[tuple[FloatArray, FloatArray]]
) -> Split:
    a, b = halves
    places = [a.parameters.index(name) for name in names]
    difference = (global_values(a.estimate) - global_values(b.estimate))[_free_places(a, names)]
    covariance = (a.covariance + b.covariance)[np.ix_(places, places)]
    views = [[_quadratic(d, difference, covariance) for d in both] for both in shown]
    in_rig, against = np.array(views).transpose(1, 2, 0)
    squared = float(difference @ np.linalg.solve(covariance, difference))
    return Split(
        how=how,
        frames=(len(a.estimate.rig_from_board), len(b.estimate.rig_from_board)),
        difference_px=in_rig[0],
        predicted_px=in_rig[1],
        chance=in_rig[2],
        relative_difference_px=against[0],
        relative_predicted_px=against[1],
        relative_chance=against[2],
        overall_ratio=float(np.sqrt(squared / len(names))),
        overall_chance=float(chi2.sf(squared, len(names))),
    )


def _quadratic(derivatives: FloatArray, difference: FloatArray, covariance: FloatArray) -> tuple[float, float, float]:
    """Rms of derivatives (n, 2, g) times a difference (g,), what its covariance predicts, and the chance of so much.

    The squared rms is a sum of squared normal variables with unequal variances; its law is taken as that of the scaled
    chi squared variable with the same mean and variance (Satterthwaite 1946).
    """
    flat = derivatives.reshape(-1, derivatives.shape[-1]) * np.sqrt(2.0 / derivatives[..., 0].size)
    squared = float(np.sum((flat @ difference) ** 2))
    weighted = (flat.T @ flat) @ covariance
    mean, spread = float(np.trace(weighted)), float(np.sum(weighted * weighted.T))
    if mean <= 1e-18:  # the reference view against itself
        return 0.0, 0.0, 1.0
    freedom = mean**2 / spread
    return float(np.sqrt(squared)), float(np.sqrt(mean)), float(chi2.sf(squared / mean * freedom, freedom))


def global_values(estimate: Estimate) -> FloatArray:
    """The numbers of an estimate in the order of `global_names`; of the sheets' correction, their mean thickness."""
    sheets = estimate.thickness_mm[estimate.thickness_mm > 0.0]
    return np.concatenate(
        [
            estimate.camera.intrinsics,
            estimate.virtual_centres_in_rig_mm.ravel(),
            estimate.curvature_per_m.ravel(),
            [sheets.mean() if sheets.size else 0.0],
            estimate.shape,
        ]
    )


def _free_places(solution: Solution, names: Sequence[str]) -> list[int]:
    every = global_names(len(solution.estimate.virtual_centres_in_rig_mm), solution.estimate.shape.size)
    return [every.index(name) for name in names]
