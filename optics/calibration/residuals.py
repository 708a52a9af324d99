"""Reprojection residuals of corners seen directly or by way of one mirror, and their exact derivatives.

A corner X_b of the board in frame f is X = R_f X_b + t_f in rig. Seen directly it projects from X; by way of the mirror
with virtual centre c it projects from X' = X - 2 (X.c / |c|^2 - 1/2) c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from optics.calibration.observations import DIRECT, Observations
from optics.camera import Camera
from optics.mirror import reflect
from optics.values import FloatArray

N_INTRINSICS = 9


@dataclass(frozen=True)
class Estimate:
    """Everything that a calibration solves for: camera, virtual centres (m, 3) mm, board poses (f, 4, 4)."""

    camera: Camera
    virtual_centres_in_rig_mm: FloatArray
    rig_from_board: FloatArray

    def moved(self, step_global: FloatArray, step_poses: FloatArray) -> Estimate:
        """Add a step (9 + 3 m,) of intrinsics and virtual centres, and twists (f, 6): left rotation, then translation.

        A rotation vector w turns the board's axes in place, R <- exp(w) R; the translation is added.
        """
        poses = self.rig_from_board.copy()
        poses[:, :3, :3] = Rotation.from_rotvec(step_poses[:, :3]).as_matrix() @ poses[:, :3, :3]
        poses[:, :3, 3] += step_poses[:, 3:]
        return Estimate(
            self.camera.with_intrinsics(self.camera.intrinsics + step_global[:N_INTRINSICS]),
            self.virtual_centres_in_rig_mm + step_global[N_INTRINSICS:].reshape(-1, 3),
            poses,
        )


def points_at_camera(
    estimate: Estimate, observations: Observations, corners_in_board_mm: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where the base camera sees each observed corner.

    Returns the corner turned into rig axes about the board's origin (n, 3), the corner in rig (n, 3), and the same
    reflected by the mirror of its view (n, 3); all mm.
    """
    poses = estimate.rig_from_board[observations.frame]
    turned = np.einsum("nij,nj->ni", poses[:, :3, :3], corners_in_board_mm[observations.corner])
    in_rig = turned + poses[:, :3, 3]
    mirrored = observations.view != DIRECT
    seen = in_rig.copy()
    seen[mirrored] = reflect(in_rig[mirrored], estimate.virtual_centres_in_rig_mm[observations.view[mirrored]])
    return turned, in_rig, seen


def residuals(estimate: Estimate, observations: Observations, corners_in_board_mm: FloatArray) -> FloatArray:
    """Predicted minus seen pixels (n, 2); NaN where a corner is predicted behind the camera."""
    _, _, seen = points_at_camera(estimate, observations, corners_in_board_mm)
    return estimate.camera.project(seen) - observations.pixels


def residuals_with_jacobians(
    estimate: Estimate, observations: Observations, corners_in_board_mm: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n, 2) and their derivatives by the globals (n, 2, 9 + 3 m) and by the frame's own twist (n, 2, 6)."""
    turned, in_rig, seen = points_at_camera(estimate, observations, corners_in_board_mm)
    pixels, by_seen, by_intrinsics = estimate.camera.project_with_jacobians(seen)
    count, mirrors = len(observations), len(estimate.virtual_centres_in_rig_mm)
    by_global = np.zeros((count, 2, N_INTRINSICS + 3 * mirrors))
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

    by_twist = np.empty((count, 2, 6))
    by_twist[:, :, 3:] = by_point
    by_twist[:, :, :3] = np.cross(turned[:, None, :], by_point)  # J (w x p) = w . (p x J)
    return pixels - observations.pixels, by_global, by_twist
