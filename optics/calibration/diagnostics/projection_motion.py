"""The motion of the scene that makes two models of several views agree best, in pixels.

Two calibrations may place the rig differently in space: that is no difference between measurements, and is taken out
before they are compared. After the implied transformation of mrcal's projection difference (Kogan).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid, transform

UNLIKE = 3.0
"""Views that differ by more than this many times the median view hardly count in the motion."""
MOST_STEPS, STEADY_MM, ROUNDING_PX = 100, 1e-8, 1e-9

ProjectPoints = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Pixels (n, 2) of points (n, 3) in mm, each by its own view, and their derivatives (n, 2, 3) by the points, px/mm."""


def best_motion(
    shown_px: FloatArray,
    view: NDArray[np.int64],
    points_in_a: FloatArray,
    project_in_b: ProjectPoints,
    start: FloatArray,
    *,
    scaled: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """The motion b_from_a (4, 4) after which B shows points (n, 3) of A where A does, and their weights (n,) in it.

    A weighted least squares of pixels, by Gauss and Newton. Weights are Geman and McClure's of the views' root mean
    squares, so that one mirror that moved shows in its own view alone.

    Parameters
    ----------
    shown_px
        Pixels (n, 2) at which A shows the points.
    view
        The view (n,) of each point.
    points_in_a
        Points (n, 3), mm.
    project_in_b
        B's projection of points in its own rig, each by its view; NaN where B does not show one.
    start
        Motion (4, 4) to start from.
    scaled
        Whether B has no scale of its own: then the motion is a similarity.
    """
    b_from_a, weights = start, np.ones(len(shown_px))
    lever_mm = float(np.linalg.norm(points_in_a - points_in_a.mean(axis=0), axis=1).max())
    for _ in range(MOST_STEPS):
        moved = transform(b_from_a, points_in_a)
        pixels, by_point = project_in_b(moved)
        off = pixels - shown_px
        kept = np.isfinite(off).all(axis=1) & np.isfinite(by_point).all(axis=(1, 2))
        off[~kept], by_point[~kept] = 0.0, 0.0  # some may be behind a mirror on the way
        weights = view_weights(off, view)
        root = np.sqrt(weights)[:, None]
        columns = by_motion(by_point, moved, lever_mm, scaled=scaled)
        system = (root[:, :, None] * columns).reshape(-1, columns.shape[2])
        step = np.linalg.lstsq(system, -(root * off).ravel(), rcond=None)[0]
        turn, middle = Rotation.from_rotvec(step[:3] / lever_mm).as_matrix(), moved.mean(axis=0)
        if scaled:
            turn *= np.exp(step[6] / lever_mm)
        b_from_a = rigid(turn, middle + step[3:6] - turn @ middle) @ b_from_a
        if np.abs(step).max() < STEADY_MM:
            break
    return b_from_a, weights


def view_weights(off_px: FloatArray, view: NDArray[np.int64]) -> FloatArray:
    """Weights (n,) of points with differences (n, 2), one for each view."""
    views, place = np.unique(view, return_inverse=True)
    rms = np.array([np.sqrt(np.mean(off_px[view == each] ** 2)) for each in views])
    usual = UNLIKE * max(float(np.median(rms)), ROUNDING_PX)
    return np.asarray((1.0 / (1.0 + (rms / usual) ** 2) ** 2)[place])


def by_motion(by_point: FloatArray, points: FloatArray, lever_mm: float, *, scaled: bool = False) -> FloatArray:
    """Derivatives (n, 2, 6) of pixels by a motion of their points (n, 3), all in px/mm; (n, 2, 7) with a scale.

    The first three are of a rotation about the points' middle, in mm at the lever, the next of a shift, the last of a
    scale about the middle, in mm at the lever.
    """
    from_middle = (points - points.mean(axis=0)) / lever_mm
    by_turn = np.cross(from_middle[:, None, :], by_point)  # J (w x p) = w . (p x J)
    parts = [by_turn, by_point]
    if scaled:
        parts.append(np.einsum("nij,nj->ni", by_point, from_middle)[:, :, None])
    return np.concatenate(parts, axis=2)


def without_motion(by_parameter: FloatArray, columns: FloatArray, weights: FloatArray) -> FloatArray:
    """Derivatives (n, 2, g) of differences by parameters, where the motion (n, 2, 6 or 7) follows the parameters."""
    root = np.repeat(np.sqrt(weights), 2)[:, None]
    flat = by_parameter.reshape(-1, by_parameter.shape[-1])
    follows = np.linalg.lstsq(root * columns.reshape(-1, columns.shape[-1]), root * flat, rcond=None)[0]
    return by_parameter - columns @ follows
