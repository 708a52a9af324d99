"""Motion while pictures are taken: of the camera between pictures, and of the board during readout.

A tripod yields when the shutter button is pressed. A rotation of the camera about the pupil moves every image point by
one homography, whatever the point's distance and whether it is mirrored, so the entire static scene determines it.
Moving boards and hands are outliers.

A rolling shutter exposes the rows of a frame one after another, which shears the image of a moving board. A corner in
row v of h is exposed (v / h - 1/2) of the readout after the middle row, and its velocity gives its position at the time
of the middle row. Velocities are measured between the frames before and after by Lucas-Kanade tracking, so a single
number describes the shutter: the readout of a frame as a fraction of the frame period.
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
CELLS, PER_CELL = (16, 8), 8  # moving objects often have the most texture: limits the weight of each part
SCENE_WINDOW_PX, BOARD_WINDOW_PX = (21, 21), (15, 15)
PYRAMID_LEVELS = 2
SETTLED = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
MAX_RETURN_PX, MAX_DIFFERENCE_GREY, MAX_MOVE_PX = 0.05, 10.0, 6.0
STATIC_PX = 0.4
DRAWS = 300
MIN_STATIC = 40
TRIED = 0.5
"""Readout at which the cost is evaluated, besides 0 and twice this, to fit a parabola."""
MIN_TRACKED = 6
STRAY = 3.0  # of the median distance between velocities and the field through the corners of their view


def camera_rotations(pictures: Sequence[Grey], camera: Camera) -> FloatArray | None:
    """Rotation vectors (n, 3), rad, from rays of the first picture to rays of each; None if undetermined.

    Random sample consensus over features tracked by Lucas-Kanade, then least squares.
    """
    turns = [np.zeros(3)]
    for picture in pictures[1:]:
        here, there = _tracked(pictures[0], picture)
        turn = None if len(here) < MIN_STATIC else _consensus(camera, here, there)
        if turn is None:
            return None
        turns.append(turn)
    return np.array(turns)


def stabilised(observations: Observations, camera: Camera, turns: FloatArray) -> Observations:
    """Correct corners for the camera's rotations `turns` (f, 3) since the first frame."""
    back = Rotation.from_rotvec(turns[observations.frame]).inv().as_matrix()
    rays = np.einsum("nij,nj->ni", back, camera.unproject(observations.pixels))
    return replace(observations, pixels=camera.project(rays))


def _tracked(first: Grey, other: Grey) -> tuple[FloatArray, FloatArray]:
    """Features (n, 2) of the first picture and their positions in the other, spread evenly over the picture."""
    found = cv2.goodFeaturesToTrack(first, FEATURES, FEATURE_QUALITY, FEATURE_GAP_PX)
    if found is None:
        return np.empty((0, 2)), np.empty((0, 2))
    here = np.asarray(found, dtype=np.float64).reshape(-1, 2)
    there, forward, unlike = _flowed(first, other, here)
    again, backward, _ = _flowed(other, first, there)
    good = forward & backward & (unlike < MAX_DIFFERENCE_GREY)
    good &= np.linalg.norm(again - here, axis=1) < MAX_RETURN_PX
    good &= np.linalg.norm(there - here, axis=1) < MAX_MOVE_PX
    here, there = here[good], there[good]
    cell = (here / np.array(first.shape[::-1]) * CELLS).astype(np.int64) @ [CELLS[1], 1]
    # Features are sorted by quality, so the first of a cell are its best.
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], cell[order])
    kept = np.sort(order[np.arange(len(order)) - starts < PER_CELL])
    return here[kept], there[kept]


def _flowed(first: Grey, other: Grey, pixels: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Track points: positions (n, 2) in the other picture, success (n,), and mean grey difference (n,)."""
    seeds = pixels.astype(np.float32)[:, None]
    found, status, unlike = cv2.calcOpticalFlowPyrLK(
        first, other, seeds, seeds.copy(), winSize=SCENE_WINDOW_PX, maxLevel=PYRAMID_LEVELS, criteria=SETTLED
    )
    seen = status.ravel() > 0
    # The difference of a lost point is undefined.
    difference = np.full(len(seen), np.inf)
    difference[seen] = unlike.ravel()[seen]
    return np.asarray(found, dtype=np.float64)[:, 0], seen, difference


def _consensus(camera: Camera, here: FloatArray, there: FloatArray) -> FloatArray | None:
    random = np.random.default_rng(0)
    rays = camera.unproject(here)
    best, most = np.zeros(3), 0
    for _ in range(DRAWS):
        pair = random.choice(len(here), 2, replace=False)
        turn = _refined(camera, rays[pair], there[pair], np.zeros(3), steps=2)
        count = int((np.linalg.norm(_turned(camera, rays, turn) - there, axis=1) < STATIC_PX).sum())
        if count > most:
            best, most = turn, count
    for _ in range(5):
        still = np.linalg.norm(_turned(camera, rays, best) - there, axis=1) < STATIC_PX
        if still.sum() < MIN_STATIC:
            return None
        best = _refined(camera, rays[still], there[still], best, steps=1)
    return best


def _turned(camera: Camera, rays: FloatArray, turn: FloatArray) -> FloatArray:
    return camera.project(rays @ Rotation.from_rotvec(turn).as_matrix().T)


def _refined(camera: Camera, rays: FloatArray, there: FloatArray, turn: FloatArray, *, steps: int) -> FloatArray:
    """Rotation vector (3,) from rays (n, 3) to pixels (n, 2), by Gauss-Newton steps from a nearby one."""
    for _ in range(steps):
        rotated = rays @ Rotation.from_rotvec(turn).as_matrix().T
        pixels, by_ray, _ = camera.project_with_jacobians(rotated)
        by_turn = np.cross(rotated[:, None, :], by_ray)  # J (w x p) = w . (p x J)
        step = np.linalg.lstsq(by_turn.reshape(-1, 3), (there - pixels).ravel(), rcond=None)[0]
        turn = (Rotation.from_rotvec(step) * Rotation.from_rotvec(turn)).as_rotvec()
    return turn


@dataclass(frozen=True)
class Shutter:
    """An estimated rolling shutter.

    `readout` is the readout of a frame as a fraction of the frame period, and `sigma` its standard deviation. It is
    `supported` if the likelihood, the information criterion and held-out frames all favour it.
    """

    readout: float
    sigma: float
    supported: bool


def corner_velocities(observations: Observations, adjacent: Sequence[tuple[Grey, Grey, Grey] | None]) -> FloatArray:
    """Velocities (n, 2) of corners, px per frame, smooth over each view; 0 where they cannot be measured.

    `adjacent` holds for each frame the picture before, its own, and the picture after.
    """
    found = np.zeros((len(observations), 2))
    for frame, pictures in enumerate(adjacent):
        rows = np.flatnonzero(observations.frame == frame)
        if pictures is None or not len(rows):
            continue
        before, own, after = pictures
        pixels = observations.pixels[rows]
        (back, seen_back), (ahead, seen_ahead) = (_flow(own, other, pixels) for other in (before, after))
        velocity, tracked = (ahead - back) / 2.0, seen_back & seen_ahead
        for view in np.unique(observations.view[rows]):
            of_view = observations.view[rows] == view
            found[rows[of_view]] = _smooth(pixels[of_view], velocity[of_view], tracked[of_view])
    return found


def _flow(own: Grey, other: Grey, pixels: FloatArray) -> tuple[FloatArray, np.ndarray]:
    seeds = pixels.astype(np.float32)[:, None]
    to, status, _ = cv2.calcOpticalFlowPyrLK(
        own, other, seeds, seeds.copy(), winSize=BOARD_WINDOW_PX, maxLevel=PYRAMID_LEVELS
    )
    return np.asarray(to - seeds, dtype=np.float64)[:, 0], status.ravel() > 0


def _smooth(pixels: FloatArray, velocity: FloatArray, tracked: np.ndarray) -> FloatArray:
    """Fit the velocities (n, 2) of a view by an affine function of the pixel, without outliers; 0 if few are known."""
    terms = np.column_stack([np.ones(len(pixels)), pixels - pixels.mean(axis=0)])
    for _ in range(2):
        if tracked.sum() < MIN_TRACKED:
            return np.zeros_like(velocity)
        fitted = terms @ np.linalg.lstsq(terms[tracked], velocity[tracked], rcond=None)[0]
        off = np.linalg.norm(velocity - fitted, axis=1)
        tracked = tracked & (off <= STRAY * max(float(np.median(off[tracked])), 1e-3))
    return np.asarray(fitted)


def at_middle_row(observations: Observations, velocity: FloatArray, readout: float, height_px: int) -> Observations:
    """Correct corners to their positions at the exposure of the middle row."""
    late = readout * ((observations.pixels[:, 1] + 0.5) / height_px - 0.5)
    return replace(observations, pixels=observations.pixels - late[:, None] * velocity)


def rolling_shutter(
    selection: ModelSelection, observations: Observations, velocity: FloatArray, height_px: int
) -> Shutter | None:
    """Estimate the readout that best explains the inliers of a fit; None if no corner moves.

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
    rows, moving = observations.where(solution.inliers), velocity[solution.inliers]
    none, half, full = (
        _cost(selection, at_middle_row(rows, moving, readout, height_px)) for readout in (0.0, TRIED, 2.0 * TRIED)
    )
    bend = (full - 2.0 * half + none) / (2.0 * TRIED**2)
    if bend <= 0.0:
        return None
    readout = (none - half) / (2.0 * TRIED * bend) + TRIED / 2.0
    spare = 2 * len(rows) - len(solution.parameters) - solution.frame_terms - 6 * len(solution.estimate.rig_from_board)
    variance = (none - bend * readout**2) / spare
    drop = bend * readout**2 / variance
    likely = f_distribution.sf(drop, 1, spare) < SUPPORTED_CHANCE and drop > np.log(2 * len(rows))
    shifted = at_middle_row(rows, moving, readout, height_px)
    frames = len(np.unique(rows.frame))
    supported = bool(likely and frames >= FOLDS and _gain(selection, rows, shifted) > MIN_GAIN_SIGMAS)
    return Shutter(float(readout), float(np.sqrt(variance / bend)), supported and 0.0 < abs(readout) <= 1.0)


def _cost(selection: ModelSelection, rows: Observations) -> float:
    model = selection.model
    estimate, _ = minimise(selection.solution.estimate, rows, model)
    r = rows.standardised(residuals(estimate, rows, model.board))
    return float(np.sum(r**2) + np.sum(model.frame_terms.values(estimate) ** 2))


def _gain(selection: ModelSelection, rows: Observations, shifted: Observations) -> float:
    """Standard errors by which held-out frames are predicted better with corrected corners."""
    estimate, model = selection.solution.estimate, selection.model
    fold = balanced_folds(estimate, rows, model.board, FOLDS)
    plain, better = (
        np.bincount(some.frame, np.sum(some.standardised(held_out_corners(estimate, some, model, fold)) ** 2, axis=1))
        for some in (rows, shifted)
    )
    gains = plain - better
    error = float(np.std(gains, ddof=1)) * float(np.sqrt(len(gains)))
    return float(gains.sum()) / error if error > 0.0 else 0.0
