"""Comparison with free virtual cameras: each mirror's view has six pose parameters instead of a plane's three.

The improvement by this model measures the errors that the planes leave unexplained, whatever their cause. It is only a
check and never the result, because its views no longer come from one camera and mirrors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation
from scipy.stats import f as f_distribution

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, UndeterminedError
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import (
    Estimate,
    global_names,
    points_at_camera,
    residuals_with_jacobians,
)

STEPS = 10


@dataclass(frozen=True)
class FreeViews:
    """Comparison of a calibration with free virtual cameras.

    Attributes
    ----------
    parameters
        Number of additional parameters.
    rms_px
        Rms residual per axis of a typical corner with free virtual cameras.
    unexplained_px
        Rms per axis of the errors that only free virtual cameras explain, minus the expected effect of the additional
        parameters on noise.
    chance
        Probability of such an improvement by noise alone (F test).
    """

    parameters: int
    rms_px: float
    unexplained_px: float
    chance: float


def free_views(solution: Solution, observations: Observations, model: Model) -> FreeViews:
    """Compare a solution with free virtual cameras, on its inliers.

    A view shows the image X' of a point in its mirror at exp(w) (X' - o) + o + t, with o the centroid of the view's
    corners. Unless a frame also shows its board directly, the images of all mirrors may move as one body with the
    boards, so w and t of the first mirror are fixed.

    Raises
    ------
    UndeterminedError
        If virtual cameras have no additional unknowns, or the corners leave one undetermined.
    """
    rows = observations.where(solution.inliers)
    mirrors = len(solution.estimate.virtual_centres_in_rig_mm)
    frames = np.arange(len(solution.estimate.rig_from_board))
    constrained = np.isin(frames, rows.frame[rows.view == DIRECT]) & np.isin(frames, rows.frame[rows.view != DIRECT])
    fixed = 0 if constrained.any() else 1
    extra_parameters = 6 * (mirrors - fixed) - 3 * mirrors + (model.prior_of_centres is not None)
    if extra_parameters <= 0:
        raise UndeterminedError(f"{mirrors} mirrors are free virtual cameras already")
    plane_squares = float(np.sum(solution.standardised[solution.inliers] ** 2))
    plane_squares += float(np.sum(model.intrinsic_values(solution.estimate.camera) ** 2))
    free_squares = _minimum(solution.estimate, rows, model, fixed)
    degrees_of_freedom = 2 * len(rows) - len(solution.parameters) - extra_parameters - 6 * len(frames)
    if degrees_of_freedom <= 0:
        raise UndeterminedError(f"{len(rows)} corners are too few for free virtual cameras")
    variance = free_squares / degrees_of_freedom
    drop = max(plane_squares - free_squares, 0.0)
    typical_px = float(np.median(rows.sigma_px))
    return FreeViews(
        parameters=extra_parameters,
        rms_px=typical_px * float(np.sqrt(free_squares / (2 * len(rows)))),
        unexplained_px=typical_px * float(np.sqrt(max(drop - extra_parameters * variance, 0.0) / (2 * len(rows)))),
        chance=float(f_distribution.sf(drop / extra_parameters / variance, extra_parameters, degrees_of_freedom)),
    )


@dataclass(frozen=True)
class _Views:
    """Rotations (m, 3), rad, about the centroids (m, 3), mm, and shifts (m, 3), mm, of the images in every mirror."""

    rotations: FloatArray
    shifts: FloatArray
    centroids_mm: FloatArray


def _minimum(estimate: Estimate, rows: Observations, model: Model, fixed: int) -> float:
    """Minimise over virtual cameras, poses, intrinsics and modes of the board; return the standardised sum of squares.

    The priors of the lens are included.
    """
    mirrors = len(estimate.virtual_centres_in_rig_mm)
    names = global_names(estimate.camera.intrinsic_names, mirrors, len(model.board.modes))
    free_columns = [k for k, name in enumerate(names) if name in model.intrinsics or name.startswith("board ")]
    _, _, images = points_at_camera(estimate, rows, model.board)
    centroids = np.array([images[rows.view == m].mean(axis=0) for m in range(mirrors)])
    views = _Views(np.zeros((mirrors, 3)), np.zeros((mirrors, 3)), centroids)
    r, d_global, d_twist = _linearised(estimate, views, rows, model, free_columns, fixed)
    priors = np.zeros((2, d_global.shape[2]))
    lens = slice(len(model.intrinsics))
    priors[:, lens] = model.intrinsic_priors(estimate.camera), model.intrinsic_values(estimate.camera)
    cost, damping = float(np.sum(r**2) + np.sum(priors[1] ** 2)), 0.0
    for _ in range(STEPS):
        step, twists = _step(r, d_global, d_twist, rows, priors, damping)
        global_step = np.zeros(len(names))
        global_step[free_columns] = step[: len(free_columns)]
        change = step[len(free_columns) :].reshape(-1, 6)
        trial = estimate.moved(global_step, twists)
        trial_views = _Views(views.rotations.copy(), views.shifts.copy(), centroids)
        trial_views.rotations[fixed:] += change[:, :3]
        trial_views.shifts[fixed:] += change[:, 3:]
        linearised = _linearised(trial, trial_views, rows, model, free_columns, fixed)
        values = model.intrinsic_values(trial.camera)
        trial_cost = float(np.sum(linearised[0] ** 2) + np.sum(values**2))
        if not trial_cost <= cost:
            damping = max(10.0 * damping, 1e-6)
            continue
        gain, cost = cost - trial_cost, trial_cost
        estimate, views, (r, d_global, d_twist), damping = trial, trial_views, linearised, damping / 10.0
        priors[1, lens] = values
        if gain <= 1e-9 * cost:
            break
    return cost


def _linearised(
    estimate: Estimate, views: _Views, rows: Observations, model: Model, free_columns: list[int], fixed: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return standardised residuals (n, 2), and derivatives with respect to globals, motions of views, and poses.

    The derivatives with respect to pose and board neglect the views' rotations, which are far below a degree: the steps
    still converge, and the residuals are exact. Residuals are infinite if a derivative does not exist.
    """
    mirrored = rows.view != DIRECT
    view = rows.view[mirrored]
    _, _, images = points_at_camera(estimate, rows, model.board)
    lever = images[mirrored] - views.centroids_mm[view]
    rotated = np.einsum("nij,nj->ni", Rotation.from_rotvec(views.rotations).as_matrix()[view], lever)
    images[mirrored] = rotated + views.centroids_mm[view] + views.shifts[view]
    impossible = np.full((len(rows), 2), np.inf), np.zeros((len(rows), 2, 0)), np.zeros((len(rows), 2, 6))
    if (images[:, 2] <= 0).any():
        return impossible
    pixels, d_image, d_intrinsics = estimate.camera.project_with_jacobians(images)
    _, d_global, d_frame = residuals_with_jacobians(estimate, rows, model.board)
    d_global[:, :, : d_intrinsics.shape[2]] = d_intrinsics
    d_motion = np.zeros((len(rows), 2, 6 * len(views.rotations)))
    mirrored_rows = np.flatnonzero(mirrored)
    d_rotation = np.cross(rotated[:, None, :], d_image[mirrored])
    for k in range(3):
        d_motion[mirrored_rows, :, 6 * view + k] = d_rotation[:, :, k]
        d_motion[mirrored_rows, :, 6 * view + 3 + k] = d_image[mirrored][:, :, k]
    d_parameters = np.concatenate([d_global[:, :, free_columns], d_motion[:, :, 6 * fixed :]], axis=2)
    if not (np.isfinite(d_parameters).all() and np.isfinite(d_frame).all()):
        return impossible  # a corner that the planes alone show outside the lens's range has no derivatives
    sigma = rows.sigma_px[:, None, None]
    return rows.standardised(pixels - rows.pixels), d_parameters / sigma, d_frame[:, :, :6] / sigma


def _step(
    r: FloatArray, d_global: FloatArray, d_twist: FloatArray, rows: Observations, priors: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray]:
    """Return the damped Gauss-Newton step of the global parameters (g,) and the poses (f, 6), with poses eliminated.

    `priors` (2, g) are the weights of the global parameters' priors, and their weighted values.
    """
    size = d_global.shape[2]
    reduced, rhs = np.diag(priors[0] ** 2), priors[0] * priors[1]
    frames = []
    for frame in range(int(rows.frame[-1]) + 1):
        in_frame = rows.frame == frame
        u, p, e = d_global[in_frame].reshape(-1, size), d_twist[in_frame].reshape(-1, 6), r[in_frame].ravel()
        block = p.T @ p
        solved = np.linalg.solve(block + damping * np.diag(np.diag(block)), np.column_stack([p.T @ u, p.T @ e]))
        reduced += u.T @ u - (u.T @ p) @ solved[:, :-1]
        rhs += u.T @ e - (u.T @ p) @ solved[:, -1]
        frames.append(solved)
    scale = np.sqrt(np.maximum(np.diag(reduced), 1e-300))
    scaled = reduced / np.outer(scale, scale)
    try:
        step = -cho_solve(cho_factor(scaled + damping * np.eye(size)), rhs / scale) / scale
    except np.linalg.LinAlgError:
        raise UndeterminedError("the corners do not determine a free virtual camera") from None
    return step, np.array([-solved[:, -1] - solved[:, :-1] @ step for solved in frames])
