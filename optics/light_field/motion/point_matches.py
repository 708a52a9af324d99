"""Points of one scene in two light fields, matched by the descriptors of their features."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.feature_set import Features
from mirrorcam.optics.light_field.features.keypoints import nearest_pairs
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.optics.light_field.motion.pose_fit import robust_motion

# Standard deviation of a keypoint's repeated detection in another picture, in px of the keypoint's scale.
KEYPOINT_SIGMA_PX = 1.0


class SeenPoints(NamedTuple):
    """Points (n, 3) in the axes of the reference view, mm, with standard deviations (n,) of keypoint and depth.

    `keypoint_sigma_px` belongs to the position of the keypoint, `depth_sigma_mm` to z.
    """

    points_mm: FloatArray
    keypoint_sigma_px: FloatArray
    depth_sigma_mm: FloatArray


def match_points(views: Views, first: Features, second: Features) -> tuple[SeenPoints, SeenPoints]:
    """Match the features of two light fields with the same views; pairs (n) are in the same order."""
    one, other = nearest_pairs(first.descriptors, second.descriptors)
    return _seen(views, first, one), _seen(views, second, other)


def motion_between(views: Views, src: SeenPoints, dst: SeenPoints) -> tuple[FloatArray, NDArray[np.bool_]] | None:
    """Fit dst_from_src (4, 4) to matched points with outliers; also return the inliers, or None if too few agree."""
    lateral_sigma = np.hypot(*(seen.keypoint_sigma_px * seen.points_mm[:, 2] / views.focal_px for seen in (src, dst)))
    depth_sigma = np.hypot(src.depth_sigma_mm, dst.depth_sigma_mm)
    sigmas = np.stack([lateral_sigma, lateral_sigma, np.hypot(depth_sigma, lateral_sigma)], axis=1)
    return robust_motion(src.points_mm, dst.points_mm, sigmas)


def _seen(views: Views, features: Features, chosen: NDArray[np.int64]) -> SeenPoints:
    in_rig = features.points_in_rig_mm[chosen] - views.reference_view_in_rig_mm
    return SeenPoints(
        np.asarray(in_rig @ views.view_from_rig.T),
        features.scale_px[chosen] * KEYPOINT_SIGMA_PX,
        features.depth_sigma_mm[chosen],
    )
