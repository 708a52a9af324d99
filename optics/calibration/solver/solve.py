"""Levenberg-Marquardt for cameras, mirrors and board poses, with the poses eliminated by the Schur complement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from optics.calibration.observations import Observations
from optics.calibration.solver.model import Model
from optics.calibration.solver.residuals import (
    Estimate,
    global_names,
    residuals,
    residuals_with_jacobians,
)
from optics.values import FloatArray

BoolArray = NDArray[np.bool_]


HUBER_SCALE = 1.345
FIND_SIGMAS, DROP_SIGMAS = 5.0, 4.0


class UndeterminedError(Exception):
    """The observations do not determine what was asked for."""


@dataclass(frozen=True)
class Solution:
    """A minimum: estimate, residuals (n, 2), which rows took part (n,), pixel noise and covariance of the globals.

    `covariance` (g, g) is that of the free globals, named in `parameters` (g,), with the board's poses marginalised:
    sigma_px^2 times the inverse of the reduced normal matrix.
    """

    estimate: Estimate
    residuals: FloatArray
    inliers: BoolArray
    iterations: int
    sigma_px: float
    parameters: tuple[str, ...]
    covariance: FloatArray

    @property
    def rms_px(self) -> FloatArray:
        """Root mean square residual (2,) per axis over the rows that took part."""
        return np.sqrt(np.mean(self.residuals[self.inliers] ** 2, axis=0))


@dataclass(frozen=True)
class _Normal:
    """Normal equations with a block per frame: globals u (g, g), poses v (f, 6, 6), coupling w (f, 6, g)."""

    u: FloatArray
    v: FloatArray
    w: FloatArray
    gradient_global: FloatArray
    gradient_poses: FloatArray

    def step(self, damping: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The damped step of globals (g,) and poses (f, 6), and the reduced matrix (g, g)."""
        u = self.u + damping * np.diag(np.diag(self.u))
        v = self.v + damping * self.v * np.eye(6)
        solved = np.linalg.solve(v, np.concatenate([self.w, self.gradient_poses[:, :, None]], axis=2))
        reduced = u - np.einsum("fij,fik->jk", self.w, solved[:, :, :-1])
        right = self.gradient_global - np.einsum("fij,fi->j", self.w, solved[:, :, -1])
        step_global = -cho_solve(cho_factor(reduced), right) if right.size else right
        step_poses = -solved[:, :, -1] - solved[:, :, :-1] @ step_global
        return step_global, step_poses, reduced


def _normal_equations(
    estimate: Estimate,
    observations: Observations,
    model: Model,
    root_weights: FloatArray,
) -> _Normal:
    free = model.free(len(estimate.virtual_centres_in_rig_mm))
    r, by_global, by_twist = residuals_with_jacobians(estimate, observations, model.board)
    r = r * root_weights[:, None]
    by_global = by_global[:, :, free] * root_weights[:, None, None]
    by_twist = by_twist * root_weights[:, None, None]
    frames = len(estimate.rig_from_board)
    bounds = np.searchsorted(observations.frame, np.arange(frames + 1))
    v = np.empty((frames, 6, 6))
    w = np.empty((frames, 6, free.size))
    gradient_poses = np.empty((frames, 6))
    for frame in range(frames):
        rows = slice(bounds[frame], bounds[frame + 1])
        twist = by_twist[rows].reshape(-1, 6)
        v[frame] = twist.T @ twist
        w[frame] = twist.T @ by_global[rows].reshape(len(twist), free.size)
        gradient_poses[frame] = twist.T @ r[rows].ravel()
    flat = by_global.reshape(r.size, free.size)
    return _Normal(flat.T @ flat, v, w, flat.T @ r.ravel(), gradient_poses)


def minimise(
    start: Estimate,
    observations: Observations,
    model: Model,
    *,
    root_weights: FloatArray | None = None,
    max_iterations: int = 50,
) -> tuple[Estimate, int]:
    """Weighted least squares from `start` to where a step no longer lowers the cost by 1e-12 of it.

    Raises UndeterminedError where the start makes no sense.
    """
    root = np.ones(len(observations)) if root_weights is None else root_weights
    estimate, damping = start, 1e-6
    cost = _cost(residuals(estimate, observations, model.board), root)
    if not np.isfinite(cost):
        raise UndeterminedError("the start predicts a corner behind the camera")
    mirrors = len(start.virtual_centres_in_rig_mm)
    free, size = model.free(mirrors), len(global_names(mirrors, start.shape.size))
    for iteration in range(1, max_iterations + 1):
        normal = _normal_equations(estimate, observations, model, root)
        while True:
            trial = _trial(estimate, normal, damping, free, size)
            trial_cost = np.inf if trial is None else _cost(residuals(trial, observations, model.board), root)
            if trial is not None and trial_cost <= cost:
                break
            damping = max(10.0 * damping, 1e-9)
            if damping > 1e9:
                return estimate, iteration
        gain = cost - trial_cost
        estimate, cost, damping = trial, trial_cost, max(damping / 10.0, 1e-15)
        if gain <= 1e-12 * cost or cost == 0.0:
            break
    return estimate, iteration


def _cost(r: FloatArray, root_weights: FloatArray) -> float:
    total = float(np.sum((r * root_weights[:, None]) ** 2))
    return total if np.isfinite(total) else np.inf


def _trial(estimate: Estimate, normal: _Normal, damping: float, free: NDArray[np.int64], size: int) -> Estimate | None:
    """The estimate after a damped step; None where the matrix is not definite or the step makes no camera."""
    try:
        step_free, step_poses, _ = normal.step(damping)
    except np.linalg.LinAlgError:
        return None
    step = np.zeros(size)
    step[free] = step_free
    possible = np.isfinite(step).all() and (estimate.camera.intrinsics[:2] + step[:2] > 0).all()
    return estimate.moved(step, step_poses) if possible else None


def fit(
    start: Estimate,
    observations: Observations,
    model: Model,
) -> Solution:
    """Robust start (Huber), plain least-squares finish without outliers, covariance.

    Outliers by the rule of mrcal: where any corner of a view lies beyond 5 sigma, that view's corners beyond 4 sigma
    are dropped and the fit is done again, until none is found. Sigma is re-estimated from the corners that stay. Raises
    UndeterminedError where the corners leave a free parameter open.
    """
    parameters = model.parameters(len(start.virtual_centres_in_rig_mm))
    estimate, iterations = start_robustly(start, observations, model)
    r = residuals(estimate, observations, model.board)
    inliers = np.ones(len(observations), dtype=bool)
    sigma = _robust_sigma(r)
    while True:
        dropped = _outliers(r, observations.view, inliers, sigma)
        inliers &= ~dropped
        estimate, steps = minimise(estimate, observations, model, root_weights=inliers.astype(np.float64))
        iterations += steps
        r = residuals(estimate, observations, model.board)
        unknowns = len(parameters) + 6 * len(estimate.rig_from_board)
        spare = 2 * int(inliers.sum()) - unknowns
        if spare <= 0:
            raise UndeterminedError(f"{int(inliers.sum())} corners for {unknowns} unknowns, expected more")
        sigma = float(np.sqrt(np.sum(r[inliers] ** 2) / spare))
        if not _outliers(r, observations.view, inliers, sigma).any():
            break
    try:
        _, _, reduced = _normal_equations(estimate, observations, model, inliers.astype(np.float64)).step(0.0)
        covariance = np.asarray(sigma**2 * np.linalg.inv(reduced), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise UndeterminedError(f"{int(inliers.sum())} corners leave a direction of the problem open") from None
    return Solution(estimate, r, inliers, iterations, sigma, parameters, covariance)


def _outliers(r: FloatArray, view: NDArray[np.int64], inliers: BoolArray, sigma: float) -> BoolArray:
    norm = np.abs(r).max(axis=1)
    found = inliers & (norm > FIND_SIGMAS * sigma)
    return inliers & np.isin(view, view[found]) & (norm > DROP_SIGMAS * sigma)


def _robust_sigma(r: FloatArray) -> float:
    return max(1.4826 * float(np.median(np.abs(r))), 1e-9)


def start_robustly(start: Estimate, observations: Observations, model: Model) -> tuple[Estimate, int]:
    """An estimate near the minimum of Huber's loss, whatever a few wild corners say, and the iterations it took.

    The weights are renewed after every few steps, until the median residual no longer shrinks by a hundredth.
    """
    estimate, iterations = start, 0
    previous = np.inf
    for _ in range(20):
        r = residuals(estimate, observations, model.board)
        sigma = _robust_sigma(r)
        if sigma > 0.99 * previous:
            break
        previous = sigma
        norm = np.linalg.norm(r, axis=1) / (HUBER_SCALE * sigma)
        root = np.sqrt(1.0 / np.maximum(norm, 1.0))
        estimate, steps = minimise(estimate, observations, model, root_weights=root, max_iterations=3)
        iterations += steps
    return estimate, iterations
