"""Readout time of a rolling shutter, from the board's motion during readouts and between consecutive frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import block_diag, coo_array
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection
from mirrorcam.optics.calibration.solver.normal_equations import Grouped, normal_equations
from mirrorcam.optics.calibration.solver.observations import IntArray, Observations
from mirrorcam.optics.calibration.solver.residuals import row_times

MIN_FRAMES = 5
MIN_SIGMAS = 10.0
"""Minimum significance: pictures that are no consecutive frames of a video have motions without a relation to it."""
CLIP = 3.0
"""Ratio to the typical deviation beyond which a frame's motion is left out."""
STEPS = np.array([-2, -1, 1, 2])
FIRST_DERIVATIVE, THIRD_DERIVATIVE = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0, np.array([-0.5, 1.0, -1.0, 0.5])
"""Weights of the neighbouring frames at these steps: exact for polynomials of degree 4."""
ROUNDS = 3
"""Number of estimates, each without the frames that deviated in the one before."""
VELOCITIES = np.arange(12, 18)
"""The velocities among the parameters of a frame, in the order of `Estimate.moved`."""


@dataclass(frozen=True)
class Readout:
    """Readout time of a frame from its first row to its last, in frame periods, and its standard deviation."""

    periods: float
    sigma: float


def readout(selection: ModelSelection, observations: Observations, numbers: Sequence[int]) -> Readout | None:
    """Compare the motions during readouts with the board's velocity from frame to frame.

    Parameters
    ----------
    selection
        A fitted model.
    observations
        The fitted corners.
    numbers
        Numbers of its first frames in their recording; others are left out.

    Returns
    -------
    Readout or None
        None unless motions and velocities agree: the pictures are no consecutive frames, or the board rests. The
        estimate is by generalised least squares; its standard deviation grows with deviations beyond their covariance.
    """
    model, solution = selection.model, selection.solution
    edge = int(STEPS.max())
    frames = np.array(
        [f for f in range(edge, len(numbers) - edge) if numbers[f + edge] - numbers[f - edge] == 2 * edge],
        dtype=np.int64,
    )
    if len(frames) < MIN_FRAMES or not model.frame_terms.has_motion:
        return None
    rows = observations.where(solution.inliers)
    moves, motion = _moves(solution.estimate.rig_from_board, frames), solution.estimate.motion[frames, :6]
    cubics = _cubics(row_times(solution.estimate.camera, rows.pixels[:, 1]), rows.frame, frames)
    covariances = _Covariances.of(selection, rows, frames)
    used, periods = np.ones(len(frames), dtype=bool), 0.0
    for _ in range(ROUNDS):
        # The velocity (n, 4) that a parabola over the rows has on a cubic path, from the moves to neighbouring frames.
        stencil = FIRST_DERIVATIVE + periods**2 * cubics[:, None] * THIRD_DERIVATIVE
        velocity = np.einsum("fs,fsi->fi", stencil, moves)
        covariance = covariances.at(periods * stencil)
        kept = np.repeat(used, 6)
        factor = cho_factor(covariance[np.ix_(kept, kept)])
        weights = cho_solve(factor, velocity[used].ravel())
        variance = 1.0 / max(float(weights @ velocity[used].ravel()), 1e-300)
        periods = variance * float(weights @ motion[used].ravel())
        error = motion - periods * velocity
        deviation = float(error[used].ravel() @ cho_solve(factor, error[used].ravel())) / (kept.sum() - 1)
        own = covariance.reshape(len(frames), 6, len(frames), 6)[np.arange(len(frames)), :, np.arange(len(frames))]
        squared = np.sum(error * np.linalg.solve(own, error[:, :, None])[:, :, 0], axis=1)
        used = squared <= CLIP**2 * np.median(squared)
    sigma = float(np.sqrt(variance * max(deviation, 1.0)))
    return Readout(periods, sigma) if 0.0 < periods <= 1.0 and periods > MIN_SIGMAS * sigma else None


@dataclass(frozen=True)
class _Covariances:
    """Covariance of the differences between motions and velocities of some `frames` (n,).

    Attributes
    ----------
    own
        Covariance (f, d, d) of each frame's parameters, with camera and mirrors known.
    by_globals
        Derivatives (f * d, g) of the frames' parameters with respect to the globals.
    of_globals
        Covariance (g, g) of the globals.
    columns
        Indices (6,) of the velocities among a frame's parameters.
    """

    frames: IntArray
    own: FloatArray
    by_globals: FloatArray
    of_globals: FloatArray
    columns: IntArray

    @classmethod
    def of(cls, selection: ModelSelection, rows: Observations, frames: IntArray) -> _Covariances:
        solution, model = selection.solution, selection.model
        normal = normal_equations(solution.estimate, Grouped.of(rows, model), model)
        inverse: FloatArray = np.asarray(np.linalg.inv(normal.v), dtype=np.float64)
        return cls(
            frames,
            np.asarray((solution.scale * selection.inflation) ** 2 * inverse, dtype=np.float64),
            -(inverse @ normal.w).reshape(-1, normal.w.shape[2]),
            solution.covariance,
            np.searchsorted(model.frame_terms.free, VELOCITIES),
        )

    def at(self, weights: FloatArray) -> FloatArray:
        """The covariance (6n, 6n) of motions minus poses of the frames at `STEPS`, with weights (n, 4)."""
        count, (all_frames, size, _) = len(self.frames), self.own.shape
        terms = [(self.frames, self.columns, np.ones(count))]
        terms += [(self.frames + step, np.arange(6), -weight) for step, weight in zip(STEPS, weights.T, strict=True)]
        places = [(size * frame[:, None] + columns).ravel() for frame, columns, _ in terms]
        values = np.concatenate([np.repeat(value, 6) for *_, value in terms])
        rows = np.tile(np.arange(6 * count), len(terms))
        shape = 6 * count, size * all_frames
        difference = coo_array((values, (rows, np.concatenate(places))), shape=shape).tocsr()
        by_globals = difference @ self.by_globals
        return np.asarray(
            (difference @ block_diag(self.own, format="csr") @ difference.T).toarray()
            + by_globals @ self.of_globals @ by_globals.T
        )


def _moves(poses: FloatArray, frames: IntArray) -> FloatArray:
    """Moves (n, 4, 6) of boards from frames to those at `STEPS`: rotation vectors in rig axes, and translations."""
    moves = np.empty((len(frames), len(STEPS), 6))
    for move, step in zip(moves.transpose(1, 0, 2), STEPS, strict=True):
        turn = poses[frames + step, :3, :3] @ poses[frames, :3, :3].transpose(0, 2, 1)
        move[:, :3] = Rotation.from_matrix(turn).as_rotvec()
        move[:, 3:] = poses[frames + step, :3, 3] - poses[frames, :3, 3]
    return moves


def _cubics(times: FloatArray, frame: IntArray, frames: IntArray) -> FloatArray:
    """Slopes (n,) of the parabolas that fit s^3 / 6 best at the times s of the rows of each frame's corners."""
    parts = [times[frame == number] for number in frames]
    return np.array([np.polynomial.polynomial.polyfit(part, part**3 / 6.0, 2)[1] for part in parts])
