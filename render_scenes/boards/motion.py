"""A board that moves: smooth ways through poses, and where it is while a rolling shutter reads row after row."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid


def smooth_motion(keys: FloatArray, times: FloatArray) -> FloatArray:
    """Poses (n, 4, 4) at times (n,) on a smooth way through poses (k, 4, 4), which it passes at times 0, 1, 2 ...

    A cubic spline of the positions, which sets out from rest and comes to rest, and one of the rotations (SciPy's
    `RotationSpline`); before and after nothing moves.
    """
    at = np.clip(times, 0.0, len(keys) - 1.0)
    if len(keys) == 1:
        return np.repeat(keys, len(at), axis=0)
    knots = np.arange(len(keys), dtype=np.float64)
    turns = RotationSpline(knots, Rotation.from_matrix(keys[:, :3, :3]))(at)
    return rigid(turns.as_matrix(), CubicSpline(knots, keys[:, :3, 3], bc_type="clamped")(at))


def poses_at(poses: FloatArray, parts: FloatArray) -> FloatArray:
    """The poses (n, 4, 4) after parts (n,), 0 to 1, of the readout, of poses (3, 4, 4) at its begin, middle and end.

    Positions, and the turn away from the middle as a vector, follow parabolas: the acceleration within a readout is
    taken as constant.
    """
    middle = Rotation.from_matrix(poses[1, :3, :3])
    turns = (middle.inv() * Rotation.from_matrix(poses[:, :3, :3])).as_rotvec()
    begin, end = (2.0 * parts - 1.0) * (parts - 1.0), parts * (2.0 * parts - 1.0)
    weights = np.stack([begin, 1.0 - begin - end, end], axis=-1)
    return rigid((middle * Rotation.from_rotvec(weights @ turns)).as_matrix(), weights @ poses[:, :3, 3])
