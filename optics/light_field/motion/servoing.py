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
from mirrorcam.optics.light_field.features.keypoints import nearest_pairs
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.optics.light_field.motion.pose_fit import robust_motion

KEYPOINT_SIGMA_PX = 1.0
"""Standard deviation of a keypoint's repeated detection in another picture, in px of the keypoint's scale."""


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
    first, second = nearest_pairs(current.descriptors, taught.descriptors)
    sides = ((current, first), (taught, second))
    here, there = (_points(views, features)[chosen] for features, chosen in sides)
    angles = [KEYPOINT_SIGMA_PX * features.scale_px[chosen] / views.focal_px for features, chosen in sides]
    depths = [features.depth_sigma_mm[chosen] for features, chosen in sides]
    lateral_mm = np.hypot(angles[0] * here[:, 2], angles[1] * there[:, 2])
    fit = robust_motion(here, there, np.column_stack([lateral_mm, lateral_mm, np.hypot(np.hypot(*depths), lateral_mm)]))
    if fit is None:
        return None
    _, inliers = fit
    angle = np.hypot(*angles)
    inverse = np.hypot(depths[0] / here[:, 2] ** 2, depths[1] / there[:, 2] ** 2)
    seen = [np.column_stack([points[:, :2] / points[:, 2:], 1.0 / points[:, 2]]) for points in (here, there)]
    return Matches(seen[0][inliers], seen[1][inliers], np.column_stack([angle, angle, inverse])[inliers])


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


def _points(views: Views, features: Features) -> FloatArray:
    """Return the points (n, 3) of features in the axes of the reference view, mm."""
    return np.asarray((features.points_in_rig_mm - views.reference_view_in_rig_mm) @ views.view_from_rig.T)
