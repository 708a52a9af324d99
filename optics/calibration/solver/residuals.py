"""Reprojection residuals of corners seen directly or by way of one mirror, and their exact derivatives.

A corner X_b of the board, with its modes of deformation, is X = R_f (X_b + sum_k a_k B_k) + t_f in rig in frame f. Seen
directly it projects from X; by way of the mirror with virtual centre c from X' = X - 2 (X.c / |c|^2 - 1/2) c.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from optics.calibration.observations import DIRECT, Observations
from optics.camera import Camera
from optics.mirror import reflect
from optics.values import FloatArray

N_INTRINSICS = 9


@dataclass(frozen=True)
class Board:
    """The corners (c, 3) mm as drawn, and the modes (k, c, 3) by which the real board may differ from the drawing."""

    corners_in_board_mm: FloatArray
    modes: FloatArray

    @classmethod
    def rigid(cls, corners_in_board_mm: FloatArray) -> Board:
        """A board that is exactly as drawn."""
        return cls(corners_in_board_mm, np.zeros((0, *corners_in_board_mm.shape)))

    @classmethod
    def free(cls, corners_in_board_mm: FloatArray) -> Board:
        """Every corner free in x, y and z, less the seven ways that only move, turn or scale the whole board.

        After Strobl and Hirzinger, "More accurate pinhole camera calibration with imperfect planar target" (2011).
        """
        count = len(corners_in_board_mm)
        centred = corners_in_board_mm - corners_in_board_mm.mean(axis=0)
        axes = np.eye(3)
        gauge = [np.tile(axis, (count, 1)) for axis in axes]
        gauge += [np.cross(axis, centred) for axis in axes]
        gauge += [centred]
        directions = np.array(gauge).reshape(7, -1)
        _, _, rows = np.linalg.svd(directions)
        return cls(corners_in_board_mm, rows[7:].reshape(-1, count, 3))

    def shaped(self, shape: FloatArray) -> FloatArray:
        """The corners (c, 3) mm with coefficients (k,) of the modes."""
        return self.corners_in_board_mm + np.tensordot(shape, self.modes, axes=1)


@dataclass(frozen=True)
class Estimate:
    """Everything that a calibration solves for.

    Camera, virtual centres (m, 3) mm, board poses (f, 4, 4) and coefficients (k,) mm of the board's modes.
    """

    camera: Camera
    virtual_centres_in_rig_mm: FloatArray
    rig_from_board: FloatArray
    shape: FloatArray = field(default_factory=lambda: np.zeros(0))

    def moved(self, step_global: FloatArray, step_poses: FloatArray) -> Estimate:
        """Add a step (9 + 3 m + k,) of intrinsics, virtual centres and modes, and twists (f, 6): rotation, translation.

        A rotation vector w turns the board's axes in place, R <- exp(w) R; the translation is added.
        """
        poses = self.rig_from_board.copy()
        poses[:, :3, :3] = Rotation.from_rotvec(step_poses[:, :3]).as_matrix() @ poses[:, :3, :3]
        poses[:, :3, 3] += step_poses[:, 3:]
        end = N_INTRINSICS + self.virtual_centres_in_rig_mm.size
        return Estimate(
            self.camera.with_intrinsics(self.camera.intrinsics + step_global[:N_INTRINSICS]),
            self.virtual_centres_in_rig_mm + step_global[N_INTRINSICS:end].reshape(-1, 3),
            poses,
            self.shape + step_global[end:],
        )


def points_at_camera(
    estimate: Estimate, observations: Observations, board: Board
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where the base camera sees each observed corner.

    Returns the corner turned into rig axes about the board's origin (n, 3), the corner in rig (n, 3), and the same
    reflected by the mirror of its view (n, 3); all mm.
    """
    poses = estimate.rig_from_board[observations.frame]
    turned = np.einsum("nij,nj->ni", poses[:, :3, :3], board.shaped(estimate.shape)[observations.corner])
    in_rig = turned + poses[:, :3, 3]
    mirrored = observations.view != DIRECT
    seen = in_rig.copy()
    seen[mirrored] = reflect(in_rig[mirrored], estimate.virtual_centres_in_rig_mm[observations.view[mirrored]])
    return turned, in_rig, seen


def residuals(estimate: Estimate, observations: Observations, board: Board) -> FloatArray:
    """Predicted minus seen pixels (n, 2); NaN where a corner is predicted behind the camera."""
    _, _, seen = points_at_camera(estimate, observations, board)
    return estimate.camera.project(seen) - observations.pixels


def residuals_with_jacobians(
    estimate: Estimate, observations: Observations, board: Board
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n, 2), their derivatives by the globals (n, 2, 9 + 3 m + k) and by the frame's own twist (n, 2, 6)."""
    turned, in_rig, seen = points_at_camera(estimate, observations, board)
    pixels, by_seen, by_intrinsics = estimate.camera.project_with_jacobians(seen)
    end = N_INTRINSICS + estimate.virtual_centres_in_rig_mm.size
    by_global = np.zeros((len(observations), 2, end + estimate.shape.size))
    by_global[:, :, :N_INTRINSICS] = by_intrinsics

    by_point = by_seen.copy()
    rows = np.flatnonzero(observations.view != DIRECT)
    view = observations.view[rows]
    c = estimate.virtual_centres_in_rig_mm[view]
    x = in_rig[rows]
    squared = np.sum(c * c, axis=1)
    along = np.sum(x * c, axis=1) / squared
    # J dX'/dX with dX'/dX = I - 2 c c^T / |c|^2, and J dX'/dc with
    # dX'/dc = (1 - 2 x.c/|c|^2) I - (2/|c|^2) c x^T + (4 x.c/|c|^4) c c^T, without forming the 3x3 matrices.
    j = by_seen[rows]
    j_c = np.einsum("nij,nj->ni", j, c) / squared[:, None]
    by_point[rows] = j - 2.0 * j_c[:, :, None] * c[:, None, :]
    by_centre = (1.0 - 2.0 * along)[:, None, None] * j
    by_centre -= 2.0 * j_c[:, :, None] * (x - 2.0 * along[:, None] * c)[:, None, :]
    columns = N_INTRINSICS + 3 * view
    for k in range(3):
        by_global[rows, :, columns + k] = by_centre[:, :, k]

    if estimate.shape.size:
        by_corner = np.einsum("nij,njk->nik", by_point, estimate.rig_from_board[observations.frame, :3, :3])
        by_global[:, :, end:] = np.einsum("nij,knj->nik", by_corner, board.modes[:, observations.corner])

    by_twist = np.empty((len(observations), 2, 6))
    by_twist[:, :, 3:] = by_point
    by_twist[:, :, :3] = np.cross(turned[:, None, :], by_point)  # J (w x p) = w . (p x J)
    return pixels - observations.pixels, by_global, by_twist
