"""Rotation of a camera between pictures, from the static scene: a tripod yields when the shutter is touched.

A rotation about the pupil moves every image point by the same homography, whatever the point's distance and whether it
is seen directly or in mirrors, so that the whole static scene determines it. Moving boards and hands do not agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.camera import Camera

FEATURES, FEATURE_QUALITY, FEATURE_GAP_PX = 6000, 0.003, 10.0
CELLS, PER_CELL = (16, 8), 8  # moving objects often have most texture: no part of the picture counts for more
WINDOW_PX, PYRAMID_LEVELS = (21, 21), 2
SETTLED = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
MAX_RETURN_PX, MAX_DIFFERENCE_GREY, MAX_MOVE_PX = 0.05, 10.0, 6.0
STATIC_PX = 0.4
DRAWS = 300
MIN_STATIC = 40


def camera_rotations(pictures: Sequence[Grey], camera: Camera) -> FloatArray | None:
    """Rotation vectors (n, 3), rad, from rays of the first picture to rays of each; None where undetermined.

    Random sample consensus over features tracked by the method of Lucas and Kanade, then least squares.
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
    """The corners where they would be if the camera had not rotated by `turns` (f, 3) since the first frame."""
    back = Rotation.from_rotvec(turns[observations.frame]).inv().as_matrix()
    rays = np.einsum("nij,nj->ni", back, camera.unproject(observations.pixels))
    return replace(observations, pixels=camera.project(rays))


def _tracked(first: Grey, other: Grey) -> tuple[FloatArray, FloatArray]:
    """Features (n, 2) of the first picture and their positions in the other, evenly over the picture."""
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
    # Features come by quality, so that the first of a cell are its best.
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], cell[order])
    kept = np.sort(order[np.arange(len(order)) - starts < PER_CELL])
    return here[kept], there[kept]


def _flowed(first: Grey, other: Grey, pixels: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Positions (n, 2) of points in the other picture, which were found (n,), and their mean grey difference (n,)."""
    seeds = pixels.astype(np.float32)[:, None]
    found, status, unlike = cv2.calcOpticalFlowPyrLK(
        first, other, seeds, seeds.copy(), winSize=WINDOW_PX, maxLevel=PYRAMID_LEVELS, criteria=SETTLED
    )
    seen = status.ravel() > 0
    # Where nothing was found, the difference is not set.
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
    """The rotation vector (3,) that takes rays (n, 3) to pixels (n, 2), by Gauss-Newton steps from a near one."""
    for _ in range(steps):
        rotated = rays @ Rotation.from_rotvec(turn).as_matrix().T
        pixels, by_ray, _ = camera.project_with_jacobians(rotated)
        by_turn = np.cross(rotated[:, None, :], by_ray)  # J (w x p) = w . (p x J)
        step = np.linalg.lstsq(by_turn.reshape(-1, 3), (there - pixels).ravel(), rcond=None)[0]
        turn = (Rotation.from_rotvec(step) * Rotation.from_rotvec(turn)).as_rotvec()
    return turn
