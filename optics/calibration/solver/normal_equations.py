"""Normal equations of a calibration, summed over groups of corners of one frame and view.

A corner's pixels depend on the intrinsics, its mirror, the plate thickness, the board's modes and the pose of its
frame: some 20 parameters, where a dense row would have hundreds of columns. The products of each group are computed
separately and scattered into the matrix. The Schur complement then eliminates the poses and other per-frame parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import (
    Board,
    Estimate,
    LinearizedResiduals,
    linearized,
    mirrors_of_views,
    moved_since_middle_row,
    row_times,
    turned,
)
from mirrorcam.optics.geometry.mirror_imaging import images

ROWS_AT_ONCE = 4096
"""Corners linearised at once: few enough that their derivatives fit the processor's cache."""


@dataclass(frozen=True)
class Chunk:
    """Corners (n,) of complete groups (k,), all direct or all mirrored, with their pixels (2, n).

    `per_sigma` (n,) is the inverse of their standard deviations, which scales residuals and derivatives. `edges` (k +
    1,) are the groups' first rows within the chunk; `runs` are frames with their first and last row.
    """

    rows: slice
    corner: IntArray
    view: IntArray
    pixels: FloatArray
    per_sigma: FloatArray
    edges: list[int]
    runs: list[tuple[int, int, int]]
    group_frame: IntArray
    group_view: IntArray

    @classmethod
    def of(cls, observations: Observations, order: IntArray, bounds: IntArray) -> Chunk:
        """Collect the groups that start at `bounds` (k + 1,), whose last entry is their end, in a row order."""
        rows = slice(int(bounds[0]), int(bounds[-1]))
        selected = order[rows]
        frame, view = observations.frame[selected], observations.view[selected]
        firsts = np.flatnonzero(np.diff(frame, prepend=-1))
        lasts = np.append(firsts[1:], len(selected))
        starts = bounds[:-1] - bounds[0]
        return cls(
            rows,
            observations.corner[selected],
            view,
            np.ascontiguousarray(observations.pixels[selected].T),
            1.0 / observations.sigma_px[selected],
            [*starts.tolist(), len(selected)],
            list(zip(frame[firsts].tolist(), firsts.tolist(), lasts.tolist(), strict=True)),
            frame[starts],
            view[starts],
        )

    @property
    def direct(self) -> bool:
        return bool(self.group_view[0] == DIRECT)


@dataclass(frozen=True)
class Grouped:
    """Observations in groups of one frame and one view, direct views first; `order` (n,) holds their row numbers.

    `sum_per_variance` is the sum of the inverse variances of the corners.
    """

    order: IntArray
    chunks: list[Chunk]
    sum_per_variance: float

    @classmethod
    def of(cls, observations: Observations, model: Model) -> Grouped:
        order = np.lexsort((observations.view, observations.frame, observations.view != DIRECT))
        frame, view = observations.frame[order], observations.view[order]
        is_first = (np.diff(frame, prepend=-1) != 0) | (np.diff(view, prepend=DIRECT - 1) != 0)
        bounds = np.append(np.flatnonzero(is_first), len(order))
        direct = view[bounds[:-1]] == DIRECT
        at_once = ROWS_AT_ONCE // (1 + len(model.board.modes) // 16 + len(model.intrinsics) // 128)
        chunks, first = [], 0
        for group in range(1, len(bounds)):
            end = group == len(direct) or direct[group] != direct[first]
            if end or bounds[group + 1] - bounds[first] > at_once:
                chunks.append(Chunk.of(observations, order, bounds[first : group + 1]))
                first = group
        return cls(order, chunks, float(np.sum(observations.sigma_px**-2.0)))


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations with a block per frame: global parameters u (g, g), frames v (f, d, d), coupling w (f, d, g).

    The parameters of a frame are its pose and the model's `frame_terms`, with their priors.
    """

    u: FloatArray
    v: FloatArray
    w: FloatArray
    gradient_global: FloatArray
    gradient_poses: FloatArray

    def reduced(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Eliminate the frames; return the global matrix (g, g), and V^-1 [W, gradient] (f, d, g + 1).

        Every diagonal is increased by `damping` times itself. Raises LinAlgError if the pose of a frame is
        undetermined.
        """
        per_frame = self.v.shape[1]
        v = self.v + damping * self.v * np.eye(per_frame)
        solved = np.linalg.solve(v, np.concatenate([self.w, self.gradient_poses[:, :, None]], axis=2))
        flat = (per_frame * len(v), len(self.u))
        matrix = self.u - self.w.reshape(flat).T @ solved[:, :, :-1].reshape(flat)
        return matrix + damping * np.diag(np.diag(self.u)), solved

    def step(self, damping: float) -> tuple[FloatArray, FloatArray, float]:
        """Return the damped step of global parameters (g,) and frames (f, d), and the predicted decrease of the cost.

        Raises LinAlgError if the matrix is not positive definite.
        """
        matrix, solved = self.reduced(damping)
        rhs = self.gradient_global - np.einsum("fij,fi->j", self.w, solved[:, :, -1])
        step_global = -cho_solve(cho_factor(matrix), rhs) if rhs.size else rhs
        step_poses = -solved[:, :, -1] - solved[:, :, :-1] @ step_global
        squared = np.sum(np.diag(self.u) * step_global**2)
        squared += np.sum(np.einsum("fii->fi", self.v) * step_poses**2)
        directional = self.gradient_global @ step_global + np.sum(self.gradient_poses * step_poses)
        return step_global, step_poses, float(damping * squared - directional)


def normal_equations(
    estimate: Estimate, grouped: Grouped, model: Model, root_weights: FloatArray | None = None
) -> NormalEquations:
    """Build the normal equations; `root_weights` (n,) are the square roots of the weights, in the `grouped.order`."""
    index = ParameterIndices.of(model, len(estimate.virtual_centres_in_rig_mm))
    size, frames = index.size, len(estimate.rig_from_board)
    weights = model.frame_terms.weights
    per_frame = len(weights)
    u, w = np.zeros((size, size)), np.zeros((frames, per_frame, size))
    v = np.tile(np.diag(weights**2), (frames, 1, 1))
    gradient_global, gradient_poses = np.zeros(size), weights * model.frame_terms.values(estimate)
    corners = np.ascontiguousarray(model.board.shaped(estimate.shape).T)
    priors, free = model.intrinsic_priors(estimate.camera), slice(len(model.intrinsics))
    u[free, free] = np.diag(priors**2)
    gradient_global[free] = priors * model.intrinsic_values(estimate.camera)
    if (prior := model.prior_of_centres) is not None:
        direction = prior.coefficients.ravel()
        u[index.centres, index.centres] += np.outer(direction, direction)
        gradient_global[index.centres] += direction * prior.value(estimate.virtual_centres_in_rig_mm)
    for chunk in grouped.chunks:
        columns = columns_of(estimate, chunk, model, corners)
        if root_weights is not None:
            columns *= root_weights[chunk.rows]
        indices, last = index.of_groups(chunk.group_view), per_frame + 1
        edges = zip(chunk.edges[:-1], chunk.edges[1:], strict=True)
        for frame, of_group, (start, stop) in zip(chunk.group_frame.tolist(), indices, edges, strict=True):
            group = columns[:, :, start:stop]
            # The controls of a spline that are far from a view have no effect on it.
            used = np.flatnonzero(group[last:].any(axis=(1, 2)))
            if len(used) < len(of_group):
                group = np.concatenate([group[:last], group[last:][used]])
            x, y = group[:, 0], group[:, 1]
            total, at = x @ x.T + y @ y.T, of_group[used]
            v[frame] += total[:per_frame, :per_frame]
            gradient_poses[frame] += total[:per_frame, per_frame]
            w[frame][:, at] += total[:per_frame, last:]
            u[np.ix_(at, at)] += total[last:, last:]
            gradient_global[at] += total[last:, per_frame]
    return NormalEquations(u, v, w, gradient_global, gradient_poses)


@dataclass(frozen=True)
class ParameterIndices:
    """Indices of a group's columns among the free global parameters."""

    intrinsics: int
    mirrors: int
    numbers_per_mirror: tuple[int, ...]
    rest: int

    @classmethod
    def of(cls, model: Model, mirrors: int) -> ParameterIndices:
        return cls(
            len(model.intrinsics),
            mirrors,
            (3,) * (model.mirrors + model.curvature),
            int(model.thickness) + len(model.board.modes),
        )

    @property
    def size(self) -> int:
        return self.intrinsics + self.mirrors * sum(self.numbers_per_mirror) + self.rest

    @property
    def centres(self) -> slice:
        """Slice of the virtual centres, if they are free."""
        return slice(self.intrinsics, self.intrinsics + 3 * self.mirrors)

    def of_groups(self, view: IntArray) -> IntArray:
        """Indices (k, c) of the columns of groups with views (k,), all direct or all mirrored."""
        shared = [np.arange(self.intrinsics), np.arange(self.size - self.rest, self.size)]
        first, last = (np.broadcast_to(part, (len(view), len(part))) for part in shared)
        if view[0] == DIRECT:
            return np.concatenate([first, last], axis=1)
        starts = self.intrinsics + 3 * self.mirrors * np.arange(len(self.numbers_per_mirror))
        mirror_columns = starts[:, None] + 3 * view[:, None, None] + np.arange(3)
        return np.concatenate([first, mirror_columns.reshape(len(view), -1), last], axis=1)


def columns_of(estimate: Estimate, chunk: Chunk, model: Model, corners: FloatArray) -> FloatArray:
    """Columns (c, 2, n) of a chunk's standardised pixels: derivatives with respect to the frame's parameters, the
    residual, and derivatives with respect to the free global parameters.

    The latter are the intrinsics, the mirror's centre and curvature (unless direct), the plate thickness, and the
    modes.
    """
    moved = _moved_since_middle_row(estimate, chunk)
    about_origin, in_rig = _in_rig(estimate, chunk, corners, model.board, moved)
    mirrors = None if chunk.direct else mirrors_of_views(estimate, chunk.view)
    linear = linearized(
        estimate.camera,
        about_origin,
        in_rig,
        mirrors,
        bent=model.curvature,
        row_time=row_times(estimate.camera, chunk.pixels[1]),
        camera_from_rig=_camera_from_rig(estimate, chunk),
        board_turn=None if moved is None else moved[0],
    )
    parts = [linear.board_rotation, linear.corner]
    if model.frame_terms.rotation_per_rad is not None:
        parts.append(linear.camera_rotation)
    if model.frame_terms.bow_per_mm is not None:
        parts.append(_d_board(linear, estimate, chunk)[:, None, 2] * model.board.bows[:, chunk.corner])
    if model.frame_terms.has_motion:
        parts.append(linear.motion)
    parts.append((linear.pixels - chunk.pixels)[:, None])
    parts.append(linear.intrinsics[:, _selected(estimate.camera.intrinsic_names, model.intrinsics)])
    if mirrors is not None:
        parts += [linear.centre] * model.mirrors + [linear.curvature] * model.curvature
    if model.thickness:
        plate = np.zeros_like(linear.pixels)
        if mirrors is not None:
            plate = np.where(mirrors.thickness_mm > 0, linear.thickness, 0.0)
        parts.append(plate[:, None])
    if len(model.board.modes):
        parts.append(_d_modes(linear, estimate, chunk, model.board.modes[:, chunk.corner]))
    columns = np.empty((sum(part.shape[1] for part in parts), 2, len(chunk.view)))
    start = 0
    for part in parts:
        columns[start : start + part.shape[1]] = part.transpose(1, 0, 2)
        start += part.shape[1]
    columns *= chunk.per_sigma
    return columns


def _selected(names: Sequence[str], free: Sequence[str]) -> list[bool] | slice:
    """Index of the free names; a slice, which copies nothing, if all are free."""
    return slice(None) if tuple(names) == tuple(free) else [name in free for name in names]


def _in_rig(
    estimate: Estimate, chunk: Chunk, corners: FloatArray, board: Board, moved: tuple[FloatArray, FloatArray] | None
) -> tuple[FloatArray, FloatArray]:
    """Transform board corners (3, c) to a chunk's rows (3, n): about the board's origin in rig axes, and in the rig.

    `moved` are the turns and shifts of `_moved_since_middle_row`.
    """
    in_board = corners[:, chunk.corner]
    if estimate.bow_mm.any():
        for frame, first, last in chunk.runs:
            in_board[2, first:last] += estimate.bow_mm[frame] @ board.bows[:, chunk.corner[first:last]]
    about_origin, in_rig = np.empty_like(in_board), np.empty_like(in_board)
    for frame, first, last in chunk.runs:
        pose = estimate.rig_from_board[frame]
        np.matmul(pose[:3, :3], in_board[:, first:last], out=about_origin[:, first:last])
        np.add(about_origin[:, first:last], pose[:3, 3:], out=in_rig[:, first:last])
    if moved is not None:
        turn, shift = moved
        in_rig += turned(about_origin, turn) - about_origin + shift
    return about_origin, in_rig


def _camera_from_rig(estimate: Estimate, chunk: Chunk) -> FloatArray | None:
    """Rotations (3, 3, n) of the camera at the chunk's corners; None if it is not rotated in any frame."""
    if not estimate.camera_rotation.any():
        return None
    rotations = Rotation.from_rotvec(estimate.camera_rotation).as_matrix()
    counts = [last - first for _, first, last in chunk.runs]
    return np.repeat(rotations[[frame for frame, _, _ in chunk.runs]], counts, axis=0).transpose(1, 2, 0)


def _moved_since_middle_row(estimate: Estimate, chunk: Chunk) -> tuple[FloatArray, FloatArray] | None:
    """Turns and shifts of the boards at a chunk's rows (`moved_since_middle_row`); None if all boards rest."""
    if not estimate.motion.any():
        return None
    counts = [last - first for _, first, last in chunk.runs]
    motion = np.repeat(estimate.motion[[frame for frame, _, _ in chunk.runs]], counts, axis=0)
    return moved_since_middle_row(motion.T, row_times(estimate.camera, chunk.pixels[1]))


def _d_modes(linear: LinearizedResiduals, estimate: Estimate, chunk: Chunk, modes: FloatArray) -> FloatArray:
    """Derivatives (2, k, n) with respect to the modes, given the modes (k, n, 3) at the corners."""
    d_board = _d_board(linear, estimate, chunk)
    return np.asarray(sum(d_board[:, None, axis] * modes[None, :, :, axis] for axis in range(3)))


def _d_board(linear: LinearizedResiduals, estimate: Estimate, chunk: Chunk) -> FloatArray:
    """Derivatives (2, 3, n) with respect to the corners in the board frame."""
    d_board = np.empty_like(linear.corner_on_board)
    for frame, first, last in chunk.runs:
        d_board[:, :, first:last] = estimate.rig_from_board[frame, :3, :3].T @ linear.corner_on_board[:, :, first:last]
    return d_board


def residuals_of(estimate: Estimate, grouped: Grouped, model: Model) -> FloatArray:
    """Standardised residuals (2, n) of the rows in `grouped.order`; NaN if a corner is not visible.

    They are predicted minus observed pixels, in standard deviations of the corners.
    """
    r = np.empty((2, len(grouped.order)))
    corners = np.ascontiguousarray(model.board.shaped(estimate.shape).T)
    for chunk in grouped.chunks:
        _, points = _in_rig(estimate, chunk, corners, model.board, _moved_since_middle_row(estimate, chunk))
        if not chunk.direct:
            points = images(points, mirrors_of_views(estimate, chunk.view)).image_mm
        camera_from_rig = _camera_from_rig(estimate, chunk)
        if camera_from_rig is not None:
            points = np.einsum("ijn,jn->in", camera_from_rig, points)
        r[:, chunk.rows] = (estimate.camera.project(points.T).T - chunk.pixels) * chunk.per_sigma
    return r
