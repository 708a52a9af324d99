"""Rolling shutter: rows of a frame are exposed one after another, so that a moving board is seen sheared.

A corner in row v of h is seen (v / h - 1/2) of the readout after the middle row, and its velocity says where it was
then. Velocities are measured between the frames before and after, by the method of Lucas and Kanade, so that one number
describes the shutter: the readout of a frame as a part of the time from frame to frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.stats import f as f_distribution

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.diagnostics.cross_validation import balanced_folds, held_out_corners
from mirrorcam.optics.calibration.diagnostics.model_comparison import FOLDS, MIN_GAIN_SIGMAS, SUPPORTED_CHANCE
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection
from mirrorcam.optics.calibration.solver.levenberg_marquardt import minimise
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import residuals

WINDOW_PX, PYRAMID_LEVELS = (15, 15), 2
TRIED = 0.5
"""Readout at which the cost is computed beside 0 and twice this: a parabola goes through the three."""
MIN_TRACKED = 6
STRAY = 3.0  # of the median distance of velocities from those of the other corners of their view


@dataclass(frozen=True)
class Shutter:
    """A rolling shutter that the corners tell.

    `readout` is that of a frame, as a part of the time from frame to frame, and `sigma` its standard deviation; it is
    `supported` where the likelihood, the information criterion and frames left out all speak for it.
    """

    readout: float
    sigma: float
    supported: bool


def corner_velocities(observations: Observations, beside: Sequence[tuple[Grey, Grey, Grey] | None]) -> FloatArray:
    """Velocities (n, 2) of corners, px per frame, smooth over each view; 0 where they cannot be measured.

    `beside` has for each frame the picture before, its own, and the one after.
    """
    found = np.zeros((len(observations), 2))
    for frame, pictures in enumerate(beside):
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
        own, other, seeds, seeds.copy(), winSize=WINDOW_PX, maxLevel=PYRAMID_LEVELS
    )
    return np.asarray(to - seeds, dtype=np.float64)[:, 0], status.ravel() > 0


def _smooth(pixels: FloatArray, velocity: FloatArray, tracked: np.ndarray) -> FloatArray:
    """The velocities (n, 2) of a view as an affine function of the pixel, without stray ones; 0 where few are known."""
    terms = np.column_stack([np.ones(len(pixels)), pixels - pixels.mean(axis=0)])
    for _ in range(2):
        if tracked.sum() < MIN_TRACKED:
            return np.zeros_like(velocity)
        fitted = terms @ np.linalg.lstsq(terms[tracked], velocity[tracked], rcond=None)[0]
        off = np.linalg.norm(velocity - fitted, axis=1)
        tracked = tracked & (off <= STRAY * max(float(np.median(off[tracked])), 1e-3))
    return np.asarray(fitted)


def at_middle_row(observations: Observations, velocity: FloatArray, readout: float, height_px: int) -> Observations:
    """The corners where they would be had every row been exposed with the middle one."""
    late = readout * ((observations.pixels[:, 1] + 0.5) / height_px - 0.5)
    return replace(observations, pixels=observations.pixels - late[:, None] * velocity)


def rolling_shutter(
    selection: ModelSelection, observations: Observations, velocity: FloatArray, height_px: int
) -> Shutter | None:
    """The readout that explains the inliers of a fit best; None where no corner moves.

    Parameters
    ----------
    selection
        The model, fitted to corners as they are.
    observations
        These corners.
    velocity
        Their velocities (n, 2), px per frame.
    height_px
        Number of rows of the sensor.
    """
    solution = selection.solution
    rows, moving = observations.where(solution.inliers), velocity[solution.inliers]
    none, half, whole = (
        _cost(selection, at_middle_row(rows, moving, readout, height_px)) for readout in (0.0, TRIED, 2.0 * TRIED)
    )
    bend = (whole - 2.0 * half + none) / (2.0 * TRIED**2)
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
    left = rows.standardised(residuals(estimate, rows, model.board))
    return float(np.sum(left**2) + np.sum(model.frame_terms.values(estimate) ** 2))


def _gain(selection: ModelSelection, rows: Observations, shifted: Observations) -> float:
    """By how many standard errors frames left out are predicted better with the corners shifted."""
    estimate, model = selection.solution.estimate, selection.model
    fold = balanced_folds(estimate, rows, model.board, FOLDS)
    plain, better = (
        np.bincount(some.frame, np.sum(some.standardised(held_out_corners(estimate, some, model, fold)) ** 2, axis=1))
        for some in (rows, shifted)
    )
    gains = plain - better
    error = float(np.std(gains, ddof=1)) * float(np.sqrt(len(gains)))
    return float(gains.sum()) / error if error > 0.0 else 0.0
