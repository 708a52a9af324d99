"""Motion of a board: smooth paths through key poses, and poses during the readout of a rolling shutter."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid


def smooth_motion(keys: FloatArray, times: FloatArray) -> FloatArray:
    """Interpolate a smooth motion through key poses.

    Positions follow a clamped cubic spline, at rest at both ends; rotations follow SciPy's `RotationSpline`. Before the
    first and after the last key the board rests.

    Parameters
    ----------
    keys
        Rigid key poses (k, 4, 4), passed at times 0, 1, 2, ...
    times
        Times (n,).

    Returns
    -------
    FloatArray
        Poses (n, 4, 4).
    """
    at = np.clip(times, 0.0, len(keys) - 1.0)
    if len(keys) == 1:
        return np.repeat(keys, len(at), axis=0)
    knots = np.arange(len(keys), dtype=np.float64)
    turns = RotationSpline(knots, Rotation.from_matrix(keys[:, :3, :3]))(at)
    return rigid(turns.as_matrix(), CubicSpline(knots, keys[:, :3, 3], bc_type="clamped")(at))


def poses_at(poses: FloatArray, parts: FloatArray) -> FloatArray:
    """Interpolate poses within the readout of one frame.

    Positions, and rotation vectors relative to the middle, follow parabolas: the acceleration within a readout is taken
    as constant.

    Parameters
    ----------
    poses
        Poses (3, 4, 4) at the begin, middle and end of the readout.
    parts
        Fractions (n,) of the readout, 0 to 1.

    Returns
    -------
    FloatArray
        Poses (n, 4, 4).
    """
    middle = Rotation.from_matrix(poses[1, :3, :3])
    turns = (middle.inv() * Rotation.from_matrix(poses[:, :3, :3])).as_rotvec()
    begin, end = (2.0 * parts - 1.0) * (parts - 1.0), parts * (2.0 * parts - 1.0)
    weights = np.stack([begin, 1.0 - begin - end, end], axis=-1)
    return rigid((middle * Rotation.from_rotvec(weights @ turns)).as_matrix(), weights @ poses[:, :3, 3])
