"""The solver's least-squares problem for `scipy.optimize.least_squares`, with its derivatives."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.normal_equations import Grouped, ParameterIndices, columns_of, residuals_of
from mirrorcam.optics.calibration.solver.observations import IntArray, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Estimate, global_names


class Peer:
    """Residuals (2 n,) and their derivatives as functions of x: steps of the free globals and twists from `start`."""

    def __init__(self, start: Estimate, observations: Observations, model: Model) -> None:
        self.start, self.observations, self.model = start, observations, model
        self.grouped = Grouped.of(observations, model)
        mirrors = len(start.virtual_centres_in_rig_mm)
        self.free = model.free(start.camera, mirrors)
        self.size = len(global_names(start.camera.intrinsic_names, mirrors, start.shape.size))
        self.index = ParameterIndices.of(model, mirrors)
        self.x0 = np.zeros(len(self.free) + 6 * len(start.rig_from_board))

    def estimate(self, x: FloatArray) -> Estimate:
        step = np.zeros(self.size)
        step[self.free] = x[: len(self.free)]
        return self.start.moved(step, x[len(self.free) :].reshape(-1, 6))

    def residuals(self, x: FloatArray) -> FloatArray:
        return residuals_of(self.estimate(x), self.grouped, self.model).ravel()

    @cached_property
    def _structure(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return the sparse structure of the derivatives: their order in the chunks, columns and row ends."""
        rows, columns = [], []
        n = len(self.grouped.order)
        for chunk in self.grouped.chunks:
            at = np.repeat(self.index.of_groups(chunk.group_view), np.diff(chunk.edges), axis=0)
            frame = np.repeat(chunk.group_frame, np.diff(chunk.edges))
            pose = len(self.free) + 6 * frame[:, None] + np.arange(6)
            own = np.concatenate([pose, at], axis=1)
            for axis in (0, 1):
                row = axis * n + np.arange(chunk.rows.start, chunk.rows.stop)
                rows.append(np.repeat(row, own.shape[1]))
                columns.append(own.ravel())
        row, column = np.concatenate(rows), np.concatenate(columns)
        order = np.lexsort((column, row))
        ends = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=2 * n))])
        return order.astype(np.int64), column[order].astype(np.int64), ends.astype(np.int64)

    def sparse(self, x: FloatArray) -> csr_array:
        """Derivatives (2 n, g + 6 f)."""
        estimate = self.estimate(x)
        corners = np.ascontiguousarray(self.model.board.shaped(estimate.shape).T)
        turns = left_jacobians(x[len(self.free) :].reshape(-1, 6)[:, :3])
        data = []
        for chunk in self.grouped.chunks:
            columns = columns_of(estimate, chunk, self.model, corners)
            for frame, first, last in chunk.runs:
                columns[:3, :, first:last] = np.einsum("ji,jan->ian", turns[frame], columns[:3, :, first:last])
            wanted = np.delete(columns, 6, axis=0)
            data += [wanted[:, axis].T.ravel() for axis in (0, 1)]
        order, column, ends = self._structure
        return csr_array((np.concatenate(data)[order], column, ends), shape=(len(ends) - 1, len(self.x0)))

    def dense(self, x: FloatArray) -> FloatArray:
        return np.asarray(self.sparse(x).toarray())


def left_jacobians(turns: FloatArray) -> FloatArray:
    """Return the left Jacobians (f, 3, 3) of rotation vectors w (f, 3): rotation of exp(w) per change of w.

    I + (1 - cos a) / a^2 [w] + (a - sin a) / a^3 [w]^2, a = |w|: Chirikjian, Stochastic Models 2 (2012), eq. 10.86.
    """
    angle = np.maximum(np.linalg.norm(turns, axis=1), 1e-6)[:, None, None]
    skew = np.zeros((len(turns), 3, 3))
    skew[:, [2, 0, 1], [1, 2, 0]], skew[:, [1, 2, 0], [2, 0, 1]] = turns, -turns
    once, twice = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + once * skew + twice * skew @ skew)
