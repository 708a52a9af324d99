"""Calibration of mirrors from labelled points, without a board: robust start, bundle adjustment, scale, result.

The rounds alternate between the labels that agree for the current mirrors (`consensus`) and the least squares of
camera, mirrors and points (`point_adjustment`). They begin on some of the points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.calibration.labels.consensus import Consensus, consistent_labels
from mirrorcam.optics.calibration.labels.label_start import first_centres
from mirrorcam.optics.calibration.labels.label_table import LabelTable
from mirrorcam.optics.calibration.labels.point_adjustment import (
    POINT,
    CameraPrior,
    adjust,
    points_of,
    sums_by_point,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError
from mirrorcam.optics.calibration.solver.observations import IntArray, Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate, residuals
from mirrorcam.optics.geometry.camera import Camera

FIRST_POINTS, TRIED_POINTS = 2000, 300
"""Numbers of points in the first rounds, and where several focal lengths are tried."""
FIRST_ROUNDS, ROUNDS = 8, 5
SETTLED = 0.002
"""Fraction of labels whose use changes in a round, below which the rounds end."""
FOCAL_LENGTHS = (1.1, 0.8, 1.5, 0.6, 2.2)
"""Focal lengths of common cameras, in widths of the picture, the likeliest first."""
WIDE_FOCAL = 0.15
"""Relative standard deviation of the prior of the focal length from which others are tried."""
BETTER = 0.95
"""Ratio of the scatter for which another focal length counts as better."""
MAX_REJECTED = 0.5
MAX_NOISE = 0.02
"""Maximum standard deviation of labels, in diagonals of the picture."""
MIN_SIGMA_PX = 1e-4
SQUARE_PIXELS = 0.002
"""Standard deviation of fy / fx from 1."""
PRINCIPAL_POINT = 0.02
"""Standard deviation of the principal point from the middle of the picture, in widths of the picture."""
DISTORTION_SIGMAS = (0.15, 0.1, 0.002, 0.002, 0.0)
"""Standard deviations of k1, k2, p1, p2 and k3 of an ordinary lens."""
UNKNOWN_FOCAL = (1.1, 0.5)
"""Focal length of an unknown camera and its standard deviation, in widths of the picture."""


@dataclass(frozen=True, eq=False)
class LabelFit:
    """A fit of labels, before its scale is known.

    Attributes
    ----------
    observations
        All labels of points with two labels or more, with points numbered by `frame`.
    consensus
        The points, and the labels used.
    estimate, rows
        The fit of the points with agreeing labels, and these labels with the points numbered accordingly.
    prior
        What was known of the camera.
    sigma_px
        Standard deviation of a label.
    iterations
        Number of linearisations.
    """

    observations: Observations
    consensus: Consensus
    estimate: Estimate
    rows: Observations
    prior: CameraPrior
    sigma_px: float
    iterations: int


def data_sheet_prior(width_px: int, height_px: int, focal_px: float, focal_sigma_px: float) -> CameraPrior:
    """Return the prior of a camera of which only a focal length and its standard deviation are stated.

    Pixels are nearly square, the principal point is near the middle, and the distortion is that of an ordinary lens.
    """
    camera = Camera(
        width_px=width_px,
        height_px=height_px,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=(width_px - 1) / 2.0,
        cy_px=(height_px - 1) / 2.0,
    )
    covariance = np.zeros((9, 9))
    covariance[:2, :2] = focal_sigma_px**2 + np.diag([0.0, (SQUARE_PIXELS * focal_px) ** 2])
    covariance[[2, 3], [2, 3]] = (PRINCIPAL_POINT * width_px) ** 2
    covariance[range(4, 9), range(4, 9)] = np.square(DISTORTION_SIGMAS)
    covariance[0, 0] += (1e-3 * SQUARE_PIXELS * focal_px) ** 2  # keeps it regular
    return CameraPrior(camera, covariance)


def unknown_camera(width_px: int, height_px: int) -> CameraPrior:
    """Return the prior of a camera of which only the size of its pictures is known."""
    focal, sigma = (value * width_px for value in UNKNOWN_FOCAL)
    return data_sheet_prior(width_px, height_px, focal, sigma)


def label_observations(table: LabelTable) -> tuple[Observations, IntArray, IntArray]:
    """Labels of points that are seen in two views or more, and the frame and label (p,) of each point."""
    keys = table.frame * len(table.labels) + table.label
    points, number, count = np.unique(keys, return_inverse=True, return_counts=True)
    kept = count >= 2
    if not kept.any():
        raise InputError("no point is labelled in two views of a frame, expected labels in the direct view and mirrors")
    renumbered = np.cumsum(kept) - 1
    rows = np.flatnonzero(kept[number])
    rows = rows[np.argsort(number[rows], kind="stable")]
    frame = renumbered[number[rows]]
    observations = Observations(frame, table.view[rows], np.zeros(len(rows), dtype=np.int64), table.pixels[rows])
    return observations, points[kept] // len(table.labels), points[kept] % len(table.labels)


def fit_labels(observations: Observations, prior: CameraPrior, view_names: tuple[str, ...]) -> LabelFit:
    """Fit camera, mirrors and points to labels, of which some are wrong.

    Parameters
    ----------
    observations
        Labels with points numbered by `frame`, each with two labels or more.
    prior
        What is known of the camera.
    view_names
        Names of the views: the direct one, then the mirrors.

    Raises
    ------
    InputError
        If the labels do not determine the mirrors, or no mirrors explain half of them.
    """
    cameras = _cameras(prior)
    first = _some_points(observations, FIRST_POINTS if len(cameras) == 1 else TRIED_POINTS)
    best: LabelFit | None = None
    refusals = []
    for camera in cameras:
        try:
            start = _rounds(first, camera, None, None, prior, view_names, FIRST_ROUNDS)
        except InputError as error:
            refusals.append(error)
            continue
        if best is None or start.sigma_px < BETTER * best.sigma_px:
            best = start
    if best is None:
        raise refusals[0]
    if len(first) < len(observations):
        estimate = best.estimate
        best = _rounds(
            observations,
            estimate.camera,
            estimate.virtual_centres_in_rig_mm,
            best.sigma_px,
            prior,
            view_names,
            ROUNDS,
        )
    rejected = 1.0 - len(best.rows) / len(observations)
    noise = best.sigma_px / float(np.hypot(prior.camera.width_px, prior.camera.height_px))
    if rejected > MAX_REJECTED or noise > MAX_NOISE:
        reason = f"{rejected:.0%} of the labels contradict flat mirrors, the others scatter by {best.sigma_px:.2g} px"
        raise InputError(
            f"{reason}: are they in pixels of the whole frame as the camera gives it, not flipped or cropped, and is "
            "the first view the direct one?"
        )
    return best


def _some_points(observations: Observations, count: int) -> Observations:
    """Labels of randomly chosen points, numbered anew."""
    points = int(observations.frame[-1]) + 1
    if points <= count:
        return observations
    chosen = np.zeros(points, dtype=bool)
    chosen[np.random.default_rng(0).permutation(points)[:count]] = True
    rows = observations.where(chosen[observations.frame])
    return replace(rows, frame=(np.cumsum(chosen) - 1)[rows.frame])


def _cameras(prior: CameraPrior) -> list[Camera]:
    """Cameras to start from: the known one, or several if its focal length is nearly unknown."""
    camera = prior.camera
    if np.sqrt(prior.covariance[0, 0]) < WIDE_FOCAL * camera.fx_px:
        return [camera]
    focal_lengths = [focal * camera.width_px for focal in FOCAL_LENGTHS]
    return [camera.replaced(fx_px=focal, fy_px=focal) for focal in focal_lengths]


def _rounds(
    observations: Observations,
    camera: Camera,
    centres: FloatArray | None,
    sigma_px: float | None,
    prior: CameraPrior,
    view_names: tuple[str, ...],
    rounds: int,
) -> LabelFit:
    """Alternate between choosing labels and least squares, from virtual centres (m, 3) or from the labels alone."""
    points = int(observations.frame[-1]) + 1
    if centres is None or sigma_px is None:
        centres, sigma_px = first_centres(camera, observations, points, view_names)
    iterations, previous = 0, np.zeros(len(observations), dtype=bool)
    for _ in range(rounds):
        weighted = replace(observations, sigma_px=np.full(len(observations), max(sigma_px, MIN_SIGMA_PX)))
        consensus = consistent_labels(camera, centres, weighted, points)
        estimate, rows = consensus.fitted(camera, centres, weighted)
        _check_views(rows, view_names)
        try:
            estimate, steps = adjust(estimate, rows, prior)
        except (UndeterminedError, InvalidValue) as error:
            raise InputError(f"the labels do not determine the mirrors: {error}") from None
        camera, centres = estimate.camera, estimate.virtual_centres_in_rig_mm
        iterations += steps
        sigma_px = _scatter(estimate, rows)
        changed = np.mean(consensus.used != previous)
        previous = consensus.used
        if changed <= SETTLED:
            break
    consensus = consensus.with_points(points_of(estimate), weighted)
    sigma_px = _residual_sigma(estimate, rows, prior)
    rows = replace(rows, sigma_px=np.full(len(rows), sigma_px))
    return LabelFit(weighted, consensus, estimate, rows, prior, sigma_px, iterations)


def _check_views(rows: Observations, view_names: tuple[str, ...]) -> None:
    """Raise InputError for a mirror of which no label agrees with another view."""
    for mirror, name in enumerate(view_names[1:]):
        if not (rows.view == mirror).any():
            raise InputError(f"view {name!r}: its labels agree with no other view, expected those of a flat mirror")


def _residual_sigma(estimate: Estimate, rows: Observations, prior: CameraPrior) -> float:
    """Standard deviation of the labels used, px, by their squares and degrees of freedom."""
    unknowns = 3 * len(estimate.rig_from_board) + 3 * len(estimate.virtual_centres_in_rig_mm) - 1 + len(prior.free)
    squares = float(np.sum(residuals(estimate, rows, POINT) ** 2))
    if 2 * len(rows) <= unknowns:
        raise InputError(f"{len(rows)} labels agree, for {unknowns} unknowns, expected more points in several views")
    return max(float(np.sqrt(squares / (2 * len(rows) - unknowns))), MIN_SIGMA_PX)


def _scatter(estimate: Estimate, rows: Observations) -> float:
    """Standard deviation of labels, px, by the median over points of their squares and degrees of freedom."""
    squares = sums_by_point(np.sum(residuals(estimate, rows, POINT) ** 2, axis=1), rows)
    counts = np.bincount(rows.frame)
    return max(float(np.sqrt(np.median(squares / chi2.median(2 * counts - 3)))), MIN_SIGMA_PX)
