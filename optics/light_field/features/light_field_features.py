"""Features of a light field: 2-D keypoints of the reference view on which all views agree, with slope and position.

Keypoints come with a slope: from the focal stack, or from matches in the views at the ends of the reference view's row
and column. It predicts the feature's position in all views, where the patch is aligned. Detections beyond a maximum
distance from it are rejected; at least N_MIN views must find the feature, and its slope is fitted to these views.

A patch measures the depth at its gradients, not at its centre: it first moves to their centroid, and its Gaussian
window is narrow. Where a wider patch has another slope, the surface is not smooth, as at a step in depth, and the
difference enters the standard deviation.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.align import align
from mirrorcam.optics.light_field.features.feature_set import Features
from mirrorcam.optics.light_field.features.keypoints import (
    DetectorName,
    Keypoints,
    detect,
    detector,
    grey_views,
    inner_masks,
    stack_keypoints,
)
from mirrorcam.optics.light_field.features.match import find_candidates, vote
from mirrorcam.optics.light_field.features.patches import (
    NARROW,
    WIDE,
    Floats,
    ImagePyramid,
    gradient_centroids,
    templates,
)
from mirrorcam.optics.light_field.features.slope import (
    SlopeFit,
    TwoSlopes,
    ViewGeometry,
    agreeing_views,
    fit_slope,
    fit_two_slopes,
    moderated_variance,
)
from mirrorcam.optics.light_field.light_field import Axis, LightField, Views

FeatureDetector = Literal["SIFT4D", "ORB", "AKAZE"]
"""Detectors in single views, and SIFT4D in the focal stack of a light field."""

# Maximum error of a keypoint's position, in pixels of its scale.
MATCH_PX = 1.0
# Minimum normalised cross-correlation at which a view shows the same point as the reference patch.
MIN_CORRELATION = 0.85
# Weight of the prior variance, in degrees of freedom (see `moderated_variance`).
PRIOR_DEGREES_OF_FREEDOM = 4.0
# Standard deviation of a slope, per difference between the slopes of a narrow and a wide patch; from rendered scenes.
WINDOW_ERROR = 1.5


class FeatureFinder:
    """Finds the features of light fields with the same views; for a video, reuse it with its detectors and threads.

    Parameters
    ----------
    views
        Geometry of the light fields.
    name
        SIFT4D, in the focal stack; ORB or AKAZE, in single views, are faster.
    keypoints
        Approximate number of strongest keypoints per view.
    max_distance_px
        Maximum distance from the position predicted by the slope at which a view still sees the feature.
    min_views
        N_MIN, minimum number of views, besides the reference view, that must find a feature; by default more than half.
    nearest_mm, farthest_mm
        Depth range of features; by default from half the distance of the reference plane to infinity.
    two_slope_sigma
        Difference of the two slopes, in standard deviations, above which features are flagged.

    Raises
    ------
    InputError
        If there are fewer views than `min_views` requires, depths are out of order or nearer than a view, or OpenCV
        lacks AKAZE.
    """

    def __init__(
        self,
        views: Views,
        name: FeatureDetector = "SIFT4D",
        *,
        keypoints: int = 600,
        max_distance_px: float = 0.5,
        min_views: int | None = None,
        nearest_mm: float | None = None,
        farthest_mm: float = np.inf,
        two_slope_sigma: float = 4.0,
    ) -> None:
        count = views.rows * views.cols
        if count < 2:
            raise InputError("light field has one view, expected at least two views for features")
        required = (count - 1) // 2 + 1 if min_views is None else min_views
        if not 1 <= required <= count - 1:
            raise InputError(
                f"minimum number of views is {required} besides the reference view, expected 1 to {count - 1}"
            )
        if not (np.isfinite(max_distance_px) and max_distance_px > 0):
            raise InputError(f"maximum distance is {max_distance_px:g} px, expected a positive number")
        if keypoints < 1:
            raise InputError(f"maximum number of keypoints is {keypoints} per view, expected at least 1")
        if not two_slope_sigma > 0:
            raise InputError(
                f"difference of two slopes is {two_slope_sigma:g} standard deviations, expected a positive number"
            )
        reference_view_depth_mm = views.reference_view_depth_mm
        nearest = reference_view_depth_mm + views.reference_distance_mm / 2.0 if nearest_mm is None else nearest_mm
        if (
            not max(views.positions_mm[..., 2].max(), 0.0)
            < nearest - reference_view_depth_mm
            < farthest_mm - reference_view_depth_mm
        ):
            raise InputError(
                f"depths {nearest:g} to {farthest_mm:g} mm: the nearer one must come first and be in front of all views"
            )
        self.views, self.name = views, name
        self.max_distance_px, self.min_views, self.two_slope_sigma = max_distance_px, required, two_slope_sigma
        self.inverse_distance_range = (
            1.0 / (farthest_mm - reference_view_depth_mm),
            1.0 / (nearest - reference_view_depth_mm),
        )
        self.geometry = ViewGeometry.of(views)
        self._baseline_mm = float(np.hypot(*self.geometry.lateral_mm.T).max())
        self.keypoints = keypoints
        self._described_views = [self.geometry.reference, *_end_views(views, self.geometry.reference)]
        self._detectors = [] if name == "SIFT4D" else [detector(name, keypoints) for _ in self._described_views]
        self._pool = ThreadPoolExecutor(min(len(self._described_views), os.cpu_count() or 1))

    def find(self, light_field: LightField) -> Features:
        """Return the features of a light field; raises InputError if its views differ."""
        if not self.fits(light_field):
            raise InputError(
                f"light field of layout {light_field.layout_identity} differs in its views from layout "
                f"{self.views.layout_identity}, which the finder was built for"
            )
        images, inner = grey_views(light_field), inner_masks(light_field)
        if self.name == "SIFT4D":
            valid = light_field.valid.reshape(inner.shape).astype(np.uint8) * np.uint8(255)
            masks = (valid, inner[self.geometry.reference])
            keypoints, rows, inverse_distance = stack_keypoints(
                self.geometry, images, *masks, self.inverse_distance_range, self.keypoints, self._pool.map
            )
        else:
            keypoints, rows, inverse_distance = self._match(images, inner, self.name)
        pyramid = ImagePyramid(images.reshape(self.views.rows, self.views.cols, *images.shape[1:]))
        scale = keypoints.scale_px[rows]
        pixels = gradient_centroids(
            pyramid, self.geometry.reference, keypoints.pixels[rows], scale, self.geometry.lateral_mm
        )
        narrow = self._align(pyramid, inner, pixels, scale, inverse_distance, NARROW)
        kept = self._select(keypoints, rows, narrow)
        rows, narrow = rows[kept], narrow.take(kept)
        fit = narrow.fit(self.geometry)
        wide = self._align(pyramid, inner, pixels[kept], scale[kept], fit.inverse_distance, WIDE)
        return self._features(keypoints, rows, narrow, fit, wide)

    def _match(
        self, images: NDArray[np.uint8], inner: NDArray[np.uint8], name: DetectorName
    ) -> tuple[Keypoints, NDArray[np.int64], FloatArray]:
        """Return the keypoints of the reference view, the rows (n,) with matches, and their inverse distances (n,)."""
        run, described = self._pool.map, self._described_views
        detected = detect(images[described], inner[described], self._detectors, name, run)
        keypoints, others = detected[0], dict(zip(described[1:], detected[1:], strict=True))
        tolerance = MATCH_PX * keypoints.scale_px
        matches = find_candidates(self.geometry, keypoints, others, name, self.inverse_distance_range, tolerance, run)
        best, second_best = vote(matches, tolerance)
        # If two slopes compete, all views decide; if the views support both, the keypoint is ambiguous.
        rows = np.concatenate([np.flatnonzero(np.isfinite(w)) for w in (best, second_best)])
        return keypoints, rows, np.concatenate([w[np.isfinite(w)] for w in (best, second_best)])

    def fits(self, light_field: LightField) -> bool:
        """Return whether a light field has this finder's views."""
        return (
            light_field.layout_identity == self.views.layout_identity
            and light_field.weights.shape[2:] == (self.views.height_px, self.views.width_px)
            and np.array_equal(light_field.positions_mm, self.views.positions_mm)
            and np.array_equal(light_field.matrices, self.views.matrices)
        )

    def _align(
        self,
        pyramid: ImagePyramid,
        inner: NDArray[np.uint8],
        pixels: FloatArray,
        scale_px: FloatArray,
        inverse_distance: FloatArray,
        window: Floats,
    ) -> _Observed:
        """Align patches of the reference view at pixels (n, 2) in all views that show them."""
        geometry = self.geometry
        directions = geometry.directions(pixels)
        reference_patches = templates(pyramid, geometry.reference, pixels, scale_px, window)
        others = np.delete(np.arange(len(inner)), geometry.reference)
        start = np.stack([geometry.predict(int(view), directions, inverse_distance) for view in others])
        start[~in_masks(inner[others], start)] = np.nan
        distance = 1.0 / np.maximum(inverse_distance, 1e-6)
        aligned = align(
            pyramid, reference_patches, others, start, geometry.lateral_mm[others], distance, self._pool.map
        )
        matching = (aligned.correlation >= MIN_CORRELATION) & in_masks(inner[others], aligned.pixels)
        observed_px = np.full((len(inner), len(pixels), 2), np.nan)
        observed_px[others] = np.where(matching[..., None], aligned.pixels, np.nan)
        indices = np.concatenate([np.zeros(0, np.int64), *(patches.index for patches in reference_patches)])
        observed_px[geometry.reference, indices] = pixels[indices]
        mean = np.trace(aligned.precision, axis1=1, axis2=2) / 2.0
        precision = aligned.precision / mean[:, None, None]
        return _Observed(
            pixels=observed_px,
            agrees=agreeing_views(geometry, observed_px, inverse_distance, precision, self.max_distance_px),
            inverse_distance=inverse_distance,
            precision=precision,
            variance_px2=aligned.variance / mean,
            covariance=aligned.shape_covariance / self.views.focal_px**2,
        )

    def _select(self, keypoints: Keypoints, rows: NDArray[np.int64], observed: _Observed) -> NDArray[np.int64]:
        """Return the indices of the keypoints that enough views see where one slope predicts them, in their order."""
        agrees, fit = observed.agrees, observed.fit(self.geometry)
        nearby, far = max(self.inverse_distance_range), min(self.inverse_distance_range)
        keep = agrees[self.geometry.reference] & (agrees.sum(axis=0) - 1 >= self.min_views)
        keep &= (fit.inverse_distance > far) & (fit.inverse_distance <= nearby)
        max_baseline_px_mm = self._baseline_mm * self.views.focal_px
        keep[keep] = _one_per_pixel(
            keypoints.pixels[rows[keep]],
            agrees[:, keep].sum(axis=0),
            max_baseline_px_mm * fit.inverse_distance[keep],
            2.0 * self.max_distance_px,
        )
        # Restore the order of keypoints, whichever slope was chosen.
        return np.flatnonzero(keep)[np.argsort(rows[keep], kind="stable")]

    def _features(
        self, keypoints: Keypoints, rows: NDArray[np.int64], narrow: _Observed, fit: SlopeFit, wide: _Observed
    ) -> Features:
        """Build features of keypoints from their narrow patches, the `fit` of a slope to these, and wide patches."""
        views, grid = self.views, (self.views.rows, self.views.cols)
        axis: Axis = "s" if views.cols > 1 else "t"
        px_mm = views.focal_px * views.step_mm(axis)
        scale = keypoints.scale_px[rows]
        wide_fit = wide.fit(self.geometry)
        two_slopes, narrow_two_slopes = wide.fit_two(self.geometry), narrow.fit_two(self.geometry)
        noise, two_slope_noise = (
            np.maximum(
                moderated_variance(slopes.squares_px2 / scale**2, slopes.dof, PRIOR_DEGREES_OF_FREEDOM) * scale**2,
                observed.variance_px2,
            )
            for slopes, observed in ((fit, narrow), (two_slopes, wide))
        )
        # A surface that no polynomial describes, such as a step in depth, has another slope in a patch of another size.
        window_error = WINDOW_ERROR * (wide_fit.inverse_distance - fit.inverse_distance)
        window_error = np.nan_to_num(window_error, nan=1.0 / (views.focal_px * self._baseline_mm))
        window_difference = two_slopes.anisotropy - narrow_two_slopes.anisotropy
        window_variance = (window_difference**2).sum(axis=1)
        sigma_w = np.sqrt(noise / fit.information + narrow.covariance[:, 0, 0] + window_error**2)
        distance = 1.0 / fit.inverse_distance
        points = np.concatenate([fit.directions, np.ones((len(rows), 1))], axis=1) * distance[:, None]
        seen_grid = np.where(narrow.agrees[..., None], narrow.pixels, np.nan).transpose(1, 0, 2)
        difference_covariance = (
            two_slope_noise[:, None, None] * two_slopes.anisotropy_covariance
            + wide.covariance[:, 1:, 1:]
            + window_variance[:, None, None] * np.eye(2)
        )
        two_slope_sigma = np.sqrt(
            np.einsum(
                "ni,nij,nj->n", two_slopes.anisotropy, np.linalg.inv(difference_covariance), two_slopes.anisotropy
            )
        )
        axis_slopes = np.stack([narrow_two_slopes.matrices[:, 0, 0], narrow_two_slopes.matrices[:, 1, 1]], axis=1)
        return Features(
            detector=self.name,
            pixels=views.focal_px * fit.directions + views.centre_px,
            keypoint_px=keypoints.pixels[rows],
            scale_px=scale,
            disparity_px=px_mm * (fit.inverse_distance - 1.0 / views.reference_distance_mm),
            disparity_sigma_px=px_mm * sigma_w,
            points_in_rig_mm=points @ views.view_from_rig + views.reference_view_in_rig_mm,
            depth_mm=distance + views.reference_view_depth_mm,
            depth_sigma_mm=sigma_w * distance**2,
            residual_px=np.sqrt(
                np.square(fit.distances_px).sum(axis=0, where=narrow.agrees) / narrow.agrees.sum(axis=0)
            ),
            seen=narrow.agrees.T.reshape(-1, *grid),
            seen_px=seen_grid.reshape(-1, *grid, 2),
            apart_disparity_px=px_mm * (axis_slopes - 1.0 / views.reference_distance_mm),
            two_slope_sigma=two_slope_sigma,
            refracted=np.nan_to_num(two_slope_sigma) > self.two_slope_sigma,
            descriptors=keypoints.descriptors[rows],
            layout_identity=views.layout_identity,
        )


@dataclass(frozen=True, eq=False)
class _Observed:
    """Patches of n keypoints in all views.

    Attributes
    ----------
    pixels
        Pixels (views, n, 2); NaN where a view does not show the patch.
    agrees
        Mask (views, n) of the views that see the patch where one slope predicts it.
    inverse_distance
        Expected inverse distances (n,), 1/mm.
    precision
        Relative precision (n, 2, 2) along u and v, with mean 1.
    variance_px2
        Variance (n,) of a pixel, as far as the samples tell.
    covariance
        Covariance (n, 3, 3) of w, d, e from the uncertainty of the surface's shape, 1/mm^2.
    """

    pixels: FloatArray
    agrees: NDArray[np.bool_]
    inverse_distance: FloatArray
    precision: FloatArray
    variance_px2: FloatArray
    covariance: FloatArray

    def take(self, index: NDArray[np.int64]) -> _Observed:
        return _Observed(
            pixels=self.pixels[:, index],
            agrees=self.agrees[:, index],
            inverse_distance=self.inverse_distance[index],
            precision=self.precision[index],
            variance_px2=self.variance_px2[index],
            covariance=self.covariance[index],
        )

    def fit(self, geometry: ViewGeometry) -> SlopeFit:
        return fit_slope(geometry, self.pixels, self.agrees, self.inverse_distance, self.precision)

    def fit_two(self, geometry: ViewGeometry) -> TwoSlopes:
        return fit_two_slopes(geometry, self.pixels, self.agrees, self.inverse_distance, self.precision)


def _end_views(views: Views, reference: int) -> list[int]:
    """Return the views at the ends of the reference view's row and column: the widest baselines along s and t.

    If the views do not form a grid: the farthest to the left, to the right, up and down.
    """
    if not views.is_grid:
        positions = views.positions_mm[..., :2].reshape(-1, 2)
        farthest = [*positions.argmin(axis=0).tolist(), *positions.argmax(axis=0).tolist()]
        return [view for view in dict.fromkeys(farthest) if view != reference]
    t, s = divmod(reference, views.cols)
    row = [t * views.cols + end for end in (0, views.cols - 1)]
    column = [end * views.cols + s for end in (0, views.rows - 1)]
    return [view for view in dict.fromkeys([*row, *column]) if view != reference]


def in_masks(inner: NDArray[np.uint8], pixels: FloatArray) -> NDArray[np.bool_]:
    """Return the mask (views, n) of the pixels (views, n, 2) that lie in the masks (views, v, u); False at NaN."""
    _, height, width = inner.shape
    rounded = np.rint(np.where(np.isfinite(pixels), pixels, -1.0))
    u, v = np.moveaxis(np.clip(rounded, -1, [width, height]).astype(np.int64), -1, 0)
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    view = np.arange(len(inner))[:, None]
    return inside & (inner[view, np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)] > 0)


def _one_per_pixel(
    pixels: FloatArray, views: NDArray[np.int64], shift_px: FloatArray, max_difference_px: float
) -> NDArray[np.bool_]:
    """Return the mask (n,) of at most one keypoint per pixel (n, 2), which may have two slopes or orientations.

    The keypoint seen by the largest number of views is kept, unless the shifts (n,) at a pixel differ by more than
    `max_difference_px`.
    """
    chosen = np.zeros(len(pixels), dtype=bool)
    if len(pixels) == 0:
        return chosen
    _, position = np.unique(pixels, axis=0, return_inverse=True)
    order = np.lexsort((np.arange(len(pixels)), -views, position.ravel()))
    starts = np.flatnonzero(np.diff(position.ravel()[order], prepend=-1))
    range_px = np.maximum.reduceat(shift_px[order], starts) - np.minimum.reduceat(shift_px[order], starts)
    chosen[order[starts[range_px <= max_difference_px]]] = True
    return chosen
