"""Motion of the camera from a sequence of light fields of a static scene, and its files.

Each light field's features are matched with a key frame's; the closed-form motion between the matches is the start.
The key frame's landmarks, aligned in all views, give the pose and its covariance. Errors of poses accumulate only from
key frame to key frame: a new key frame is created when few landmarks of the last one remain visible.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse
from mirrorcam.optics.light_field.features import FeatureDetector, FeatureFinder, Features
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.motion.point_matches import match_points, motion_between
from mirrorcam.optics.light_field.motion.pose_fit import (
    Frame,
    Landmarks,
    PoseFit,
    SharedErrors,
    build_landmarks,
    fit_pose,
    observe,
    predict,
)

# Fraction of visible landmarks below which a new key frame is created.
MIN_VISIBLE_FRACTION = 0.6
# Fraction of the previous landmarks below which the predicted pose is replaced by one from features.
MIN_TRACKED_FRACTION = 0.7
# Shift due to a pose update above which patches are aligned again, because their warp depends on the pose.
CONVERGED_PX, MAX_ALIGNMENTS = 0.5, 3
# Standard deviation of an error common to all slopes of a light field, in px of disparity in the view farthest from the
# reference view: interpolation and alignment are biased. Measured on rendered reliefs.
COMMON_SIGMA_PX = 0.002
# Standard deviation of an error common to adjacent patches, because pictures sample them differently.
NEIGHBOURS_SIGMA_PX = 0.005
SCHEMA = "mirrorcam.trajectory/1"


@dataclass(frozen=True, eq=False)
class TrackedPose:
    """The pose of one light field.

    Attributes
    ----------
    world_from_view
        Pose (4, 4) of its reference view, mm; the world is the view frame of the first light field. NaN if lost.
    covariance
        Covariance (6, 6) of xi = (translation in mm, rotation in radians) in world_from_view exp(xi), in the axes of
        the view. NaN if lost.
    landmarks
        Number of landmarks used; 0 if lost.
    is_key
        Whether later poses are measured relative to this one.
    """

    world_from_view: FloatArray
    covariance: FloatArray
    landmarks: int
    is_key: bool

    @property
    def is_lost(self) -> bool:
        return bool(np.isnan(self.world_from_view).any())


@dataclass(frozen=True, eq=False)
class _KeyFrame:
    features: Features
    landmarks: Landmarks
    world_from_view: FloatArray
    covariance: FloatArray


class LightFieldTracker:
    """Tracks the poses of light fields with the same views, one after the other.

    Parameters
    ----------
    views
        Geometry of the light fields.
    name
        Detector of the features.
    keypoints, nearest_mm, farthest_mm
        As in `FeatureFinder`.

    Raises
    ------
    InputError
        As in `FeatureFinder`.
    """

    def __init__(
        self,
        views: Views,
        name: FeatureDetector = "ORB",
        *,
        keypoints: int = 600,
        nearest_mm: float | None = None,
        farthest_mm: float = np.inf,
    ) -> None:
        self.finder = FeatureFinder(views, name, keypoints=keypoints, nearest_mm=nearest_mm, farthest_mm=farthest_mm)
        self._pool = ThreadPoolExecutor(min(4, os.cpu_count() or 1))
        self._key: _KeyFrame | None = None
        # The last pose, its number of landmarks, and the last motion, which predicts the next one.
        self._frame_from_key, self._landmark_count, self._motion = np.eye(4), 0, np.eye(4)
        baseline_mm = np.hypot(*self.finder.geometry.lateral_mm.T).max()
        self._shared = SharedErrors(
            NEIGHBOURS_SIGMA_PX / views.focal_px, COMMON_SIGMA_PX / (views.focal_px * baseline_mm)
        )

    def track(self, light_field: LightField) -> TrackedPose:
        """Return the pose of the next light field; raises InputError if its views differ."""
        if not self.finder.fits(light_field):
            raise InputError(
                f"light field of layout {light_field.layout_identity} differs in its views from layout "
                f"{self.finder.views.layout_identity} of the first one"
            )
        frame = Frame.of(light_field)
        if self._key is None:
            return self._new_key(frame, self.finder.find(light_field), np.eye(4), np.zeros((6, 6)), 0)
        key, features = self._key, None
        fit = self._refine(frame, self._motion @ self._frame_from_key)
        if fit is None or fit.used.sum() < MIN_TRACKED_FRACTION * self._landmark_count:
            features = self.finder.find(light_field)
            start = self._start(key.features, features)
            from_features = None if start is None else self._refine(frame, start)
            fit = fit if from_features is None else from_features
        if fit is None:
            self._motion = np.eye(4)
            return TrackedPose(np.full((4, 4), np.nan), np.full((6, 6), np.nan), 0, False)
        self._motion = fit.frame_from_key @ inverse(self._frame_from_key)
        self._frame_from_key, self._landmark_count = fit.frame_from_key, int(fit.used.sum())
        world_from_view = key.world_from_view @ inverse(fit.frame_from_key)
        transport = adjoint(fit.frame_from_key)
        covariance = transport @ key.covariance @ transport.T + fit.covariance
        if self._landmark_count < MIN_VISIBLE_FRACTION * len(key.landmarks.inverse_distance):
            features = self.finder.find(light_field) if features is None else features
            return self._new_key(frame, features, world_from_view, covariance, self._landmark_count)
        return TrackedPose(world_from_view, covariance, self._landmark_count, False)

    def _refine(self, frame: Frame, frame_from_key: FloatArray) -> PoseFit | None:
        """Refine a predicted pose by landmarks; None if too few agree."""
        assert self._key is not None
        landmarks, fit = self._key.landmarks, None
        for _ in range(MAX_ALIGNMENTS):
            expected = predict(landmarks, frame_from_key)
            observed = observe(self.finder.geometry, frame, landmarks.templates, *expected, self._pool.map)
            fit = fit_pose(landmarks, observed, frame_from_key, self._shared)
            if fit is None:
                return None
            frame_from_key = fit.frame_from_key
            shift = np.abs(predict(landmarks, frame_from_key)[0] - expected[0])[fit.used]
            if np.median(shift) * self.finder.views.focal_px < CONVERGED_PX:
                break
        return fit

    def _new_key(
        self, frame: Frame, features: Features, world_from_view: FloatArray, covariance: FloatArray, count: int
    ) -> TrackedPose:
        geometry, views = self.finder.geometry, self.finder.views
        unrefracted = ~features.refracted
        landmarks = build_landmarks(
            geometry,
            frame,
            geometry.directions(features.keypoint_px[unrefracted]),
            1.0 / (features.depth_mm[unrefracted] - views.reference_view_depth_mm),
            features.scale_px[unrefracted],
            self._pool.map,
        )
        self._key = _KeyFrame(features, landmarks, world_from_view, covariance)
        self._frame_from_key, self._landmark_count = np.eye(4), len(landmarks.inverse_distance)
        return TrackedPose(world_from_view, covariance, count or len(landmarks.inverse_distance), True)

    def _start(self, key: Features, current: Features) -> FloatArray | None:
        """Return frame_from_key in closed form from similar features; None if too few agree."""
        views = self.finder.views
        fit = motion_between(views, *match_points(views, key, current))
        return None if fit is None else fit[0]


def adjoint(dst_from_src: FloatArray) -> FloatArray:
    """Return the matrix (6, 6) from small motions (translation, rotation) in the axes of src to the axes of dst."""
    rotation, (x, y, z) = dst_from_src[:3, :3], dst_from_src[:3, 3]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[rotation, cross @ rotation], [np.zeros((3, 3)), rotation]])


def save_tum(path: Path, times_s: Sequence[float], poses: Sequence[TrackedPose]) -> None:
    """Write `time tx ty tz qx qy qz qw` per line, atomically: metres, world_from_view; lost frames are omitted.

    Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012.
    """
    lines = ["# time_s tx ty tz qx qy qz qw (metres; pose of the reference view in the first one's frame)"]
    for time_s, pose in zip(times_s, poses, strict=True):
        if not pose.is_lost:
            quaternion = Rotation.from_matrix(pose.world_from_view[:3, :3]).as_quat(canonical=True)
            numbers = [*(pose.world_from_view[:3, 3] / 1000.0), *quaternion]
            lines.append(f"{time_s:.6f} " + " ".join(f"{number:.9f}" for number in numbers))
    write_text(path, "\n".join(lines) + "\n")


def save_json(path: Path, names: Sequence[str], times_s: Sequence[float], poses: Sequence[TrackedPose]) -> None:
    """Write names, times, poses (4, 4) in mm and covariances (6, 6), atomically; null for lost frames."""
    frames = [
        {
            "name": name,
            "time_s": time_s,
            "world_from_view": None if pose.is_lost else pose.world_from_view.tolist(),
            "covariance": None if pose.is_lost else pose.covariance.tolist(),
            "landmarks": pose.landmarks,
            "is_key": pose.is_key,
        }
        for name, time_s, pose in zip(names, times_s, poses, strict=True)
    ]
    document = {"schema": SCHEMA, "covariance_order": "x_mm y_mm z_mm turn_x turn_y turn_z", "frames": frames}
    write_text(path, json.dumps(document, indent=1) + "\n")
