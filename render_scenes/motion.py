"""A board that moves: smooth ways through poses, and where it is while a rolling shutter reads row after row."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from optics.values import FloatArray


def along(keys: FloatArray, times: FloatArray) -> FloatArray:
    """Poses (n, 4, 4) at times (n,) on a smooth way through poses (k, 4, 4), which it passes at times 0, 1, 2 ...

    A cubic spline of the positions, which sets out from rest and comes to rest, and one of the rotations (SciPy's
    `RotationSpline`); before and after nothing moves.
    """
    at = np.clip(times, 0.0, len(keys) - 1.0)
    poses = np.tile(np.eye(4), (len(at), 1, 1))
    if len(keys) == 1:
        return np.asarray(poses @ keys[0])
    knots = np.arange(len(keys), dtype=np.float64)
    poses[:, :3, 3] = CubicSpline(knots, keys[:, :3, 3], bc_type="clamped")(at)
    poses[:, :3, :3] = RotationSpline(knots, Rotation.from_matrix(keys[:, :3, :3]))(at).as_matrix()
    return poses


def pose_at(poses: FloatArray, part: float) -> FloatArray:
    """The pose (4, 4) after a part (0 to 1) of the readout, of poses (3, 4, 4) at its begin, middle and end."""
    times = [0.0, 0.5, 1.0]
    pose = np.eye(4)
    pose[:3, :3] = Slerp(times, Rotation.from_matrix(poses[:, :3, :3]))(part).as_matrix()
    pose[:3, 3] = [np.interp(part, times, poses[:, axis, 3]) for axis in range(3)]
    return pose
