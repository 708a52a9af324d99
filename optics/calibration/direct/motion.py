"""Motion of the camera between pictures, and of the board during the readout of a picture.

A tripod yields when the shutter button is pressed. A rotation of the camera about the pupil moves all image points by
one homography, whatever their distance and whether they are mirrored, so the entire static scene determines it.
Moving boards and hands are outliers.

A rolling shutter exposes the rows of a frame one after another, which shears the image of a moving board. A corner in
row v of h is exposed v / (h - 1) - 1/2 of the readout after the middle row, and its velocity gives its position at the
time of the middle row. Velocities are measured by Lucas-Kanade tracking between the frames before and after, so a
single number describes the shutter: the readout of a frame as a fraction of the frame period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import f as f_distribution

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.diagnostics.model_comparison import (
    FOLDS,
    MIN_GAIN_SIGMAS,
    SUPPORTED_CHANCE,
    balanced_folds,
    held_out_corners,
)
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, minimise
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import residuals
from mirrorcam.optics.geometry.camera import Camera

FEATURES, FEATURE_QUALITY, FEATURE_GAP_PX = 6000, 0.003, 10.0
CELLS, PER_CELL = (16, 8), 8  # the limit per cell keeps moving objects, often the most textured, from dominating
SCENE_WINDOW_PX, BOARD_WINDOW_PX = (21, 21), (15, 15)
PYRAMID_LEVELS = 2
TRACKING_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
MAX_BACKWARD_PX, MAX_DIFFERENCE_GREY, MAX_MOVE_PX = 0.05, 10.0, 6.0
MAX_STATIC_PX = 0.4
RANSAC_SAMPLES = 300
MIN_STATIC_FEATURES = 40
TRIAL_READOUT = 0.5
"""The cost is evaluated at readouts of 0, this value and twice this value, to fit a parabola."""
MIN_TRACKED = 6
MAX_VELOCITY_ERROR = 3.0  # relative to the median deviation of a view's velocities from their affine fit


def camera_rotations(pictures: Sequence[Grey], camera: Camera) -> FloatArray | None:
    """Rotation vectors (n, 3), rad, from rays of the first picture to rays of each picture; None if undetermined.

    Random sample consensus over features tracked by Lucas-Kanade, then least squares.
    """
    camera = _far(camera)
    rotations = [np.zeros(3)]
    for picture in pictures[1:]:
        first_px, other_px = _scene_tracks(pictures[0], picture)
        rotation = None if len(first_px) < MIN_STATIC_FEATURES else _ransac_rotation(camera, first_px, other_px)
        if rotation is None:
            return None
        rotations.append(rotation)
    return np.array(rotations)


def stabilised(observations: Observations, camera: Camera, rotations: FloatArray) -> Observations:
    """Correct corners for the camera's `rotations` (f, 3), rad, since the first frame."""
    camera = _far(camera)
    first_from_frame = Rotation.from_rotvec(rotations[observations.frame]).inv().as_matrix()
    rays = np.einsum("nij,nj->ni", first_from_frame, camera.unproject(observations.pixels))
    return replace(observations, pixels=camera.project(rays))


def _far(camera: Camera) -> Camera:
    """Return a camera as far points see it, whose pixels do not depend on their distance."""
    return camera.replaced(pupil_walk_mm=None, defocus_growth_mm2=None)


def _scene_tracks(first: Grey, other: Grey) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of features spread evenly over the first picture, and their pixels (n, 2) in the other picture."""
    features_px = cv2.goodFeaturesToTrack(first, FEATURES, FEATURE_QUALITY, FEATURE_GAP_PX)
    if features_px is None:
        return np.empty((0, 2)), np.empty((0, 2))
    first_px = np.asarray(features_px, dtype=np.float64).reshape(-1, 2)
    other_px, forward, difference = _track(first, other, first_px)
    returned_px, backward, _ = _track(other, first, other_px)
    valid = forward & backward & (difference < MAX_DIFFERENCE_GREY)
    valid &= np.linalg.norm(returned_px - first_px, axis=1) < MAX_BACKWARD_PX
    valid &= np.linalg.norm(other_px - first_px, axis=1) < MAX_MOVE_PX
    first_px, other_px = first_px[valid], other_px[valid]
    cell = (first_px / np.array(first.shape[::-1]) * CELLS).astype(np.int64) @ [CELLS[1], 1]
    # Features are sorted by quality, so the first of a cell are its best.
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], cell[order])
    selected = np.sort(order[np.arange(len(order)) - starts < PER_CELL])
    return first_px[selected], other_px[selected]


def _track(first: Grey, other: Grey, pixels: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Track pixels (n, 2): return their pixels in the other picture, success (n,) and mean grey difference (n,)."""
    seeds = pixels.astype(np.float32)[:, None]
    tracked_px, status, error = cv2.calcOpticalFlowPyrLK(
        first, other, seeds, seeds.copy(), winSize=SCENE_WINDOW_PX, maxLevel=PYRAMID_LEVELS, criteria=TRACKING_CRITERIA
    )
    tracked = status.ravel() > 0
    # For a lost point, the difference is undefined.
    difference = np.full(len(tracked), np.inf)
    difference[tracked] = error.ravel()[tracked]
    return np.asarray(tracked_px, dtype=np.float64)[:, 0], tracked, difference


def _ransac_rotation(camera: Camera, first_px: FloatArray, other_px: FloatArray) -> FloatArray | None:
    """Rotation vector (3,) that fits the motion of the static features (n, 2); None if too few agree."""
    random = np.random.default_rng(0)
    rays = camera.unproject(first_px)
    in_view = np.isfinite(rays).all(axis=1)  # a lens may not reach the corners of the picture
    rays, other_px = rays[in_view], other_px[in_view]
    if len(rays) < MIN_STATIC_FEATURES:
        return None
    best_rotation, max_inliers = np.zeros(3), 0
    for _ in range(RANSAC_SAMPLES):
        pair = random.choice(len(rays), 2, replace=False)
        rotation = _refine_rotation(camera, rays[pair], other_px[pair], np.zeros(3), steps=2)
        count = int((np.linalg.norm(_projected(camera, rays, rotation) - other_px, axis=1) < MAX_STATIC_PX).sum())
        if count > max_inliers:
            best_rotation, max_inliers = rotation, count
    for _ in range(5):
        inliers = np.linalg.norm(_projected(camera, rays, best_rotation) - other_px, axis=1) < MAX_STATIC_PX
        if inliers.sum() < MIN_STATIC_FEATURES:
            return None
        best_rotation = _refine_rotation(camera, rays[inliers], other_px[inliers], best_rotation, steps=1)
    return best_rotation


def _projected(camera: Camera, rays: FloatArray, rotation: FloatArray) -> FloatArray:
    return camera.project(rays @ Rotation.from_rotvec(rotation).as_matrix().T)


def _refine_rotation(
    camera: Camera, rays: FloatArray, target_px: FloatArray, rotation: FloatArray, *, steps: int
) -> FloatArray:
    """Rotation vector (3,) that rotates rays (n, 3) to target pixels (n, 2), by Gauss-Newton steps from a start."""
    for _ in range(steps):
        rotated = rays @ Rotation.from_rotvec(rotation).as_matrix().T
        pixels, d_ray, _ = camera.project_with_jacobians(rotated)
        if not (np.isfinite(pixels).all() and np.isfinite(d_ray).all()):
            break
        d_rotation = np.cross(rotated[:, None, :], d_ray)  # J (w x p) = w . (p x J)
        step = np.linalg.lstsq(d_rotation.reshape(-1, 3), (target_px - pixels).ravel(), rcond=None)[0]
        rotation = (Rotation.from_rotvec(step) * Rotation.from_rotvec(rotation)).as_rotvec()
    return rotation


@dataclass(frozen=True)
class Shutter:
    """An estimated rolling shutter.

    `readout` is the readout time as a fraction of the frame period, and `sigma` its standard deviation. The shutter is
    `supported` if the likelihood, the information criterion and held-out frames all favour it.
    """

    readout: float
    sigma: float
    supported: bool


def corner_velocities(observations: Observations, adjacent: Sequence[tuple[Grey, Grey, Grey] | None]) -> FloatArray:
    """Velocities (n, 2) of corners, px per frame, smooth over each view; 0 where they cannot be measured.

    `adjacent` holds, for each frame, the previous picture, its own, and the next one.
    """
    velocities = np.zeros((len(observations), 2))
    for frame, pictures in enumerate(adjacent):
        rows = np.flatnonzero(observations.frame == frame)
        if pictures is None or not len(rows):
            continue
        before, current, after = pictures
        pixels = observations.pixels[rows]
        (backward, backward_tracked), (forward, forward_tracked) = (
            _displacements(current, other, pixels) for other in (before, after)
        )
        velocity, tracked = (forward - backward) / 2.0, backward_tracked & forward_tracked
        for view in np.unique(observations.view[rows]):
            view_rows = observations.view[rows] == view
            velocities[rows[view_rows]] = _smooth(pixels[view_rows], velocity[view_rows], tracked[view_rows])
    return velocities


def _displacements(current: Grey, other: Grey, pixels: FloatArray) -> tuple[FloatArray, np.ndarray]:
    seeds = pixels.astype(np.float32)[:, None]
    tracked_px, status, _ = cv2.calcOpticalFlowPyrLK(
        current, other, seeds, seeds.copy(), winSize=BOARD_WINDOW_PX, maxLevel=PYRAMID_LEVELS
    )
    return np.asarray(tracked_px - seeds, dtype=np.float64)[:, 0], status.ravel() > 0


def _smooth(pixels: FloatArray, velocity: FloatArray, tracked: np.ndarray) -> FloatArray:
    """Fit a view's velocities (n, 2) by an affine function of the pixel, without outliers; 0 if few are tracked."""
    terms = np.column_stack([np.ones(len(pixels)), pixels - pixels.mean(axis=0)])
    for _ in range(2):
        if tracked.sum() < MIN_TRACKED:
            return np.zeros_like(velocity)
        fitted = terms @ np.linalg.lstsq(terms[tracked], velocity[tracked], rcond=None)[0]
        deviation = np.linalg.norm(velocity - fitted, axis=1)
        tracked = tracked & (deviation <= MAX_VELOCITY_ERROR * max(float(np.median(deviation[tracked])), 1e-3))
    return np.asarray(fitted)


def corrected_to_middle_row(
    observations: Observations, velocity: FloatArray, readout: float, height_px: int
) -> Observations:
    """Correct corners to their positions at the exposure of the middle row."""
    delay = readout * (observations.pixels[:, 1] / (height_px - 1) - 0.5)
    return replace(observations, pixels=observations.pixels - delay[:, None] * velocity)


def rolling_shutter(
    selection: ModelSelection, observations: Observations, velocity: FloatArray, height_px: int
) -> Shutter | None:
    """Estimate the readout that best fits the inliers of a solution; None if no corner moves.

    Parameters
    ----------
    selection
        The model, fitted to uncorrected corners.
    observations
        The uncorrected corners.
    velocity
        Their velocities (n, 2), px per frame.
    height_px
        Number of rows of the sensor.
    """
    solution = selection.solution
    rows, velocity_inliers = observations.where(solution.inliers), velocity[solution.inliers]
    cost_at_zero, cost_at_trial, cost_at_double = (
        _cost(selection, corrected_to_middle_row(rows, velocity_inliers, readout, height_px))
        for readout in (0.0, TRIAL_READOUT, 2.0 * TRIAL_READOUT)
    )
    curvature = (cost_at_double - 2.0 * cost_at_trial + cost_at_zero) / (2.0 * TRIAL_READOUT**2)
    if curvature <= 0.0:
        return None
    readout = (cost_at_zero - cost_at_trial) / (2.0 * TRIAL_READOUT * curvature) + TRIAL_READOUT / 2.0
    degrees_of_freedom = (
        2 * len(rows)
        - len(solution.parameters)
        - solution.effective_frame_terms
        - 6 * len(solution.estimate.rig_from_board)
    )
    variance = (cost_at_zero - curvature * readout**2) / degrees_of_freedom
    drop = curvature * readout**2 / variance
    favoured = f_distribution.sf(drop, 1, degrees_of_freedom) < SUPPORTED_CHANCE and drop > np.log(2 * len(rows))
    corrected = corrected_to_middle_row(rows, velocity_inliers, readout, height_px)
    frames = len(np.unique(rows.frame))
    supported = bool(favoured and frames >= FOLDS and _gain_sigmas(selection, rows, corrected) > MIN_GAIN_SIGMAS)
    return Shutter(float(readout), float(np.sqrt(variance / curvature)), supported and 0.0 < abs(readout) <= 1.0)


def _cost(selection: ModelSelection, rows: Observations) -> float:
    model = selection.model
    estimate, _ = minimise(selection.solution.estimate, rows, model)
    r = rows.standardised(residuals(estimate, rows, model.board))
    return float(np.sum(r**2) + np.sum(model.frame_terms.values(estimate) ** 2))


def _gain_sigmas(selection: ModelSelection, rows: Observations, corrected: Observations) -> float:
    """Improvement of the prediction of held-out frames by corrected corners, in standard errors."""
    estimate, model = selection.solution.estimate, selection.model
    fold = balanced_folds(estimate, rows, model.board, FOLDS)
    uncorrected_errors, corrected_errors = (
        np.bincount(
            observed.frame,
            np.sum(observed.standardised(held_out_corners(estimate, observed, model, fold)) ** 2, axis=1),
        )
        for observed in (rows, corrected)
    )
    gains = uncorrected_errors - corrected_errors
    error = float(np.std(gains, ddof=1)) * float(np.sqrt(len(gains)))
    return float(gains.sum()) / error if error > 0.0 else 0.0
