"""The labels of each point that agree on its position, without those that are wrong, swapped or in another view.

Two labels give a position, and the others of the point agree with it or do not. Of all pairs, the one with which most
labels agree is taken. Labels exchanged between the direct view and a mirror satisfy the mirror's constraint, but their
point lies behind the mirror.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.labels.point_adjustment import (
    POINT,
    linearized_rows,
    points_estimate,
    points_of,
    sums_by_point,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate, residuals
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import reflect

MAX_PAIRS = 20
"""Maximum number of pairs of views from which positions are tried."""
FIRST_SIGMAS = 6.0
"""Largest error of a label that agrees with the position from two others, which is uncertain itself."""
CHANCE = 1e-4
"""Probability of rejecting a correct point or label by noise."""
STEPS = 3


@dataclass(frozen=True, eq=False)
class Consensus:
    """Labels that agree: the points (p, 3) of all numbers, NaN if unknown, and the mask (n,) of the labels used."""

    points: FloatArray
    used: BoolArray

    def fitted(self, camera: Camera, centres: FloatArray, observations: Observations) -> tuple[Estimate, Observations]:
        """Return the estimate of the known points only, and their used labels with points numbered accordingly."""
        rows = observations.where(self.used)
        known, numbers = np.unique(rows.frame, return_inverse=True)
        return points_estimate(camera, centres, self.points[known]), replace(rows, frame=numbers)

    def with_points(self, points: FloatArray, observations: Observations) -> Consensus:
        """Replace the known points by those (k, 3) of a fit."""
        updated = self.points.copy()
        updated[np.unique(observations.frame[self.used])] = points
        return replace(self, points=updated)


def row_table(observations: Observations, mirrors: int, points: int) -> IntArray:
    """Row numbers (p, 1 + m) of each point's labels: the direct view, then the mirrors; -1 without a label."""
    table = np.full((points, 1 + mirrors), -1)
    table[observations.frame, observations.view - DIRECT] = np.arange(len(observations))
    return table


def predicted_pixels(camera: Camera, centres: FloatArray, points: FloatArray) -> FloatArray:
    """Pixels (p, 1 + m, 2) of points (p, 3) in all views; NaN where they are behind the camera or a mirror."""
    images = [points]
    for centre in centres:
        behind = points @ centre >= centre @ centre / 2.0
        images.append(np.where(behind[:, None], np.nan, reflect(points, centre)))
    return camera.project(np.stack(images, axis=1))


@np.errstate(invalid="ignore", divide="ignore")
def consistent_labels(camera: Camera, centres: FloatArray, observations: Observations, points: int) -> Consensus:
    """Return the labels that agree, for a known camera and virtual centres (m, 3).

    Parameters
    ----------
    camera, centres
        The camera, and the mirrors.
    observations
        All labels, with points numbered by `frame`, and their standard deviations.
    points
        Number of points.
    """
    table = row_table(observations, len(centres), points)
    seen = table >= 0
    pixels, limit = observations.pixels[table], FIRST_SIGMAS * observations.sigma_px[table]
    origins, directions = _lines(camera, centres, observations, table)
    best, best_cost = np.full((points, 3), np.nan), np.full(points, np.inf)
    agreeing_pairs = np.zeros(points, dtype=np.int64)
    squared_limit = np.where(seen, limit**2, 0.0)
    for a, b in list(combinations(range(1 + len(centres)), 2))[:MAX_PAIRS]:
        both = np.flatnonzero(seen[:, a] & seen[:, b])
        position = _midpoints(origins[a], directions[both, a], origins[b], directions[both, b])
        squared = np.sum((predicted_pixels(camera, centres, position) - pixels[both]) ** 2, axis=2)
        squared = np.where(squared < squared_limit[both], squared, squared_limit[both])
        agree = squared < squared_limit[both]
        agreeing_pairs[both] += agree[:, a] & agree[:, b]
        cost = np.where(agree.sum(axis=1) >= 2, squared.sum(axis=1), np.inf)
        better = cost < best_cost[both]
        best[both[better]], best_cost[both[better]] = position[better], cost[better]
    errors = np.sum((predicted_pixels(camera, centres, best) - pixels) ** 2, axis=2)
    agree = seen & (errors < squared_limit)
    # Two labels of three or more that agree, as two others do: nothing tells which of them are wrong.
    agree[(agree.sum(axis=1) < 2) | ((agree.sum(axis=1) == 2) & (agreeing_pairs > 1))] = False
    used = np.zeros(len(observations), dtype=bool)
    used[table[agree]] = True
    return _without_outliers(camera, centres, observations, Consensus(best, used))


def _lines(
    camera: Camera, centres: FloatArray, observations: Observations, table: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Lines of sight of labels in space: origins (1 + m, 3) and unit directions (p, 1 + m, 3), unfolded at mirrors."""
    rays = camera.unproject(observations.pixels)[table]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    for m, centre in enumerate(centres):
        unit = centre / np.linalg.norm(centre)
        rays[:, 1 + m] -= 2.0 * (rays[:, 1 + m] @ unit)[:, None] * unit
    return np.concatenate([np.zeros((1, 3)), centres]), rays


def _midpoints(origin_a: FloatArray, a: FloatArray, origin_b: FloatArray, b: FloatArray) -> FloatArray:
    """Points (n, 3) halfway between lines with unit directions (n, 3) where they are nearest to each other."""
    between = origin_a - origin_b
    cosine = np.sum(a * b, axis=1)
    along_a, along_b = a @ between, b @ between
    sine_squared = 1.0 - cosine**2
    s = (cosine * along_b - along_a) / sine_squared
    t = (along_b - cosine * along_a) / sine_squared
    return np.asarray((origin_a + s[:, None] * a + origin_b + t[:, None] * b) / 2.0)


def _without_outliers(
    camera: Camera, centres: FloatArray, observations: Observations, consensus: Consensus
) -> Consensus:
    """Move the points to their least squares, and drop the worst label of each that does not fit, until all do."""
    for _ in range(len(centres)):
        estimate, rows = consensus.fitted(camera, centres, observations)
        if not len(rows):
            return consensus
        estimate = refine_points(estimate, rows)
        consensus = consensus.with_points(points_of(estimate), observations)
        linear = linearized_rows(estimate, rows, np.zeros(0, dtype=np.int64))
        squares = sums_by_point(np.sum(linear.r**2, axis=1), rows)
        counts = np.bincount(rows.frame)
        bad = ~(squares < chi2.isf(CHANCE, 2 * counts - 3))
        if not bad.any():
            break
        drop = bad[rows.frame] & ((counts[rows.frame] == 2) | _is_worst(linear.r, linear.d_point, rows))
        used = consensus.used.copy()
        used[np.flatnonzero(used)[drop]] = False
        consensus = replace(consensus, used=used)
    # The last round dropped labels of points that no further round tests.
    alone = np.bincount(observations.frame[consensus.used], minlength=len(consensus.points)) < 2
    return replace(consensus, used=consensus.used & ~alone[observations.frame])


def _is_worst(r: FloatArray, d_point: FloatArray, rows: Observations) -> NDArray[np.bool_]:
    """Mask (n,) of the label of each point whose removal lowers the squares most: by r (1 - H)^-1 r, H = J V^-1 J."""
    inverse = np.linalg.pinv(sums_by_point(d_point.transpose(0, 2, 1) @ d_point, rows))[rows.frame]
    remaining = (1.0 + 1e-9) * np.eye(2) - d_point @ inverse @ d_point.transpose(0, 2, 1)
    lowered = np.sum(r * np.linalg.solve(remaining, r[:, :, None])[:, :, 0], axis=1)
    order = np.lexsort((lowered, rows.frame))
    worst = np.zeros(len(rows), dtype=bool)
    worst[order[np.flatnonzero(np.diff(rows.frame[order], append=-1))]] = True
    return worst


def refine_points(estimate: Estimate, rows: Observations) -> Estimate:
    """Move each point to its least squares by Gauss-Newton steps; a step that raises its squares is not taken."""
    none = np.zeros(0, dtype=np.int64)
    for _ in range(STEPS):
        linear = linearized_rows(estimate, rows, none)
        transposed = linear.d_point.transpose(0, 2, 1)
        matrix = sums_by_point(transposed @ linear.d_point, rows)
        gradient = sums_by_point(transposed @ linear.r[:, :, None], rows)
        matrix += 1e-9 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        moved = points_of(estimate) - np.linalg.solve(matrix, gradient)[:, :, 0]
        trial = points_estimate(estimate.camera, estimate.virtual_centres_in_rig_mm, moved)
        before = sums_by_point(np.sum(linear.r**2, axis=1), rows)
        after = sums_by_point(np.sum(rows.standardised(residuals(trial, rows, POINT)) ** 2, axis=1), rows)
        better = after <= before  # false where the point is not visible
        points = np.where(better[:, None], moved, points_of(estimate))
        estimate = points_estimate(estimate.camera, estimate.virtual_centres_in_rig_mm, points)
    return estimate
