"""Bundle adjustment of a camera, mirrors and free points that are labelled directly and in the mirrors.

Every labelled point of every frame is a point of its own in space: no board and no rigid body. A point X is seen at the
projection of X, and in a mirror at that of its reflection. The points are eliminated by the Schur complement, each with
a block of 3 x 3. Labels do not determine the unit of length, so steps of the virtual centres are perpendicular to a
common change of their scale.

A point is a frame of the solver with a board of a single corner, so that projections and derivatives are shared with
the calibration from boards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space

from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.calibration.solver.levenberg_marquardt import MIN_EIGENVALUE, UndeterminedError
from mirrorcam.optics.calibration.solver.normal_equations import NormalEquations
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.residuals import (
    Board,
    Estimate,
    linearized,
    mirrors_of_views,
    residuals,
)
from mirrorcam.optics.geometry.camera import Camera

POINT = Board.rigid(np.zeros((1, 3)))
"""The board of a labelled point."""
MAX_ITERATIONS = 15
MIN_RELATIVE_GAIN = 1e-7
MAX_DAMPING = 1e8
SMALL = 1e-12


@dataclass(frozen=True, eq=False)
class CameraPrior:
    """What is known of the camera before: its intrinsics, and their covariance (k, k); a row of zeros holds one."""

    camera: Camera
    covariance: FloatArray

    @classmethod
    def known(cls, camera: Camera) -> CameraPrior:
        """Return the prior that holds all intrinsics."""
        return cls(camera, np.zeros((len(camera.intrinsics),) * 2))

    @property
    def free(self) -> IntArray:
        """Indices (i,) of the free intrinsics."""
        return np.flatnonzero(np.diag(self.covariance) > 0.0)

    @property
    def information(self) -> FloatArray:
        """Inverse covariance (i, i) of the free intrinsics."""
        return np.asarray(np.linalg.inv(self.covariance[np.ix_(self.free, self.free)]))

    def deviation(self, camera: Camera) -> FloatArray:
        """Deviation (i,) of a camera's free intrinsics."""
        return np.asarray((camera.intrinsics - self.camera.intrinsics)[self.free])


@dataclass(frozen=True, eq=False)
class Rows:
    """Standardised residuals (n, 2) of labels, and their derivatives by all parameters (n, 2, g) and points (n, 2, 3).

    Parameters are the free intrinsics and the virtual centres, then, if asked for, a rotation of each mirror's view.
    """

    r: FloatArray
    d_global: FloatArray
    d_point: FloatArray


def points_estimate(camera: Camera, centres: FloatArray, points: FloatArray) -> Estimate:
    """Return an estimate of camera, virtual centres (m, 3) and points (p, 3)."""
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, 3] = points
    return Estimate(camera, centres, poses)


def points_of(estimate: Estimate) -> FloatArray:
    """The points (p, 3) of an estimate."""
    return estimate.rig_from_board[:, :3, 3]


def linearized_rows(
    estimate: Estimate, observations: Observations, free: IntArray, *, view_rotations: bool = False
) -> Rows:
    """Linearise labels by the free intrinsics, the virtual centres, and rotations of the mirrors' views if asked for.

    A rotation of the image about the pupil makes a mirror's view that of a free camera: with the mirror's three
    parameters, these are the six of its pose.
    """
    mirrors, count = len(estimate.virtual_centres_in_rig_mm), len(observations)
    first = len(free)
    width = first + 3 * mirrors * (2 if view_rotations else 1)
    r, d_point = np.empty((count, 2)), np.empty((count, 2, 3))
    d_global = np.zeros((count, 2, width))
    points = points_of(estimate)
    for is_direct in (True, False):
        rows = np.flatnonzero((observations.view == DIRECT) == is_direct)
        in_rig = points[observations.frame[rows]].T
        view = observations.view[rows]
        arrays = None if is_direct else mirrors_of_views(estimate, view)
        linear = linearized(estimate.camera, np.zeros_like(in_rig), in_rig, arrays, bent=False)
        r[rows] = linear.pixels.T - observations.pixels[rows]
        d_point[rows] = linear.corner.transpose(2, 0, 1)
        d_global[rows, :, :first] = linear.intrinsics[:, free].transpose(2, 0, 1)
        if not is_direct:
            for axis in range(3):
                d_global[rows, :, first + 3 * view + axis] = linear.centre[:, axis].T
                if view_rotations:
                    d_global[rows, :, first + 3 * (mirrors + view) + axis] = linear.camera_rotation[:, axis].T
    per_sigma = 1.0 / observations.sigma_px
    return Rows(r * per_sigma[:, None], d_global * per_sigma[:, None, None], d_point * per_sigma[:, None, None])


def sums_by_point(values: FloatArray, observations: Observations) -> FloatArray:
    """Sums (p, ...) of values (n, ...) over the rows of each point, which all have rows."""
    return np.add.reduceat(values, np.flatnonzero(np.diff(observations.frame, prepend=-1)), axis=0)


def point_equations(rows: Rows, observations: Observations, prior: CameraPrior, camera: Camera) -> NormalEquations:
    """Sum the normal equations of rows; the prior is added to the leading intrinsics."""
    flat = rows.d_global.reshape(-1, rows.d_global.shape[2])
    u, gradient = flat.T @ flat, flat.T @ rows.r.ravel()
    free = slice(len(prior.free))
    if len(prior.free):
        u[free, free] += prior.information
        gradient[free] += prior.information @ prior.deviation(camera)
    transposed = rows.d_point.transpose(0, 2, 1)
    by_point = sums_by_point(transposed @ rows.d_point, observations)
    # A point that its labels see in one direction has an infinite variance, which must not end the fit.
    by_point += (SMALL * np.trace(by_point, axis1=1, axis2=2) + SMALL**3)[:, None, None] * np.eye(3)
    return NormalEquations(
        u,
        by_point,
        sums_by_point(transposed @ rows.d_global, observations),
        gradient,
        sums_by_point((transposed @ rows.r[:, :, None])[:, :, 0], observations),
    )


def scale_free_basis(centres: FloatArray, intrinsics: int) -> FloatArray:
    """Orthonormal basis (g, g - 1) of the parameters without a common scale of the virtual centres (m, 3)."""
    direction = np.concatenate([np.zeros(intrinsics), centres.ravel()])
    return np.asarray(null_space(direction[None]))


def in_basis(equations: NormalEquations, basis: FloatArray) -> NormalEquations:
    """Express the normal equations in a basis (g, h) of the global parameters."""
    return replace(
        equations,
        u=basis.T @ equations.u @ basis,
        w=equations.w @ basis,
        gradient_global=basis.T @ equations.gradient_global,
    )


def cost(estimate: Estimate, observations: Observations, prior: CameraPrior) -> float:
    """Sum of squares of the standardised residuals and of the prior; NaN where a point is not visible."""
    deviation = prior.deviation(estimate.camera)
    squares = np.sum(observations.standardised(residuals(estimate, observations, POINT)) ** 2)
    return float(squares + (deviation @ prior.information @ deviation if len(deviation) else 0.0))


def adjust(
    start: Estimate, observations: Observations, prior: CameraPrior, *, max_iterations: int = MAX_ITERATIONS
) -> tuple[Estimate, int]:
    """Minimise the cost from a start at which every label is visible; return the estimate and the iterations.

    Every point needs two labels; frames of the observations number the points.
    """
    estimate, damping, iterations = start, 1e-4, 0
    current = cost(estimate, observations, prior)
    while iterations < max_iterations and np.isfinite(current):
        iterations += 1
        rows = linearized_rows(estimate, observations, prior.free)
        basis = scale_free_basis(estimate.virtual_centres_in_rig_mm, len(prior.free))
        equations = in_basis(point_equations(rows, observations, prior, estimate.camera), basis)
        predicted = 0.0
        while damping < MAX_DAMPING:
            try:
                step, step_points, predicted = equations.step(damping)
                trial = _moved(estimate, prior.free, basis @ step, step_points)
                trial_cost = cost(trial, observations, prior)
            except (np.linalg.LinAlgError, InvalidValue):
                trial_cost = np.nan
            if trial_cost <= current:
                break
            damping *= 10.0
        else:
            break
        estimate, gain, current, damping = trial, current - trial_cost, trial_cost, max(damping / 10.0, 1e-12)
        if max(gain, predicted) <= MIN_RELATIVE_GAIN * current:
            break
    return estimate, iterations


def _moved(estimate: Estimate, free: IntArray, step: FloatArray, step_points: FloatArray) -> Estimate:
    intrinsics = estimate.camera.intrinsics.copy()
    intrinsics[free] += step[: len(free)]
    centres = estimate.virtual_centres_in_rig_mm + step[len(free) :].reshape(-1, 3)
    return points_estimate(estimate.camera.with_intrinsics(intrinsics), centres, points_of(estimate) + step_points)


@dataclass(frozen=True, eq=False)
class PointCovariance:
    """Covariance of a fit, before its scale is known.

    Attributes
    ----------
    of_global
        Covariance (g, g) of the free intrinsics and the virtual centres, at a constant sum of the centres' squares.
    by_global
        Change (p, 3, g) of each point with the global parameters.
    of_noise
        Covariance (p, 3, 3) of each point by the noise of its own labels alone.
    """

    of_global: FloatArray
    by_global: FloatArray
    of_noise: FloatArray


def covariance(estimate: Estimate, observations: Observations, prior: CameraPrior) -> PointCovariance:
    """Return the covariance at the minimum; raises UndeterminedError, naming the parameters, if there is none."""
    centres = estimate.virtual_centres_in_rig_mm
    rows = linearized_rows(estimate, observations, prior.free)
    equations = point_equations(rows, observations, prior, estimate.camera)
    basis = scale_free_basis(centres, len(prior.free))
    inverse = np.asarray(np.linalg.inv(equations.v))
    try:
        matrix, _ = in_basis(equations, basis).reduced(0.0)
    except np.linalg.LinAlgError:
        raise UndeterminedError("the labels do not determine a point") from None
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    if not values[0] > MIN_EIGENVALUE:
        raise UndeterminedError("the labels do not determine all mirrors")
    vectors = basis @ (vectors * scale[:, None])
    return PointCovariance((vectors / values) @ vectors.T, -inverse @ equations.w, inverse)
