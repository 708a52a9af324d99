"""First estimate of mirrors from labels in the direct view and in each mirror.

A point X and its image X' in a mirror with the unit normal n differ by a multiple of n. So for their rays x and x',
n . (x x x') = 0: the essential matrix of a reflection is skew-symmetric, and two labelled points determine the normal.
Then X lies at the ratio of |X| to the mirror's distance that follows from x + l n || x'; points seen in several
mirrors give the ratios of their distances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.labels.consensus import row_table
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.camera import Camera

MIN_PAIRS = 5
"""Minimum number of points seen both directly and in a mirror."""
TRIALS = 500
TRIED_PAIRS = 2000
"""Maximum number of pairs on which trials are compared."""
ROUNDS = 10
INLIER_SIGMAS = 2.5
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, eq=False)
class MirrorStart:
    """A mirror's unit normal (3,), away from the camera, and what its pairs of labels say.

    `sigma_px` is the robust scatter of their distances from the constraint; `depth` (p,) the distance of each point
    along its ray with z = 1, in distances of the mirror, NaN for points that are not seen twice or do not fit.
    """

    normal: FloatArray
    sigma_px: float
    depth: FloatArray


def first_centres(
    camera: Camera, observations: Observations, points: int, view_names: tuple[str, ...]
) -> tuple[FloatArray, float]:
    """Return virtual centres (m, 3), the first mirror with most pairs at distance 1, and the scatter of labels in px.

    Raises InputError if a mirror has too few pairs, or no point connects it to the others.
    """
    mirrors = len(view_names) - 1
    table = row_table(observations, mirrors, points)
    rays = camera.unproject(observations.pixels)
    starts = []
    for m in range(mirrors):
        both = np.flatnonzero((table[:, 0] >= 0) & (table[:, 1 + m] >= 0))
        finite = np.isfinite(rays[table[both, 0]]).all(axis=1) & np.isfinite(rays[table[both, 1 + m]]).all(axis=1)
        both = both[finite]
        if len(both) < MIN_PAIRS:
            raise InputError(
                f"view {view_names[1 + m]!r}: {len(both)} points are labelled in it and in {view_names[0]!r} in the "
                f"same frame, expected at least {MIN_PAIRS}"
            )
        direct, image = rays[table[both, 0]], rays[table[both, 1 + m]]
        starts.append(_mirror_start(direct, image, both, points, camera.fx_px))
    distances = _distances(np.array([start.depth for start in starts]), view_names)
    centres = 2.0 * distances[:, None] * np.array([start.normal for start in starts])
    return centres, float(np.median([start.sigma_px for start in starts]))


def _mirror_start(direct: FloatArray, image: FloatArray, rows: FloatArray, points: int, focal_px: float) -> MirrorStart:
    """Estimate the normal from rays (n, 3) of points and of their images, robustly."""
    random = np.random.default_rng(0)
    cross = np.cross(direct, image)
    tried = random.permutation(len(cross))[:TRIED_PAIRS]
    first, second = random.integers(len(tried), size=(2, TRIALS))
    normals = np.cross(cross[tried[first]], cross[tried[second]])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 1e-12 * lengths.max()] / lengths[lengths > 1e-12 * lengths.max(), None]
    if not len(normals):
        normals = np.eye(3)
    scatter = [
        float(np.median(_distances_px(normal, direct[tried], image[tried], cross[tried], focal_px)[0]))
        for normal in normals
    ]
    # A median of few distances, minimised, is too small (Rousseeuw and Leroy, 1987).
    to_sigma = MAD_TO_SIGMA * (1.0 + 5.0 / max(len(cross) - 2, 1))
    normal, sigma = normals[int(np.argmin(scatter))], to_sigma * min(scatter)
    for _ in range(ROUNDS):
        errors, slopes = _distances_px(normal, direct, image, cross, focal_px)
        near = errors <= INLIER_SIGMAS * max(sigma, 1e-9)
        weighted = cross[near] / slopes[near, None]
        normal = np.linalg.eigh(weighted.T @ weighted)[1][:, 0]
        sigma = to_sigma * float(np.median(_distances_px(normal, direct, image, cross, focal_px)[0]))
    near = _distances_px(normal, direct, image, cross, focal_px)[0] <= INLIER_SIGMAS * max(sigma, 1e-9)
    normal, depth = _oriented(normal, direct, image, near)
    depths = np.full(points, np.nan)
    depths[rows[near]] = depth[near]
    return MirrorStart(normal, sigma, depths)


def _distances_px(
    normal: FloatArray, direct: FloatArray, image: FloatArray, cross: FloatArray, focal_px: float
) -> tuple[FloatArray, FloatArray]:
    """Sampson distances (n,) of pairs from the constraint, px, and its slopes (n,) in normalized coordinates."""
    slopes = np.sqrt(
        np.sum(np.cross(normal, direct)[:, :2] ** 2, axis=1) + np.sum(np.cross(normal, image)[:, :2] ** 2, axis=1)
    )
    slopes = np.maximum(slopes, 1e-12)
    return np.abs(cross @ normal) / slopes * focal_px, slopes


@np.errstate(invalid="ignore", divide="ignore")
def _oriented(
    normal: FloatArray, direct: FloatArray, image: FloatArray, near: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the normal with the sign for which points lie in front of camera and mirror, and their depths (n,).

    In b x - a x' = -l n, the scalars b and a are the depths of point and image, and l > 0 is twice the distance of the
    point from the mirror, 2 (d - b n.x). With l = 1, the depths give b / d = 2 b / (1 + 2 b n.x).
    """
    options = []
    for sign in (1.0, -1.0):
        n = sign * normal
        # Least squares by the normal equations of each pair.
        xx, yy, xy = np.sum(direct**2, axis=1), np.sum(image**2, axis=1), np.sum(direct * image, axis=1)
        xn, yn = direct @ n, image @ n
        determinant = xx * yy - xy**2
        b, a = (xy * yn - yy * xn) / determinant, (xx * yn - xy * xn) / determinant
        depth = 2.0 * b / (1.0 + 2.0 * b * xn)
        in_front = (a > 0.0) & (b > 0.0) & (depth > 0.0) & near
        options.append((int(in_front.sum()), n, np.where(in_front, depth, np.nan)))
    _, normal, depth = max(options, key=lambda option: option[0])
    return normal, depth


def _distances(depth: FloatArray, view_names: tuple[str, ...]) -> FloatArray:
    """Distances (m,) of the mirrors from points' depths (m, p) in units of each; the mirror with most points has 1."""
    known = np.isfinite(depth)
    distances = np.full(len(depth), np.nan)
    distances[int(known.sum(axis=1).argmax())] = 1.0
    while np.isnan(distances).any():
        placed = np.flatnonzero(np.isfinite(distances))
        common = known.astype(np.int64) @ known.T.astype(np.int64)
        common[placed] = -1
        other, reference = np.unravel_index(int(common[:, placed].argmax()), (len(depth), len(placed)))
        both = known[other] & known[placed[reference]]
        if not both.any():
            raise InputError(
                f"view {view_names[1 + int(other)]!r} shares no point with another mirror, of the points that fit "
                "plane mirrors: label points of the same frame in both and in the direct view, in pixels of the "
                "complete picture instead of a crop"
            )
        ratio = float(np.median(depth[placed[reference], both] / depth[other, both]))
        distances[other] = ratio * distances[placed[reference]]
    return distances
