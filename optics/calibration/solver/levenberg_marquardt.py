"""Levenberg-Marquardt for camera, mirrors and board poses: a robust start, then least squares without outliers.

Noise averages out over corners and frames. Errors common to all corners of a view do not, and are added to the
covariance. Ghost images of second-surface mirrors cause such errors: they shift edges by some hundredths of a pixel, of
which a few percent remain even when modelled. Residuals do not reveal them, because mirrors and camera compensate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.normal_equations import (
    Chunk,
    Grouped,
    NormalEquations,
    ParameterIndices,
    columns_of,
    normal_equations,
    residuals_of,
)
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import FRAME_PARAMETERS, Estimate, global_names, residuals

BoolArray = NDArray[np.bool_]
HUBER_SCALE = 1.345
CONVERGED = 0.99
FIND_SIGMAS, DROP_SIGMAS = 5.0, 4.0
MAX_OUTLIERS = 0.5
"""Maximum fraction of outliers in a mirror: a larger fraction means that the model is wrong."""
MAX_ITERATIONS = 50
MIN_RELATIVE_GAIN = 1e-9
"""Minimum predicted decrease, as a fraction of the cost, for another step. With 60,000 residuals it corresponds to a
step of 0.008 sigma, and the next step would be a few hundredths of that."""
ROUNDING_PX = 1e-10
"""Rounding error of a residual: a cost of this size is zero."""
MIN_EIGENVALUE = 5e-14
"""Minimum eigenvalue of the scaled information that counts as determined; rounding errors are below 1e-14. For a
direction that only the prior of a rational lens determines, it is 5e-13 with 15,000 corners, and smaller with more."""
COMMON_ERROR_PX = 0.0005
"""Standard deviation of the errors common to the corners of a second-surface mirror: of a shift and of linear fields
(rms over the corners), for each axis."""
FIELDS = 6
"""Number of common error fields of a view: for x and y each, a shift and linear fields along x and along y."""


class UndeterminedError(Exception):
    """The observations do not determine all parameters of the fit."""


@dataclass(frozen=True)
class Solution:
    """A least-squares solution.

    Attributes
    ----------
    estimate
        The estimate at the minimum.
    residuals
        Predicted minus observed pixels (n, 2) of all rows.
    inliers
        Mask (n,) of the rows used.
    iterations
        Number of linearisations.
    standardised
        The residuals (n, 2) in stated standard deviations of the corners.
    scale
        Standard deviation of a standardised residual, corrected for the degrees of freedom: 1 if the stated standard
        deviations and the model are right.
    sigma_px
        Standard deviation of the residual of a typical (median) corner.
    parameters
        Names (g,) of the free global parameters.
    covariance
        Covariance (g, g) of the free global parameters, marginalised over board poses and other per-frame ones: scale^2
        times the inverse of the reduced normal matrix, plus the common errors (`common_error_covariance`).
    effective_frame_terms
        Number of per-frame parameters, besides the poses, that the corners rather than their priors determine.
    """

    estimate: Estimate
    residuals: FloatArray
    inliers: BoolArray
    standardised: FloatArray
    iterations: int
    scale: float
    sigma_px: float
    parameters: tuple[str, ...]
    covariance: FloatArray
    effective_frame_terms: float = 0.0

    @property
    def rms_px(self) -> FloatArray:
        """Rms residual (2,) per axis over the rows used."""
        return np.sqrt(np.mean(self.residuals[self.inliers] ** 2, axis=0))


def fit(start: Estimate, observations: Observations, model: Model) -> Solution:
    """Fit a model to observed corners: robust start (Huber), least squares without outliers, covariance.

    Outliers follow mrcal's rule: if any corner of a view lies beyond 5 sigma, that view's corners beyond 4 sigma are
    dropped and the fit is repeated, until there are none. Sigma is re-estimated from the remaining corners. If that
    would drop more than `MAX_OUTLIERS` of a mirror's corners, no more are dropped.

    Parameters
    ----------
    start
        Initial estimate.
    observations
        The corners.
    model
        The model with its free parameters.

    Raises
    ------
    UndeterminedError
        If the corners leave a free parameter undetermined, or the start predicts a corner that is not visible.
    """
    if model.thickness and not (start.thickness_mm > 0.0).any():
        raise UndeterminedError("no mirror is second-surface, so no plate thickness can be determined")
    parameters = model.parameters(start.camera, len(start.virtual_centres_in_rig_mm))
    frames = len(start.rig_from_board)
    estimate, iterations = start, 0
    # Far from the minimum, free curvatures would dominate and mislead the thickness, which has little effect.
    for stage in [replace(model, thickness=False)] * (model.thickness and model.curvature) + [model]:
        estimate, steps = start_robustly(estimate, observations, stage)
        iterations += steps
    r = observations.standardised(residuals(estimate, observations, model.board))
    inliers = np.ones(len(observations), dtype=bool)
    scale = _robust_scale(r)
    while True:
        inliers = _without_outliers(r, observations, inliers, scale)
        used = observations.where(inliers)
        terms = effective_frame_terms(estimate, used, model)
        unknowns = len(parameters) + 6 * frames + terms
        degrees_of_freedom = 2 * len(used) - unknowns
        if degrees_of_freedom <= 0:
            raise UndeterminedError(f"{len(used)} corners for {unknowns:.0f} unknowns, expected more")
        estimate, steps = minimise(estimate, used, model)
        iterations += steps
        r_px = residuals(estimate, observations, model.board)
        r = observations.standardised(r_px)
        scale = float(np.sqrt(np.sum(r[inliers] ** 2) / degrees_of_freedom))
        if np.array_equal(_without_outliers(r, observations, inliers, scale), inliers):
            break
    covariance = scale**2 * _inverse_information(estimate, used, model) + common_error_covariance(estimate, used, model)
    sigma_px = scale * float(np.median(used.sigma_px))
    return Solution(estimate, r_px, inliers, r, iterations, scale, sigma_px, parameters, covariance, terms)


def effective_frame_terms(estimate: Estimate, observations: Observations, model: Model) -> float:
    """Number of per-frame parameters, besides the poses, that the corners rather than their priors determine."""
    weights = model.frame_terms.weights[6:]
    if not weights.size:
        return 0.0
    normal = normal_equations(estimate, Grouped.of(observations, model), model)
    try:
        covariance = np.linalg.inv(normal.v)[:, 6:, 6:]
    except np.linalg.LinAlgError:
        raise UndeterminedError(f"{len(observations)} corners do not determine the pose of a board") from None
    return float(weights.size * len(covariance) - np.sum(np.einsum("fii->fi", covariance) * weights**2))


def _inverse_information(estimate: Estimate, observations: Observations, model: Model) -> FloatArray:
    """Inverse (g, g) of the reduced normal matrix; raises UndeterminedError, naming undetermined parameters."""
    parameters = model.parameters(estimate.camera, len(estimate.virtual_centres_in_rig_mm))
    normal = normal_equations(estimate, Grouped.of(observations, model), model)
    information = np.diag(normal.u)
    for index in np.flatnonzero(information == 0.0):
        raise UndeterminedError(f"nothing in {len(observations)} corners depends on {parameters[index]}")
    try:
        matrix, _ = normal.reduced(0.0)
    except np.linalg.LinAlgError:
        raise UndeterminedError(f"{len(observations)} corners do not determine the pose of a board") from None
    scale = 1.0 / np.sqrt(information)
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    if values.size and not values[0] > MIN_EIGENVALUE:
        largest = np.argsort(-np.abs(vectors[:, 0]), kind="stable")[:3]
        named = ", ".join(parameters[index] for index in largest)
        raise UndeterminedError(
            f"{len(observations)} corners do not determine a direction of the problem, mostly of {named}"
        )
    vectors = vectors * scale[:, None]
    return np.asarray((vectors / values) @ vectors.T)


def _without_outliers(r: FloatArray, observations: Observations, inliers: BoolArray, scale: float) -> BoolArray:
    """Inliers after removing outliers; unchanged if a mirror would lose too many, because the model is wrong.

    So it is for a frame that would keep too few for the pose of its board: it keeps all of them.
    """
    view, frame = observations.view, observations.frame
    norm = np.abs(r).max(axis=1)
    outliers = inliers & (norm > FIND_SIGMAS * scale)
    remaining = inliers & ~(np.isin(view, view[outliers]) & (norm > DROP_SIGMAS * scale))
    lost = np.bincount(frame, weights=remaining) < MIN_CORNERS
    remaining |= inliers & lost[frame]
    _, mirror, corners = np.unique(view, return_inverse=True, return_counts=True)
    kept_fraction = np.bincount(mirror, weights=remaining) / corners
    return remaining if (kept_fraction >= 1.0 - MAX_OUTLIERS).all() else inliers


def _robust_scale(r: FloatArray) -> float:
    return max(1.4826 * float(np.median(np.abs(r))), 1e-9)


def minimise(
    start: Estimate, observations: Observations, model: Model, *, max_iterations: int = MAX_ITERATIONS
) -> tuple[Estimate, int]:
    """Minimise the squares from `start` until a step predicts a relative decrease of the cost below MIN_RELATIVE_GAIN.

    Returns the estimate and the number of iterations. Raises UndeterminedError if the start predicts an invisible
    corner.
    """
    grouped = Grouped.of(observations, model)
    estimate, damping = start, _Damping()
    r = _residuals_at_start(estimate, grouped, model)
    iterations = 0
    while iterations < max_iterations:
        iterations += 1
        cost = _squares(r) + model.prior_squares(estimate)
        normal = normal_equations(estimate, grouped, model)
        step = _descend(estimate, grouped, model, normal, damping, _squares, cost)
        if step is None:
            break
        estimate, r, predicted = step
        if predicted <= MIN_RELATIVE_GAIN * cost:
            break
    return estimate, iterations


def start_robustly(start: Estimate, observations: Observations, model: Model) -> tuple[Estimate, int]:
    """Return an estimate near the minimum of Huber's loss, which limits outliers, and the number of iterations.

    Scale and weights are updated after every step, until the median residual decreases by less than 1 %. Raises
    UndeterminedError if the start predicts a corner that is not visible.
    """
    grouped = Grouped.of(observations, model)
    estimate, damping = start, _Damping()
    r = _residuals_at_start(estimate, grouped, model)
    previous, iterations = np.inf, 0
    while iterations < MAX_ITERATIONS:
        scale = _robust_scale(r)
        if scale > CONVERGED * previous:
            break
        previous = scale
        iterations += 1
        loss = _Huber(HUBER_SCALE * scale)
        normal = normal_equations(estimate, grouped, model, loss.root_weights(r))
        cost = loss(r) + model.prior_squares(estimate)
        step = _descend(estimate, grouped, model, normal, damping, loss, cost)
        if step is None:
            break
        estimate, r, _ = step
    return estimate, iterations


def _residuals_at_start(estimate: Estimate, grouped: Grouped, model: Model) -> FloatArray:
    r = residuals_of(estimate, grouped, model)
    if not np.isfinite(r).all():
        raise UndeterminedError("the start predicts a corner behind the camera or behind a mirror")
    return r


def _squares(r: FloatArray) -> float:
    return float(np.vdot(r, r))


@dataclass(frozen=True)
class _Huber:
    """Huber's loss: the squared length of a corner's standardised residual up to `threshold`, linear beyond."""

    threshold: float

    def __call__(self, r: FloatArray) -> float:
        norm = np.sqrt(r[0] ** 2 + r[1] ** 2)
        return float(np.sum(np.where(norm <= self.threshold, norm**2, self.threshold * (2.0 * norm - self.threshold))))

    def root_weights(self, r: FloatArray) -> FloatArray:
        """Square roots (n,) of the weights with which the weighted squares of r (2, n) have the loss's gradient."""
        norm = np.sqrt(r[0] ** 2 + r[1] ** 2)
        return np.sqrt(self.threshold / np.maximum(norm, self.threshold))


@dataclass
class _Damping:
    """Marquardt's damping by Nielsen's rule, which follows the ratio of actual to predicted decrease.

    H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05 (1999).
    """

    value: float = 1e-6
    growth: float = 2.0

    def accepted(self, ratio: float) -> None:
        self.value = max(self.value * max(0.1, 1.0 - (2.0 * ratio - 1.0) ** 3), 1e-15)
        self.growth = 2.0

    def rejected(self) -> None:
        self.value *= self.growth
        self.growth *= 2.0


def _descend(
    estimate: Estimate,
    grouped: Grouped,
    model: Model,
    normal: NormalEquations,
    damping: _Damping,
    loss: Callable[[FloatArray], float],
    cost: float,
) -> tuple[Estimate, FloatArray, float] | None:
    """Return estimate, residuals and predicted decrease of the first step that lowers the loss; None if none does."""
    while damping.value < 1e9:
        try:
            step_global, step_poses, predicted = normal.step(damping.value)
        except np.linalg.LinAlgError:
            damping.rejected()
            continue
        if predicted <= 2.0 * grouped.sum_per_variance * ROUNDING_PX**2:
            return None
        trial = _trial(estimate, model, step_global, step_poses)
        if trial is not None:
            r = residuals_of(trial, grouped, model)
            gain = cost - loss(r) - model.prior_squares(trial)
            if gain >= 0.0:
                damping.accepted(gain / predicted)
                return trial, r, predicted
        damping.rejected()
    return None


def _trial(estimate: Estimate, model: Model, step_global: FloatArray, step_frames: FloatArray) -> Estimate | None:
    """Return the estimate after a step; None if the camera or a plate would become invalid."""
    mirrors = len(estimate.virtual_centres_in_rig_mm)
    step = np.zeros(len(global_names(estimate.camera.intrinsic_names, mirrors, estimate.shape.size)))
    step[model.free(estimate.camera, mirrors)] = step_global
    focal = estimate.camera.intrinsics[:2] + step[:2]
    if not np.isfinite(step).all() or not np.isfinite(step_frames).all() or (focal <= 0.0).any():
        return None
    step_all = np.zeros((len(step_frames), FRAME_PARAMETERS))
    step_all[:, model.frame_terms.free] = step_frames
    trial = estimate.moved(step, step_all)
    return trial if np.array_equal(trial.thickness_mm > 0.0, estimate.thickness_mm > 0.0) else None


def common_error_covariance(estimate: Estimate, observations: Observations, model: Model) -> FloatArray:
    """Covariance (g, g) of the free global parameters due to errors common to corners.

    They are smooth errors of each mirror's corners, and the error of the plates' refractive index.

    Parameters
    ----------
    estimate
        The minimum of the sum of squares.
    observations
        The fitted corners.
    model
        The model with its free parameters.
    """
    mirrors = len(estimate.virtual_centres_in_rig_mm)
    index = ParameterIndices.of(model, mirrors)
    plates = np.flatnonzero(estimate.thickness_mm > 0.0)
    if not index.size or not np.isin(observations.view, plates).any():
        return np.zeros((index.size, index.size))
    grouped = Grouped.of(observations, model)
    matrix, solved = normal_equations(estimate, grouped, model).reduced(0.0)
    shifts: list[FloatArray] = []
    if model.index_sigma > 0.0:
        other_index = replace(estimate, refractive_index=estimate.refractive_index + model.index_sigma)
        shifts.append(normal_equations(other_index, grouped, model).step(0.0)[0][:, None])
    corners = np.ascontiguousarray(model.board.shaped(estimate.shape).T)
    centres, sizes = _extents(observations, mirrors)
    gradients = np.zeros((index.size, mirrors, FIELDS))
    for chunk in grouped.chunks:
        if chunk.direct:
            continue
        columns = columns_of(estimate, chunk, model, corners)
        fields = _fields((chunk.pixels - centres[chunk.view].T) / sizes[chunk.view].T) * chunk.per_sigma
        for group_indices, mirror, frame, start, stop in _groups(chunk, index):
            if estimate.thickness_mm[mirror] > 0.0:
                sums = np.einsum("cxn,fxn->cf", columns[:, :, start:stop], fields[:, :, start:stop])
                frame_size = solved.shape[1]
                gradients[:, mirror] -= solved[frame, :, :-1].T @ sums[:frame_size]
                gradients[group_indices, mirror] += sums[frame_size + 1 :]
    shifts.append(COMMON_ERROR_PX * cho_solve(cho_factor(matrix), gradients.reshape(index.size, mirrors * FIELDS)))
    return np.asarray(sum(shift @ shift.T for shift in shifts))


def _groups(chunk: Chunk, index: ParameterIndices) -> list[tuple[FloatArray, int, int, int, int]]:
    """For each group of a chunk: parameter indices, mirror, frame, first and last row."""
    ends = zip(chunk.edges[:-1], chunk.edges[1:], strict=True)
    columns = index.of_groups(chunk.group_view)
    return [
        (group_indices, mirror, frame, start, stop)
        for group_indices, mirror, frame, (start, stop) in zip(
            columns, chunk.group_view.tolist(), chunk.group_frame.tolist(), ends, strict=True
        )
    ]


def _extents(observations: Observations, mirrors: int) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation (mirrors, 2) of each mirror's corner pixels; 0 and 1 without corners."""
    means, deviations = np.zeros((mirrors, 2)), np.ones((mirrors, 2))
    for mirror in range(mirrors):
        pixels = observations.pixels[observations.view == mirror]
        if len(pixels):
            means[mirror], deviations[mirror] = pixels.mean(axis=0), np.maximum(pixels.std(axis=0), 1.0)
    return means, deviations


def _fields(xy: FloatArray) -> FloatArray:
    """Common error fields (f, 2, n), of rms 1, at corner positions (2, n) normalised within their view."""
    one, zero = np.ones(xy.shape[1]), np.zeros(xy.shape[1])
    return np.stack([pair for field in (one, *xy) for pair in (np.stack([field, zero]), np.stack([zero, field]))])
