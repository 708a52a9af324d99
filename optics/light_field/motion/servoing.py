"""Light field visual servoing: the velocity that moves the camera to a taught view, from 4-D features.

A feature is a point's direction (x, y) in the reference view and its inverse distance w = 1 / z, which the slope over
the views measures. Its interaction matrix is exact at every step, where one camera must assume w.

Tsai, Dansereau, Peynot, Corke, "Image-based visual servoing with light field cameras", RA-L 2017.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.feature_set import Features
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.optics.light_field.motion.point_matches import match_points, motion_between


@dataclass(frozen=True, eq=False)
class Matches:
    """Features (n, 3) of one scene in two light fields: x, y and w in 1/mm.

    Attributes
    ----------
    current, taught
        The matched features.
    sigma
        Standard deviations (n, 3) of their differences.
    """

    current: FloatArray
    taught: FloatArray
    sigma: FloatArray

    @property
    def rms_error(self) -> float:
        """RMS of the differences of x and y: an angle in radians."""
        return float(np.sqrt(np.mean((self.current - self.taught)[:, :2] ** 2)))


def match_features(views: Views, current: Features, taught: Features) -> Matches | None:
    """Match the features of two light fields with the same views; None if too few move like one rigid scene."""
    here, there = match_points(views, current, taught)
    fit = motion_between(views, here, there)
    if fit is None:
        return None
    _, inliers = fit
    angle = np.hypot(here.keypoint_sigma_px, there.keypoint_sigma_px) / views.focal_px
    inverse = np.hypot(*(seen.depth_sigma_mm / seen.points_mm[:, 2] ** 2 for seen in (here, there)))
    x_y_w = [np.column_stack([p[:, :2] / p[:, 2:], 1.0 / p[:, 2]]) for p in (here.points_mm, there.points_mm)]
    return Matches(x_y_w[0][inliers], x_y_w[1][inliers], np.column_stack([angle, angle, inverse])[inliers])


def interaction(features: FloatArray) -> FloatArray:
    """Return the derivatives (n, 3, 6) of features (n, 3) by the camera's motion, for points at rest.

    Columns are the velocity, mm/s, and the angular velocity, rad/s, of the reference view in its own axes.
    """
    x, y, w = features.T
    zero = np.zeros_like(x)
    return np.stack(
        [
            np.stack([-w, zero, x * w, x * y, -(1.0 + x * x), y], axis=1),
            np.stack([zero, -w, y * w, 1.0 + y * y, -x * y, -x], axis=1),
            np.stack([zero, zero, w * w, w * y, -w * x, zero], axis=1),
        ],
        axis=1,
    )


def servo_velocity(matches: Matches, gain_per_s: float = 1.0) -> FloatArray:
    """Return the velocity (6,) under which the features approach the taught ones exponentially.

    It is the least-squares solution for all features, weighted by their standard deviations: mm/s and rad/s of the
    reference view, in its own axes.
    """
    weights = 1.0 / matches.sigma
    error = (weights * (matches.current - matches.taught)).ravel()
    rows = (weights[..., None] * interaction(matches.current)).reshape(-1, 6)
    scale = np.array([1.0 / np.median(matches.current[:, 2])] * 3 + [1.0] * 3)  # mm of a radian at the scene
    solution, *_ = np.linalg.lstsq(rows * scale, error, rcond=None)
    return np.asarray(-gain_per_s * scale * solution)
