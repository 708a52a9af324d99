"""Estimation of mirrors from matched points: a robust bundle adjustment with the calibration as prior.

The unknowns are the changes of the calibrated parameters, the direction and inverse distance of each point, and for
each frame a twist, the motion of the scene relative to the camera during the row-by-row readout. The Schur complement
eliminates the points and leaves a quadratic form in the changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, global_names, residuals_with_jacobians
from mirrorcam.optics.drift.matched_points import IntArray, MatchedPoints
from mirrorcam.optics.geometry.layout import Layout

STEPS = 8
CONVERGED_PX = 1e-3
MAX_DISTANCE_MM = 1e6
LOSS_SIGMAS = 4.0
"""Scale of Geman and McClure's loss, in standard deviations; larger residuals have little weight."""
MIN_SIGMA_PX = 0.02
"""Minimum standard deviation of a match, due to interpolation and slanted surfaces."""
TWIST_SIZE, TWIST_SIGMA = 6, 0.05
"""Components of the scene's twist during readout: rotation, rad, and shift / TWIST_LENGTH_MM; standard deviation."""
TWIST_LENGTH_MM = 400.0


@dataclass(frozen=True)
class SceneInformation:
    """The quadratic form d'Hd - 2h'd of changes d of the parameters (g,), near the best fit.

    Attributes
    ----------
    names
        Names (g,) of the parameters: the camera's, then x, y and z of each mirror's virtual centre, then others.
    information
        H (g, g), for independent errors.
    gradient
        h (g,).
    scatter
        Sum (g, g) of the outer products of the cells' contributions to h.
    sigma_px
        Standard deviation of a match, per axis.
    point_counts
        Number (m,) of points that each mirror shows.
    frames, points
        Number of frames and points.
    """

    names: tuple[str, ...]
    information: FloatArray
    gradient: FloatArray
    scatter: FloatArray
    sigma_px: float
    point_counts: IntArray
    frames: int
    points: int


@dataclass(frozen=True)
class _State:
    """Changes (g,), twists (f, 6), and the points' unit rays (p, 3) and inverse distances (p,) from an origin (3,)."""

    change: FloatArray
    twist: FloatArray
    ray: FloatArray
    inverse_distance_per_mm: FloatArray
    origin: FloatArray

    @property
    def points(self) -> FloatArray:
        return self.origin + self.ray / self.inverse_distance_per_mm[:, None]


@dataclass(frozen=True)
class _Linearized:
    """Residuals (n, 2), derivatives with respect to changes and twists (n, 2, g + 6 f), and to the point (n, 2, 3).

    For a point behind its mirror, the residual is NaN and the derivatives are 0.
    """

    residual: FloatArray
    d_shared: FloatArray
    d_point: FloatArray


class SceneFit:
    """A fit of one layout to matched points, under a prior covariance (g, g) of the changes of `names`."""

    def __init__(self, layout: Layout, matches: MatchedPoints, prior: FloatArray) -> None:
        self.layout, self.matches, self.prior = layout, matches, prior
        self.all_names = global_names(layout.camera.intrinsic_names, len(layout.mirrors), 0)
        self.names = parameter_names(layout)
        self.columns = np.array([self.all_names.index(name) for name in self.names])
        self.frames = int(matches.frame.max()) + 1
        self.height_px = layout.camera.height_px

    def solve(self) -> SceneInformation:
        """Fit by iteratively reweighted Gauss-Newton steps."""
        state = self._start()
        for _ in range(STEPS):
            linear = self._linearized(state)
            _, weight = self._weights(linear.residual)
            state, shift_px = self._step(state, linear, weight)
            if shift_px < CONVERGED_PX:
                break
        return self._information(state)

    def _start(self) -> _State:
        """Initial points, each nearest to its rays in all views by least squares."""
        matches, layout = self.matches, self.layout
        rays = layout.camera.unproject(matches.pixels)
        start, direction = np.empty_like(rays), np.empty_like(rays)
        for view, mirror in enumerate(layout.mirrors):
            rows = matches.view == view
            start[rows] = mirror.apparent.virtual_centre_in_rig_mm
            direction[rows] = rays[rows] @ mirror.reflection
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        projection = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        count = len(matches.frame)
        normal, rhs = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(normal, matches.point, projection)
        np.add.at(rhs, matches.point, np.einsum("nij,nj->ni", projection, start))
        points = np.linalg.solve(normal + 1e-12 * np.eye(3), rhs[..., None])[..., 0]
        first = np.unique(matches.point, return_index=True)[1]
        origin = start.mean(axis=0)
        from_origin = points - origin
        distance = np.einsum("ni,ni->n", from_origin, direction[first])
        distance = np.where(distance > 1.0, np.minimum(distance, MAX_DISTANCE_MM), MAX_DISTANCE_MM)
        ray = np.where((distance < MAX_DISTANCE_MM)[:, None], from_origin, direction[first])
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        return _State(np.zeros(len(self.names)), np.zeros((self.frames, TWIST_SIZE)), ray, 1.0 / distance, origin)

    def _linearized(self, state: _State) -> _Linearized:
        matches, points = self.matches, state.points
        estimate = _changed(self.layout, self.all_names, self.columns, state.change)
        time = (matches.pixels[:, 1] / self.height_px - 0.5)[:, None]
        point, twist = points[matches.point], state.twist[matches.frame[matches.point]]
        scale = 1.0 / state.inverse_distance_per_mm[matches.point, None]
        displaced = point + time * (np.cross(twist[:, :3], point) + twist[:, 3:] * TWIST_LENGTH_MM)
        count = len(displaced)
        observations = Observations(np.zeros(count, np.int64), matches.view, np.arange(count), matches.pixels)
        residual, d_global, d_frame = residuals_with_jacobians(estimate, observations, Board.rigid(displaced))
        d_displaced = d_frame[:, :, 3:6]
        d_shared = np.zeros((count, 2, len(self.columns) + TWIST_SIZE * self.frames))
        d_shared[:, :, : len(self.columns)] = d_global[:, :, self.columns]
        d_rotation = np.cross(point[:, None, :], d_displaced)
        d_twist = time[:, :, None] * np.concatenate([d_rotation, TWIST_LENGTH_MM * d_displaced], axis=2)
        columns = len(self.columns) + TWIST_SIZE * matches.frame[matches.point][:, None] + np.arange(TWIST_SIZE)
        np.put_along_axis(d_shared, np.broadcast_to(columns[:, None, :], (count, 2, TWIST_SIZE)), d_twist, axis=2)
        basis = _basis(state.ray)[matches.point] * np.stack([scale, scale, -scale], axis=1)
        d_point = np.einsum("nij,nkj->nik", d_displaced, basis)
        invalid = ~(np.isfinite(residual).all(axis=1) & np.isfinite(d_shared).all(axis=(1, 2)))
        residual[invalid], d_shared[invalid], d_point[invalid] = np.nan, 0.0, 0.0
        return _Linearized(residual, d_shared, d_point)

    def _weights(self, residual: FloatArray) -> tuple[float, FloatArray]:
        """Standard deviation of a match per axis, and weights (n,) of the observations by each view's scatter."""
        matches = self.matches
        invalid = np.isnan(residual[:, 0])
        squares = np.where(invalid, 1e6, (residual**2).sum(axis=1))
        views = np.bincount(matches.point, minlength=len(matches.frame))[matches.point]
        # Each point takes three degrees of freedom.
        unbiased = squares * 2.0 * views / np.maximum(2.0 * views - 3.0, 1.0)
        overall = _sigma(unbiased)
        sigma = np.full(len(residual), overall)
        for view in np.unique(matches.view):
            rows = matches.view == view
            sigma[rows] = max(_sigma(unbiased[rows]), 0.7 * overall)
        return overall, np.where(invalid, 0.0, 1.0 / (sigma * (1.0 + squares / (LOSS_SIGMAS * sigma) ** 2)) ** 2)

    def _reduced(self, linear: _Linearized, weight: FloatArray) -> tuple[FloatArray, ...]:
        """The Schur complement: H, each point's contribution to the gradient, and factors that recover the points."""
        matches, count, residual = self.matches, len(self.matches.frame), np.nan_to_num(linear.residual)
        weighted = linear.d_point * weight[:, None, None]
        hessians, cross = np.zeros((count, 3, 3)), np.zeros((count, 3, linear.d_shared.shape[2]))
        np.add.at(hessians, matches.point, np.einsum("nki,nkj->nij", weighted, linear.d_point))
        np.add.at(cross, matches.point, np.einsum("nki,nkg->nig", weighted, linear.d_shared))
        rhs = np.zeros((count, 3))
        np.add.at(rhs, matches.point, np.einsum("nki,nk->ni", weighted, residual))
        hessians += 1e-9 * np.trace(hessians, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-30 * np.eye(3)
        eliminated = np.linalg.solve(hessians, np.concatenate([cross, rhs[..., None]], axis=2))
        jacobian = linear.d_shared.reshape(-1, linear.d_shared.shape[2])
        whitened = jacobian * np.repeat(np.sqrt(weight), 2)[:, None]
        information = whitened.T @ whitened - np.einsum("pig,pih->gh", cross, eliminated[:, :, :-1], optimize=True)
        gradients = np.zeros((count, jacobian.shape[1]))
        np.add.at(gradients, matches.point, np.einsum("nkg,nk,n->ng", linear.d_shared, residual, weight))
        gradients -= np.einsum("pig,pi->pg", eliminated[:, :, :-1], rhs)
        return (information + information.T) / 2.0, gradients, eliminated

    def _step(self, state: _State, linear: _Linearized, weight: FloatArray) -> tuple[_State, float]:
        """The state after a Gauss-Newton step, and the 90th percentile of the pixels' shifts."""
        count = len(self.columns)
        information, gradients, eliminated = self._reduced(linear, weight)
        prior = np.zeros_like(information)
        prior[:count, :count] = self.prior
        prior[count:, count:] = TWIST_SIGMA**2 * np.eye(len(prior) - count)
        old = np.concatenate([state.change, state.twist.ravel()])
        rhs = information @ old - gradients.sum(axis=0)
        new = prior @ np.linalg.solve(np.eye(len(prior)) + information @ prior, rhs)
        step = new - old
        point_step = -eliminated[:, :, -1] - eliminated[:, :, :-1] @ step
        shift = linear.d_shared @ step + np.einsum("nij,nj->ni", linear.d_point, point_step[self.matches.point])
        basis = _basis(state.ray)
        ray = state.ray + np.einsum("pi,pij->pj", np.clip(point_step[:, :2], -0.1, 0.1), basis[:, :2])
        inverse_distance = state.inverse_distance_per_mm * np.exp(np.clip(point_step[:, 2], -0.5, 0.5))
        updated = replace(
            state,
            change=new[:count],
            twist=new[count:].reshape(-1, TWIST_SIZE),
            ray=ray / np.linalg.norm(ray, axis=1, keepdims=True),
            inverse_distance_per_mm=np.clip(inverse_distance, 1.0 / MAX_DISTANCE_MM, 1.0),
        )
        return updated, float(np.quantile(np.linalg.norm(shift, axis=1), 0.9))

    def _information(self, state: _State) -> SceneInformation:
        linear, count = self._linearized(state), len(self.columns)
        sigma, weight = self._weights(linear.residual)
        information, gradients, _ = self._reduced(linear, weight)
        twist = information[count:, count:] + np.eye(len(information) - count) / TWIST_SIGMA**2
        eliminated = np.linalg.solve(twist, information[count:, :count])
        reduced = information[:count, :count] - information[:count, count:] @ eliminated
        point_gradients = gradients[:, :count] - gradients[:, count:] @ eliminated
        gradient = point_gradients.sum(axis=0) - eliminated.T @ (state.twist.ravel() / TWIST_SIGMA**2)
        cells = np.unique(self.matches.cell)
        sums = np.stack([point_gradients[self.matches.cell == cell].sum(axis=0) for cell in cells])
        sums -= sums.mean(axis=0)
        return SceneInformation(
            names=self.names,
            information=reduced,
            gradient=reduced @ state.change - gradient,
            scatter=sums.T @ sums * (len(cells) / max(len(cells) - 1, 1)),
            sigma_px=sigma,
            point_counts=np.bincount(self.matches.view, minlength=len(self.layout.mirrors)),
            frames=len(np.unique(self.matches.frame)),
            points=len(self.matches.frame),
        )


def parameter_names(layout: Layout) -> tuple[str, ...]:
    """The parameters whose changes are estimated: the lens, the mirrors, and others that were calibrated."""
    names = global_names(layout.camera.intrinsic_names, len(layout.mirrors), 0)
    calibrated = () if layout.uncertainty is None else layout.uncertainty.parameters
    return tuple(
        name
        for name in names
        if name in layout.camera.intrinsic_names
        or name in calibrated
        or (name.startswith("mirror ") and name.endswith("_mm"))
    )


def _changed(layout: Layout, names: tuple[str, ...], columns: IntArray, change: FloatArray) -> Estimate:
    """The layout's camera and mirrors with changed parameters."""
    step = np.zeros(len(names))
    step[columns] = change
    return Estimate.of(layout.camera, layout.mirrors, np.eye(4)[None]).moved(step, np.zeros((1, 12)))


def _basis(ray: FloatArray) -> FloatArray:
    """Orthonormal bases (p, 3, 3): two vectors normal to each unit ray (p, 3), then the ray."""
    auxiliary = np.where(np.abs(ray[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(ray, auxiliary)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(ray, first), ray], axis=1)


def _sigma(squares: FloatArray) -> float:
    """Robust standard deviation per axis of two-dimensional normal errors, from the median of their squared lengths."""
    return max(float(np.sqrt(np.median(squares) / (2.0 * np.log(2.0)))), MIN_SIGMA_PX)
