"""The gauge of a calibration: the motion from the true rig to its rig, which pictures do not determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from mirrorcam.bench.scores.matched_views import MatchedView
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_difference import best_motion, motion_jacobian
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import grid_px, points_at_pixels
from mirrorcam.optics.geometry.layout import VOLUME_FACTORS, Layout
from mirrorcam.optics.geometry.transforms import rigid, transform

STEP_MM = 1e-3
"""Step of central differences: the truncation error grows with its square, the rounding error with its inverse."""


@dataclass(frozen=True, eq=False)
class ScorePoints:
    """Points in the true rig frame, each visible in one view.

    Attributes
    ----------
    view
        Mirror index (n,) of each point.
    points_in_rig
        (n, 3), mm.
    pixels
        True pixels (n, 2) in the frame.
    by_point
        Derivatives (n, 2, 3) of the pixels with respect to the points, px/mm.
    at_distance
        Mask (n,) of points at the working distance.
    """

    view: NDArray[np.int64]
    points_in_rig: FloatArray
    pixels: FloatArray
    d_point: FloatArray
    at_distance: NDArray[np.bool_]

    def select(self, mask: NDArray[np.bool_]) -> ScorePoints:
        """Return the points where a mask (n,) is set."""
        return ScorePoints(
            self.view[mask], self.points_in_rig[mask], self.pixels[mask], self.d_point[mask], self.at_distance[mask]
        )


def score_points(truth: Layout, views: Sequence[int], distance_mm: float) -> ScorePoints:
    """Return a grid over the usable part of each sub-image, at three distances from the view's centre.

    Raises InputError if a view shows nothing at the working distance.
    """
    parts = []
    for view in views:
        pixels = grid_px(truth, view)
        pixels = pixels[_is_visible(truth, view, pixels)]
        for factor in VOLUME_FACTORS:
            points = points_at_pixels(truth, view, pixels, factor * distance_mm)
            projected_px, d_point = project_with_gradient(partial(truth.project, mirror=view), points)
            count = len(points)
            parts.append((np.full(count, view), points, projected_px, d_point, np.full(count, factor == 1.0)))
    candidates = ScorePoints(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    valid = np.isfinite(candidates.pixels).all(axis=1) & np.isfinite(candidates.d_point).all(axis=(1, 2))
    selected = candidates.select(np.asarray(valid))
    for view in views:
        if not (selected.at_distance & (selected.view == view)).any():
            raise InputError(f"mirror {truth.mirror_names[view]} shows nothing {distance_mm:g} mm away")
    return selected


def _is_visible(truth: Layout, view: int, pixels: FloatArray) -> NDArray[np.bool_]:
    size = np.array([truth.camera.width_px, truth.camera.height_px])
    on_sensor = np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=1)
    outline = truth.outline_px(view, usable=True)
    return np.asarray(on_sensor & contains_xy(Polygon(outline), pixels[:, 0], pixels[:, 1]))


def visible_in_all(truth: Layout, views: Sequence[int], points_in_rig: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of points (n, 3) inside the sub-images of all views."""
    visible = np.ones(len(points_in_rig), dtype=bool)
    for view in views:
        pixels = truth.project(points_in_rig, view)
        pixels = np.where(np.isfinite(pixels), pixels, -1e9)
        visible &= _is_visible(truth, view, pixels)
    return visible


def project_with_gradient(
    project: Callable[[FloatArray], FloatArray], points: FloatArray, step: float = STEP_MM
) -> tuple[FloatArray, FloatArray]:
    """Return the pixels (n, 2) of points (n, 3), and their derivatives (n, 2, 3) from central differences."""
    d_point = np.empty((len(points), 2, 3))
    for axis, offset in enumerate(step * np.eye(3)):
        d_point[:, :, axis] = (project(points + offset) - project(points - offset)) / (2.0 * step)
    return project(points), d_point


def project_by_view(
    views: Sequence[MatchedView], view: NDArray[np.int64], points_in_rig: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return pixels (n, 2) of points (n, 3) in a calibration's rig, each in its view, and derivatives (n, 2, 3)."""
    pixels, d_point = np.full((len(view), 2), np.nan), np.full((len(view), 2, 3), np.nan)
    for matched in views:
        mask = view == matched.view
        pixels[mask], d_point[mask] = project_with_gradient(matched.project_in_rig, points_in_rig[mask])
    return pixels, d_point


MAX_SCALE = 20.0
"""Maximum ratio of the cameras' distances to the true ones, or its inverse; beyond it, the unit must be wrong."""
MIN_VISIBLE_FRACTION = 0.5
"""Minimum fraction of visible points for a plausible calibration of a view."""


@dataclass(frozen=True, eq=False)
class Gauge:
    """A group of views that share one motion.

    Attributes
    ----------
    views
        All views, or a single view without a pose.
    rig_from_true
        The motion (4, 4) from the true rig to the calibration's rig; with a scale factor if the calibration has no
        scale, and a reflection if it describes a mirrored world.
    scaled
        Whether the scale factor was fitted.
    mirrored
        Whether the calibration's world is mirrored.
    points
        The points of its views.
    pixels
        Pixels (n, 2) in the frame according to the calibration; NaN where it has none.
    by_point
        Derivatives (n, 2, 3) of `pixels` with respect to the points in the true rig, px/mm.
    weights
        Weights (n,) of the points in the motion.
    """

    views: tuple[MatchedView, ...]
    rig_from_true: FloatArray
    scaled: bool
    mirrored: bool
    points: ScorePoints
    pixels: FloatArray
    d_point: FloatArray
    weights: FloatArray

    @property
    def true_from_rig(self) -> FloatArray:
        """The inverse motion (4, 4)."""
        return np.asarray(np.linalg.inv(self.rig_from_true), dtype=np.float64)

    @property
    def scale(self) -> float:
        """Length in the calibration's rig of a true mm; about 1 if it has no scale."""
        return float(np.cbrt(abs(np.linalg.det(self.rig_from_true[:3, :3]))))

    @property
    def motion_columns(self) -> FloatArray:
        """Derivatives (n, 2, 6 or 7) of the pixels with respect to the motion."""
        centred = self.points.points_in_rig - self.points.points_in_rig.mean(axis=0)
        lever_mm = float(np.linalg.norm(centred, axis=1).max())
        return motion_jacobian(self.d_point, self.points.points_in_rig, lever_mm, scaled=self.scaled)


def gauges(views: Sequence[MatchedView], points: ScorePoints, *, scaled: bool) -> tuple[Gauge, ...]:
    """Return the common gauge of all views with poses, or a gauge per view without poses.

    Raises InputError if a calibration shows too few of a view's points, or has a different unit.
    """
    if all(view.camera_from_rig is not None for view in views):
        return (_gauge(_in_mm(views) if scaled else tuple(views), points, scaled=scaled),)
    return tuple(_gauge((view,), points.select(points.view == view.view), scaled=False) for view in views)


def _gauge(views: tuple[MatchedView, ...], points: ScorePoints, *, scaled: bool) -> Gauge:
    start = _start(views)
    mirrored = bool(np.linalg.det(start[:3, :3]) < 0.0)
    # Reflect the points first, so that the motion is proper.
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0]) if mirrored else np.eye(4)
    reflected = transform(mirror, points.points_in_rig)

    def project(points_in_rig: FloatArray) -> tuple[FloatArray, FloatArray]:
        return project_by_view(views, points.view, points_in_rig)

    motion, weights = best_motion(points.pixels, points.view, reflected, project, start @ mirror, scaled=scaled)
    rig_from_true = motion @ mirror
    pixels, d_own_point = project(transform(rig_from_true, points.points_in_rig))
    _check_visible(views, points, pixels)
    return Gauge(
        views=views,
        rig_from_true=rig_from_true,
        scaled=scaled,
        mirrored=mirrored,
        points=points,
        pixels=pixels,
        d_point=d_own_point @ rig_from_true[:3, :3],
        weights=weights,
    )


def _in_mm(views: Sequence[MatchedView]) -> tuple[MatchedView, ...]:
    """Scale views of unknown scale to approximately the true distances."""
    factor = _scale_factor(views)
    scaled = []
    for view in views:
        pose = np.array(view.camera_from_rig)
        pose[:3, 3] /= factor
        scaled.append(replace(view, camera_from_rig=pose))
    return tuple(scaled)


def _start(views: tuple[MatchedView, ...]) -> FloatArray:
    """Return the motion that makes one view's pose exact, for the view that best agrees with the others."""
    factor = _scale_factor(views)
    if max(factor, 1.0 / factor) > MAX_SCALE:
        raise InputError(
            f"the cameras lie {factor:.3g} times as far apart as the set's mirrors, expected a different unit (--unit)"
        )
    poses, true_poses = _poses(views)
    rotations = np.array([pose[:3, :3].T @ true[:3, :3] for pose, true in zip(poses, true_poses, strict=True)])
    differences = np.linalg.norm(rotations[:, None] - rotations[None], axis=(2, 3))
    best = int(np.median(differences, axis=1).argmin())
    return rigid(rotations[best], centre(poses[best]) - rotations[best] @ centre(true_poses[best]))


def _poses(views: Sequence[MatchedView]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the poses of the calibration, the identity for a view without one, and the true poses."""
    own = [np.eye(4) if view.camera_from_rig is None else view.camera_from_rig for view in views]
    return own, [view.true_camera_from_rig for view in views]


def centre(camera_from_rig: FloatArray) -> FloatArray:
    """Return the centre of projection (3,), in the rig frame, of a pose (4, 4), which may include a reflection."""
    return np.asarray(-camera_from_rig[:3, :3].T @ camera_from_rig[:3, 3])


def _scale_factor(views: Sequence[MatchedView]) -> float:
    """Return the ratio of the distances between cameras to the true ones; 1 for a single camera."""
    lengths, true_lengths = (
        np.linalg.norm(centres[:, None] - centres[None], axis=2)[np.triu_indices(len(centres), 1)]
        for centres in (np.array([centre(pose) for pose in poses]) for poses in _poses(views))
    )
    if not len(lengths):
        return 1.0
    factor = float(np.median(lengths / true_lengths))
    if not factor > 0.0:
        raise InputError("all cameras are at one point, expected the poses of different mirrors")
    return factor


def _check_visible(views: tuple[MatchedView, ...], points: ScorePoints, pixels: FloatArray) -> None:
    for view in views:
        fraction = np.isfinite(pixels[points.view == view.view]).all(axis=1).mean()
        if fraction < MIN_VISIBLE_FRACTION:
            raise InputError(
                f"camera {view.camera.name[:40]!r} shows {fraction:.0%} of what {view.name} does, expected this "
                "mirror, and pictures flipped as --flip says"
            )
