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
STEADY_PX = 1e-3
MAX_DISTANCE_MM = 1e6
LOSS_SIGMAS = 4.0
"""Scale of Geman and McClure's loss in standard deviations; larger residuals have little weight."""
MIN_SIGMA_PX = 0.02
"""Lower limit of the standard deviation of a match, due to interpolation and slanted surfaces."""
SPEED = 0.05
"""Standard deviation of the scene's rotation, rad, and relative shift during the readout of a frame."""
TWIST = 6


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
    seen
        Number (m,) of points that each mirror shows.
    frames, points
        Number of frames and points.
    """

    names: tuple[str, ...]
    information: FloatArray
    gradient: FloatArray
    scatter: FloatArray
    sigma_px: float
    seen: IntArray
    frames: int
    points: int


@dataclass(frozen=True)
class _State:
    """Estimates of the changes (g,), the twists (f, 6), and the points' unit rays (p, 3) and inverse distances (p,)."""

    change: FloatArray
    twist: FloatArray
    ray: FloatArray
    inverse_mm: FloatArray
    origin: FloatArray

    @property
    def points(self) -> FloatArray:
        return self.origin + self.ray / self.inverse_mm[:, None]


@dataclass(frozen=True)
class _Linear:
    """Residuals (n, 2), derivatives by the changes and twists (n, 2, g + 6 f) and by the observed point (n, 2, 3).

    For a point behind its mirror, the residual is NaN and the derivatives are 0.
    """

    residual: FloatArray
    by_shared: FloatArray
    by_point: FloatArray


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
            linear = self._linear(state)
            _, weight = self._weights(linear.residual)
            state, moved = self._step(state, linear, weight)
            if moved < STEADY_PX:
                break
        return self._information(state)

    def _start(self) -> _State:
        """Initial points, nearest to the rays of all views."""
        m, layout = self.matches, self.layout
        rays = layout.camera.unproject(m.pixels)
        start, turn = np.empty_like(rays), np.empty_like(rays)
        for view, mirror in enumerate(layout.mirrors):
            rows = m.view == view
            start[rows] = mirror.apparent.virtual_centre_in_rig_mm
            turn[rows] = rays[rows] @ mirror.reflection
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        across = np.eye(3) - turn[:, :, None] * turn[:, None, :]
        count = len(m.frame)
        normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(normal, m.point, across)
        np.add.at(right, m.point, np.einsum("nij,nj->ni", across, start))
        points = np.linalg.solve(normal + 1e-12 * np.eye(3), right[..., None])[..., 0]
        first = np.unique(m.point, return_index=True)[1]
        origin = start.mean(axis=0)
        off = points - origin
        distance = np.einsum("ni,ni->n", off, turn[first])
        distance = np.where(distance > 1.0, np.minimum(distance, MAX_DISTANCE_MM), MAX_DISTANCE_MM)
        ray = np.where((distance < MAX_DISTANCE_MM)[:, None], off, turn[first])
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        return _State(np.zeros(len(self.names)), np.zeros((self.frames, TWIST)), ray, 1.0 / distance, origin)

    def _linear(self, state: _State) -> _Linear:
        m, points = self.matches, state.points
        moved = _changed(self.layout, self.all_names, self.columns, state.change)
        when = (m.pixels[:, 1] / self.height_px - 0.5)[:, None]
        at, twist = points[m.point], state.twist[m.frame[m.point]]
        scale = 1.0 / state.inverse_mm[m.point, None]
        seen = at + when * (np.cross(twist[:, :3], at) + twist[:, 3:] * MEAN_MM)
        count = len(seen)
        rows = Observations(np.zeros(count, np.int64), m.view, np.arange(count), m.pixels)
        residual, by_global, by_frame = residuals_with_jacobians(moved, rows, Board.rigid(seen))
        by_seen = by_frame[:, :, 3:6]
        by_shared = np.zeros((count, 2, len(self.columns) + TWIST * self.frames))
        by_shared[:, :, : len(self.columns)] = by_global[:, :, self.columns]
        turned = np.cross(at[:, None, :], by_seen)
        by_twist = when[:, :, None] * np.concatenate([turned, MEAN_MM * by_seen], axis=2)
        place = len(self.columns) + TWIST * m.frame[m.point][:, None] + np.arange(TWIST)
        np.put_along_axis(by_shared, np.broadcast_to(place[:, None, :], (count, 2, TWIST)), by_twist, axis=2)
        basis = _basis(state.ray)[m.point] * np.stack([scale, scale, -scale], axis=1)
        by_point = np.einsum("nij,nkj->nik", by_seen, basis)
        lost = ~(np.isfinite(residual).all(axis=1) & np.isfinite(by_shared).all(axis=(1, 2)))
        residual[lost], by_shared[lost], by_point[lost] = np.nan, 0.0, 0.0
        return _Linear(residual, by_shared, by_point)

    def _weights(self, residual: FloatArray) -> tuple[float, FloatArray]:
        """Standard deviation of a match per axis, and weights (n,) of the observations by each view's scatter."""
        m = self.matches
        lost = np.isnan(residual[:, 0])
        squares = np.where(lost, 1e6, (residual**2).sum(axis=1))
        seen = np.bincount(m.point, minlength=len(m.frame))[m.point]
        spared = squares * 2.0 * seen / np.maximum(2.0 * seen - 3.0, 1.0)
        overall = _sigma(spared)
        sigma = np.full(len(residual), overall)
        for view in np.unique(m.view):
            rows = m.view == view
            sigma[rows] = max(_sigma(spared[rows]), 0.7 * overall)
        return overall, np.where(lost, 0.0, 1.0 / (sigma * (1.0 + squares / (LOSS_SIGMAS * sigma) ** 2)) ** 2)

    def _reduced(self, linear: _Linear, weight: FloatArray) -> tuple[FloatArray, ...]:
        """The Schur complement: H, each point's contribution to the gradient, and factors that recover the points."""
        m, count, residual = self.matches, len(self.matches.frame), np.nan_to_num(linear.residual)
        weighted = linear.by_point * weight[:, None, None]
        own, cross = np.zeros((count, 3, 3)), np.zeros((count, 3, linear.by_shared.shape[2]))
        np.add.at(own, m.point, np.einsum("nki,nkj->nij", weighted, linear.by_point))
        np.add.at(cross, m.point, np.einsum("nki,nkg->nig", weighted, linear.by_shared))
        right = np.zeros((count, 3))
        np.add.at(right, m.point, np.einsum("nki,nk->ni", weighted, residual))
        own += 1e-9 * np.trace(own, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-30 * np.eye(3)
        follows = np.linalg.solve(own, np.concatenate([cross, right[..., None]], axis=2))
        by = linear.by_shared.reshape(-1, linear.by_shared.shape[2])
        rooted = by * np.repeat(np.sqrt(weight), 2)[:, None]
        information = rooted.T @ rooted - np.einsum("pig,pih->gh", cross, follows[:, :, :-1], optimize=True)
        gradients = np.zeros((count, by.shape[1]))
        np.add.at(gradients, m.point, np.einsum("nkg,nk,n->ng", linear.by_shared, residual, weight))
        gradients -= np.einsum("pig,pi->pg", follows[:, :, :-1], right)
        return (information + information.T) / 2.0, gradients, follows

    def _step(self, state: _State, linear: _Linear, weight: FloatArray) -> tuple[_State, float]:
        """A Gauss-Newton step, and the 90th percentile of its shifts of pixels."""
        known = len(self.columns)
        information, gradients, follows = self._reduced(linear, weight)
        prior = np.zeros_like(information)
        prior[:known, :known] = self.prior
        prior[known:, known:] = SPEED**2 * np.eye(len(prior) - known)
        at = np.concatenate([state.change, state.twist.ravel()])
        wanted = information @ at - gradients.sum(axis=0)
        new = prior @ np.linalg.solve(np.eye(len(prior)) + information @ prior, wanted)
        step = new - at
        own = -follows[:, :, -1] - follows[:, :, :-1] @ step
        shift = linear.by_shared @ step + np.einsum("nij,nj->ni", linear.by_point, own[self.matches.point])
        basis = _basis(state.ray)
        ray = state.ray + np.einsum("pi,pij->pj", np.clip(own[:, :2], -0.1, 0.1), basis[:, :2])
        inverse = state.inverse_mm * np.exp(np.clip(own[:, 2], -0.5, 0.5))
        moved = replace(
            state,
            change=new[:known],
            twist=new[known:].reshape(-1, TWIST),
            ray=ray / np.linalg.norm(ray, axis=1, keepdims=True),
            inverse_mm=np.clip(inverse, 1.0 / MAX_DISTANCE_MM, 1.0),
        )
        return moved, float(np.quantile(np.linalg.norm(shift, axis=1), 0.9))

    def _information(self, state: _State) -> SceneInformation:
        linear, known = self._linear(state), len(self.columns)
        sigma, weight = self._weights(linear.residual)
        information, gradients, _ = self._reduced(linear, weight)
        twist = information[known:, known:] + np.eye(len(information) - known) / SPEED**2
        follows = np.linalg.solve(twist, information[known:, :known])
        rest = information[:known, :known] - information[:known, known:] @ follows
        own = gradients[:, :known] - gradients[:, known:] @ follows
        pull = own.sum(axis=0) - follows.T @ (state.twist.ravel() / SPEED**2)
        cells = np.unique(self.matches.cell)
        sums = np.stack([own[self.matches.cell == cell].sum(axis=0) for cell in cells])
        sums -= sums.mean(axis=0)
        return SceneInformation(
            names=self.names,
            information=rest,
            gradient=rest @ state.change - pull,
            scatter=sums.T @ sums * (len(cells) / max(len(cells) - 1, 1)),
            sigma_px=sigma,
            seen=np.bincount(self.matches.view, minlength=len(self.layout.mirrors)),
            frames=len(np.unique(self.matches.frame)),
            points=len(self.matches.frame),
        )


MEAN_MM = 400.0
"""Unit length of the scene's shift during the readout of a frame."""


def parameter_names(layout: Layout) -> tuple[str, ...]:
    """The parameters whose changes are estimated: the lens, the mirrors, and others that were calibrated."""
    every = global_names(layout.camera.intrinsic_names, len(layout.mirrors), 0)
    known = () if layout.uncertainty is None else layout.uncertainty.parameters
    return tuple(
        name
        for name in every
        if name in layout.camera.intrinsic_names
        or name in known
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
