"""The pose of a light field relative to a key frame's landmarks, with its covariance, from a closed-form start.

A landmark is a patch of the key frame's reference view: its direction a = (X / Z, Y / Z) is exact, because the patch
defines it, and its inverse distance w = 1 / Z has a standard deviation. Aligning all views of another light field with
the patch gives its direction and inverse distance there: a light field at frame_from_key = [R | t] sees it at
q = R (a, 1) + t w, in direction (q_x, q_y) / q_z with inverse distance w / q_z. Poses are updated by
exp(xi) frame_from_key, xi = (translation in mm, rotation in radians) in the frame's axes.

The start is the rigid motion between two sets of points with outliers, in closed form within RANSAC: Horn, "Closed-form
solution of absolute orientation using unit quaternions", JOSA A 1987, by the singular value decomposition of Umeyama,
PAMI 1991; Fischler and Bolles, "Random sample consensus", CACM 1981.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.optics.light_field.features.align import PatchWarp, align
from mirrorcam.optics.light_field.features.keypoints import grey_views, inner_masks
from mirrorcam.optics.light_field.features.light_field_features import in_masks
from mirrorcam.optics.light_field.features.patches import WIDE, ImagePyramid, Templates
from mirrorcam.optics.light_field.features.patches import templates as build_templates
from mirrorcam.optics.light_field.features.slope import ViewGeometry, agreeing_views, fit_slope, moderated_variance
from mirrorcam.optics.light_field.light_field import LightField

MIN_CORRELATION = 0.8
PRIOR_DEGREES_OF_FREEDOM = 4.0
ROUNDS = 12
# Squared error of three components, in typical variances, above which a landmark is an outlier.
OUTLIER = 16.0
MEDIAN_OF_THREE = 2.366
"""Median of the chi-squared distribution of three degrees of freedom."""
MIN_LANDMARKS = 8
GRID_CELLS = 7
TRIALS = 256
SAMPLE_SIZE = 3
MIN_INLIERS = 8


@dataclass(frozen=True, eq=False)
class Frame:
    """Grey views of a light field (t * s, v, u) in a pyramid, and masks of their valid pixels."""

    pyramid: ImagePyramid
    inner: NDArray[np.uint8]

    @classmethod
    def of(cls, light_field: LightField) -> Frame:
        images = grey_views(light_field)
        grid = images.reshape(light_field.rows, light_field.cols, *images.shape[1:])
        return cls(ImagePyramid(grid), inner_masks(light_field))


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Landmarks (n) of a key frame.

    Attributes
    ----------
    directions
        Directions (n, 2) from the reference view.
    inverse_distance, sigma_per_mm
        Inverse distances (n,) and the standard deviations of their noise, both 1/mm.
    shape_sigma_per_mm
        Standard deviations (n,) from the uncertainty of the surfaces' shapes. The error of a patch's apparent
        inverse distance is then the same from wherever it is seen.
    shapes
        Shapes (n, 9) of the surfaces, as in `AlignedPatches`.
    templates
        Templates of the patches.
    """

    directions: FloatArray
    inverse_distance: FloatArray
    sigma_per_mm: FloatArray
    shape_sigma_per_mm: FloatArray
    shapes: FloatArray
    templates: list[Templates]


@dataclass(frozen=True, eq=False)
class Observations:
    """Observations of landmarks (n) in a light field.

    Attributes
    ----------
    valid
        Mask (n,) of the visible landmarks; all other values are undefined elsewhere.
    directions, covariance
        Directions (n, 2) and covariances (n, 2, 2).
    inverse_distance, sigma_per_mm, shape_sigma_per_mm, shapes
        As in `Landmarks`.
    """

    valid: NDArray[np.bool_]
    directions: FloatArray
    covariance: FloatArray
    inverse_distance: FloatArray
    sigma_per_mm: FloatArray
    shape_sigma_per_mm: FloatArray
    shapes: FloatArray


def build_landmarks(
    geometry: ViewGeometry,
    frame: Frame,
    directions: FloatArray,
    inverse_distance: FloatArray,
    scale_px: FloatArray,
    run: Any,
) -> Landmarks:
    """Create landmarks at directions (n, 2) and inverse distances (n,), if most views of the light field see them."""
    pixels = geometry.focal_px[geometry.reference] * directions + geometry.centre_px[geometry.reference]
    templates = build_templates(frame.pyramid, geometry.reference, pixels, scale_px, WIDE)
    observed = observe(
        geometry, frame, templates, directions, inverse_distance, PatchWarp.identity(len(directions)), run
    )
    indices = np.flatnonzero(observed.valid)
    return Landmarks(
        directions=directions[indices],
        inverse_distance=observed.inverse_distance[indices],
        sigma_per_mm=observed.sigma_per_mm[indices],
        shape_sigma_per_mm=observed.shape_sigma_per_mm[indices],
        shapes=observed.shapes[indices],
        templates=build_templates(frame.pyramid, geometry.reference, pixels[indices], scale_px[indices], WIDE),
    )


def observe(
    geometry: ViewGeometry,
    frame: Frame,
    templates: list[Templates],
    directions: FloatArray,
    inverse_distance: FloatArray,
    warp: PatchWarp,
    run: Callable[..., Any],
    max_distance_px: float = 0.5,
) -> Observations:
    """Align the views of a light field with patches expected at directions (n, 2) and inverse distances (n,).

    `warp` maps the patches into the views.
    """
    views = np.arange(len(geometry.focal_px))
    start = np.stack([geometry.predict(int(view), directions, inverse_distance) for view in views])
    start[~in_masks(frame.inner, start)] = np.nan
    distance = 1.0 / np.maximum(inverse_distance, 1e-6)
    aligned = align(frame.pyramid, templates, views, start, geometry.lateral_mm, distance, run, warp)
    matches = (aligned.correlation >= MIN_CORRELATION) & in_masks(frame.inner, aligned.pixels)
    observed_px = np.where(matches[..., None], aligned.pixels, np.nan)
    mean = np.trace(aligned.precision, axis1=1, axis2=2) / 2.0
    precision = aligned.precision / mean[:, None, None]
    used = agreeing_views(geometry, observed_px, inverse_distance, precision, max_distance_px)
    fit = fit_slope(geometry, observed_px, used, inverse_distance, precision)
    scale = moderated_variance(fit.squares_px2, fit.dof, PRIOR_DEGREES_OF_FREEDOM)
    noise = np.maximum(scale, aligned.variance / mean)
    focal = geometry.focal_px[geometry.reference]
    # The patch's own noise shifts all views equally; the views' noise averages out.
    patch_factor = 1.0 + 1.0 / np.maximum(used.sum(axis=0), 1)
    valid = (used.sum(axis=0) > len(views) // 2) & (fit.inverse_distance > 0)
    variance = noise / np.where(valid, fit.information, 1.0)
    return Observations(
        valid=valid,
        directions=fit.directions,
        covariance=(noise * patch_factor)[:, None, None] * np.linalg.inv(precision) / focal**2,
        inverse_distance=fit.inverse_distance,
        sigma_per_mm=np.sqrt(variance),
        shape_sigma_per_mm=np.sqrt(aligned.shape_covariance[:, 0, 0]) / focal,
        shapes=aligned.shapes,
    )


@dataclass(frozen=True)
class SharedErrors:
    """Standard deviations of errors that landmarks share, which therefore do not average out.

    Attributes
    ----------
    neighbours
        Error of the directions of landmarks in one cell of the picture.
    common_per_mm
        Error of the inverse distances of all landmarks of a key frame, 1/mm.
    """

    neighbours: float
    common_per_mm: float


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A pose frame_from_key (4, 4), its covariance (6, 6) of translation and rotation, and the landmarks (n,) used."""

    frame_from_key: FloatArray
    covariance: FloatArray
    used: NDArray[np.bool_]


def predict(landmarks: Landmarks, frame_from_key: FloatArray) -> tuple[FloatArray, FloatArray, PatchWarp]:
    """Predict directions (n, 2) and inverse distances (n,) of landmarks in a frame, and the warp of their patches."""
    rotation, translation = frame_from_key[:3, :3], frame_from_key[:3, 3]
    homogeneous = np.concatenate([landmarks.directions, np.ones((len(landmarks.directions), 1))], axis=1)
    q = homogeneous @ rotation.T + landmarks.inverse_distance[:, None] * translation
    depth = np.where(q[:, 2] > 0, q[:, 2], np.nan)
    directions = q[:, :2] / depth[:, None]
    d_direction = rotation[:, :2] + translation[:, None] * landmarks.shapes[:, None, :2]
    linear = (d_direction[:, :2] - directions[:, :, None] * d_direction[:, 2:]) / depth[:, None, None]
    curvatures = landmarks.shapes.copy()
    curvatures[:, :2] = 0.0
    warp = PatchWarp(linear, lateral_shift_mm(directions, depth, translation), curvatures)
    return directions, landmarks.inverse_distance / depth, warp


def lateral_shift_mm(directions: FloatArray, depth: FloatArray, translation: FloatArray) -> FloatArray:
    """Return a view's shifts (n, 2) normal to directions (n, 2), for a translation (3,) and landmarks at q_z (n,)."""
    return np.asarray((translation[:2] - directions * translation[2]) / depth[:, None])


def fit_pose(
    landmarks: Landmarks, observed: Observations, frame_from_key: FloatArray, shared_errors: SharedErrors
) -> PoseFit | None:
    """Refine a pose to best explain observed landmarks; None if too few agree."""
    pose, used = frame_from_key, observed.valid
    normal, weighted, scale = np.eye(6), np.zeros((0, 6)), 1.0
    for _ in range(ROUNDS):
        residuals, jacobian, d_w, weight = _equations(landmarks, observed, pose)
        squares = ((weight @ residuals[:, :, None])[..., 0] * residuals).sum(axis=1)
        candidates = observed.valid & np.isfinite(squares)
        if candidates.sum() < MIN_LANDMARKS:
            return None
        scale = max(float(np.median(squares[candidates])) / MEDIAN_OF_THREE, 1.0)
        used = candidates & (squares < OUTLIER * scale)
        if used.sum() < MIN_LANDMARKS:
            return None
        robust = 1.0 / (1.0 + squares[used] / (OUTLIER * scale))
        # Stack the rows of all landmarks: matrix products are faster than sums over four indices.
        weighted = ((weight[used] * robust[:, None, None]) @ jacobian[used]).reshape(-1, 6)
        normal = weighted.T @ jacobian[used].reshape(-1, 6)
        step = np.linalg.solve(normal, weighted.T @ residuals[used].ravel())
        pose = rigid(Rotation.from_rotvec(step[3:]).as_matrix(), step[:3]) @ pose
        if np.abs(step).max() < 1e-9:
            break
    # Columns: the residual of each landmark, and an error of one along each axis of its direction.
    stacked = np.concatenate(
        [residuals[used][:, :, None], np.broadcast_to(np.eye(3)[:, :2], (used.sum(), 3, 2))], axis=2
    )
    scores = np.swapaxes(weighted.reshape(-1, 3, 6), 1, 2) @ stacked
    # Weights that depend on residuals make the loss's curvature smaller than `normal`.
    curvature_deficit = (2.0 / (OUTLIER * scale)) * scores[..., 0].T @ scores[..., 0]
    covariance = _covariance(normal - curvature_deficit, scores, landmarks.directions[used], shared_errors.neighbours)
    # An error that the inverse distances of all landmarks share shifts the pose, and no residual reveals it.
    d_common = np.linalg.solve(normal, weighted.T @ d_w[used].ravel())
    return PoseFit(pose, covariance + shared_errors.common_per_mm**2 * np.outer(d_common, d_common), used)


def _covariance(normal: FloatArray, scores: FloatArray, directions: FloatArray, direction_sigma: float) -> FloatArray:
    """Covariance (6, 6) of a pose from the landmarks' scores (n, 6, 3), with correlated errors of neighbours.

    Landmarks in one cell of CELLS x CELLS form a cluster, whose error is estimated from its summed score: the sandwich
    estimator of White, Econometrica 1980, for clusters. `direction_sigma` adds a common error of their directions.
    """
    min_direction, max_direction = directions.min(axis=0), directions.max(axis=0)
    cell = np.minimum(
        (directions - min_direction) / (max_direction - min_direction) * GRID_CELLS, GRID_CELLS - 1
    ).astype(np.int64)
    sums = np.zeros((GRID_CELLS * GRID_CELLS, 6, 3))
    np.add.at(sums, cell[:, 0] * GRID_CELLS + cell[:, 1], scores)
    count = len(np.unique(cell, axis=0))
    within = count / max(count - 6, 1) * np.einsum("ci,cj->ij", sums[..., 0], sums[..., 0])
    common = direction_sigma**2 * np.einsum("cik,cjk->ij", sums[..., 1:], sums[..., 1:])
    inverted = np.linalg.inv(normal)
    return np.asarray(inverted @ (within + common) @ inverted)


def _equations(
    landmarks: Landmarks, observed: Observations, frame_from_key: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return residuals (n, 3), derivatives of the prediction with respect to xi (n, 3, 6) and w (n, 3), and weights.

    Residuals are those of directions and inverse distances; weights (n, 3, 3) are inverse covariances.
    """
    rotation, translation = frame_from_key[:3, :3], frame_from_key[:3, 3]
    w = landmarks.inverse_distance
    homogeneous = np.concatenate([landmarks.directions, np.ones((len(w), 1))], axis=1)
    q = homogeneous @ rotation.T + w[:, None] * translation
    q[:, 2] = np.where(q[:, 2] > 0, q[:, 2], np.nan)
    expected = np.concatenate([q[:, :2], w[:, None]], axis=1) / q[:, 2:]
    residuals = np.concatenate([observed.directions, observed.inverse_distance[:, None]], axis=1) - expected
    # Derivative of the prediction with respect to q.
    d_q = np.zeros((len(w), 3, 3))
    d_q[:, 0, 0] = d_q[:, 1, 1] = 1.0
    d_q[:, :, 2] = -expected
    d_q /= q[:, 2, None, None]
    d_pose = np.zeros((len(w), 3, 6))
    d_pose[:, range(3), range(3)] = w[:, None]
    # Cross product of the rotation vector and q.
    d_pose[:, 0, 4], d_pose[:, 0, 5] = q[:, 2], -q[:, 1]
    d_pose[:, 1, 3], d_pose[:, 1, 5] = -q[:, 2], q[:, 0]
    d_pose[:, 2, 3], d_pose[:, 2, 4] = q[:, 1], -q[:, 0]
    d_w = d_q @ translation
    d_w[:, 2] += 1.0 / q[:, 2]
    covariance = landmarks.sigma_per_mm[:, None, None] ** 2 * d_w[:, :, None] * d_w[:, None, :]
    covariance[:, :2, :2] += observed.covariance
    covariance[:, 2, 2] += observed.sigma_per_mm**2 + observed.shape_sigma_per_mm**2 + landmarks.shape_sigma_per_mm**2
    usable = observed.valid & np.isfinite(covariance).all(axis=(1, 2))
    covariance[~usable] = np.eye(3)
    return residuals, d_q @ d_pose, d_w, np.asarray(np.linalg.inv(covariance), dtype=np.float64)


def rigid_motions(src: FloatArray, dst: FloatArray, weights: FloatArray) -> FloatArray:
    """Return transforms dst_from_src (..., 4, 4) of points (..., n, 3) that minimise the weighted squared distances."""
    fractions = weights / weights.sum(axis=-1, keepdims=True)
    centroids = [(fractions[..., None] * points).sum(axis=-2) for points in (src, dst)]
    centred = [points - centroid[..., None, :] for points, centroid in zip((src, dst), centroids, strict=True)]
    u, _, vt = np.linalg.svd(np.swapaxes(fractions[..., None] * centred[1], -1, -2) @ centred[0])
    # Avoid a reflection by flipping the least determined direction.
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    rotation = u @ vt
    return rigid(rotation, centroids[1] - (rotation @ centroids[0][..., None])[..., 0])


def robust_motion(
    src: FloatArray, dst: FloatArray, sigmas: FloatArray, seed: int = 0
) -> tuple[FloatArray, NDArray[np.bool_]] | None:
    """Fit dst_from_src (4, 4) to matched points (n, 3) with outliers; also return the inliers, or None if too few
    agree.

    Parameters
    ----------
    src, dst
        Matched points (n, 3) of the two sets.
    sigmas
        Standard deviations (n, 3) of the differences along the axes of dst.
    seed
        Seed of the random samples.
    """
    if len(src) < MIN_INLIERS:
        return None
    random = np.random.default_rng(seed)
    chosen = np.stack([random.choice(len(src), SAMPLE_SIZE, replace=False) for _ in range(TRIALS)])
    weights = 1.0 / (sigmas**2).mean(axis=1)
    candidates = rigid_motions(src[chosen], dst[chosen], weights[chosen])
    transformed = src @ np.swapaxes(candidates[:, :3, :3], -1, -2) + candidates[:, None, :3, 3]
    agrees = (((transformed - dst) / sigmas) ** 2).sum(axis=2) < 9.0 * SAMPLE_SIZE
    inliers = agrees[agrees.sum(axis=1).argmax()]
    motion = None
    for _ in range(3):
        if inliers.sum() < MIN_INLIERS:
            return None
        motion = rigid_motions(src[inliers], dst[inliers], weights[inliers])
        inliers = (((transform(motion, src) - dst) / sigmas) ** 2).sum(axis=1) < 9.0 * SAMPLE_SIZE
    return None if motion is None or inliers.sum() < MIN_INLIERS else (motion, inliers)
