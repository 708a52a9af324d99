"""Features of a light field: 2-D keypoints of the reference view on which all views agree, with slope and position.

As in the paper (Light Field Features): a match of a keypoint in another view gives a slope, which predicts the
feature's position in all views. Detections beyond a maximum distance from it are rejected; at least N_MIN views must
find the feature, and these views consolidate its slope. Keypoints are detected and described in the reference view and
at the ends of its row and column; starting from the slope on which these agree, the patch is aligned in every view.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.align import AlignedPatches, align
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
from mirrorcam.optics.light_field.features.match import candidates, vote
from mirrorcam.optics.light_field.features.patches import ImagePyramid, templates
from mirrorcam.optics.light_field.features.slope import (
    Geometry,
    SlopeFit,
    TwoSlopes,
    agreeing_views,
    fit_slope,
    fit_two_slopes,
    moderated_variance,
)
from mirrorcam.optics.light_field.light_field import Axis, LightField, Views

FeatureDetector = Literal["SIFT", "ORB", "AKAZE", "SIFT4D"]
"""Detectors in single views, and SIFT4D in the focal stack of a light field."""

# Largest error of a keypoint's position, in pixels of its scale.
MATCH_PX = 1.0
# Least normalised cross-correlation at which a view shows the same point as the reference patch.
MIN_CORRELATION = 0.85
# Weight of the prior variance, in degrees of freedom (see `moderated_variance`).
PRIOR_DEGREES_OF_FREEDOM = 4.0


class FeatureFinder:
    """Finds the features of light fields with the same views; for a video, reuse it with its detectors and threads.

    Parameters
    ----------
    views
        Geometry of the light fields.
    name
        SIFT, ORB or AKAZE, in single views; SIFT4D, in the focal stack, for low light.
    keypoints
        Approximate number of strongest keypoints per view.
    max_distance_px
        Largest distance from the position predicted by the slope at which a view sees the feature.
    min_views
        N_MIN, least number of views, besides the reference view, that must find a feature. Default: most of them.
    nearest_mm, farthest_mm
        Depth range of features. Default: from half the distance of the reference plane to infinity.
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
        name: FeatureDetector = "SIFT",
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
            raise InputError("features of one view, expected at least two views")
        required = (count - 1) // 2 + 1 if min_views is None else min_views
        if not 1 <= required <= count - 1:
            raise InputError(f"features in {required} views besides the reference view, expected 1 to {count - 1}")
        if not (np.isfinite(max_distance_px) and max_distance_px > 0):
            raise InputError(f"maximum distance is {max_distance_px:g} px, expected a positive number")
        if keypoints < 1:
            raise InputError(f"at most {keypoints} keypoints a view, expected at least 1")
        if not two_slope_sigma > 0:
            raise InputError(f"two slopes {two_slope_sigma:g} standard deviations apart, expected a positive number")
        pupil_mm = views.reference_view_depth_mm
        nearest = pupil_mm + views.reference_distance_mm / 2.0 if nearest_mm is None else nearest_mm
        if not max(views.positions_mm[..., 2].max(), 0.0) < nearest - pupil_mm < farthest_mm - pupil_mm:
            raise InputError(
                f"depths {nearest:g} to {farthest_mm:g} mm, expected the nearer one first and in front of every view"
            )
        self.views, self.name = views, name
        self.max_distance_px, self.min_views, self.two_slope_sigma = max_distance_px, required, two_slope_sigma
        self.inverse_range_mm = (1.0 / (farthest_mm - pupil_mm), 1.0 / (nearest - pupil_mm))
        self.geometry = Geometry.of(views)
        self.keypoints = keypoints
        self._described_views = [self.geometry.reference, *_end_views(views, self.geometry.reference)]
        self._detectors = [] if name == "SIFT4D" else [detector(name, keypoints) for _ in self._described_views]
        self._pool = ThreadPoolExecutor(min(len(self._described_views), os.cpu_count() or 1))

    def find(self, light_field: LightField) -> Features:
        """Return the features of a light field; raises InputError if its views differ."""
        if not self.fits(light_field):
            raise InputError(
                f"light field of layout {light_field.layout_identity} has other views than layout "
                f"{self.views.layout_identity}, which the finder was built for"
            )
        images, inner = grey_views(light_field), inner_masks(light_field)
        if self.name == "SIFT4D":
            valid = light_field.valid.reshape(inner.shape).astype(np.uint8) * np.uint8(255)
            masks = (valid, inner[self.geometry.reference])
            keypoints, inverse_mm = stack_keypoints(
                self.geometry, images, *masks, self.inverse_range_mm, self.keypoints, self._pool.map
            )
            rows = np.arange(len(inverse_mm))
        else:
            keypoints, rows, inverse_mm = self._matched(images, inner, self.name)
        seen_px, aligned = self._aligned(images, inner, keypoints, rows, inverse_mm)
        return self._consolidated(keypoints, rows, seen_px, inverse_mm, aligned)

    def _matched(
        self, images: NDArray[np.uint8], inner: NDArray[np.uint8], name: DetectorName
    ) -> tuple[Keypoints, NDArray[np.int64], FloatArray]:
        """Return the keypoints of the reference view, the rows (n,) with matches, and their inverse distances (n,)."""
        run, described = self._pool.map, self._described_views
        detected = detect(images[described], inner[described], self._detectors, name, run)
        keypoints, others = detected[0], dict(zip(described[1:], detected[1:], strict=True))
        tolerance = MATCH_PX * keypoints.scale_px
        matches = candidates(self.geometry, keypoints, others, name, self.inverse_range_mm, tolerance, run)
        agreed, competing = vote(matches, tolerance)
        # If two slopes compete, all views decide; if the views support both, the keypoint is ambiguous.
        rows = np.concatenate([np.flatnonzero(np.isfinite(each)) for each in (agreed, competing)])
        return keypoints, rows, np.concatenate([each[np.isfinite(each)] for each in (agreed, competing)])

    def fits(self, light_field: LightField) -> bool:
        """Return whether a light field has this finder's views."""
        return (
            light_field.layout_identity == self.views.layout_identity
            and light_field.weights.shape[2:] == (self.views.height_px, self.views.width_px)
            and np.array_equal(light_field.positions_mm, self.views.positions_mm)
            and np.array_equal(light_field.matrices, self.views.matrices)
        )

    def _aligned(
        self,
        images: NDArray[np.uint8],
        inner: NDArray[np.uint8],
        keypoints: Keypoints,
        rows: NDArray[np.int64],
        inverse_mm: FloatArray,
    ) -> tuple[FloatArray, AlignedPatches]:
        """Return pixels (views, n, 2) of keypoints `rows` (n,), NaN where a view does not show them, and patches."""
        geometry = self.geometry
        pyramid = ImagePyramid(images.reshape(self.views.rows, self.views.cols, *images.shape[1:]))
        pixels, directions = keypoints.pixels[rows], geometry.directions(keypoints.pixels[rows])
        reference_patches = templates(pyramid, geometry.reference, pixels, keypoints.scale_px[rows])
        others = np.delete(np.arange(len(images)), geometry.reference)
        start = np.stack([geometry.predict(int(view), directions, inverse_mm) for view in others])
        start[~shown_by_views(inner[others], start)] = np.nan
        distance = 1.0 / np.maximum(inverse_mm, 1e-6)
        aligned = align(pyramid, reference_patches, others, start, geometry.across_mm[others], distance, self._pool.map)
        matching = (aligned.correlation >= MIN_CORRELATION) & shown_by_views(inner[others], aligned.pixels)
        seen_px = np.full((len(images), len(rows), 2), np.nan)
        seen_px[others] = np.where(matching[..., None], aligned.pixels, np.nan)
        indices = np.concatenate([np.zeros(0, np.int64), *(each.index for each in reference_patches)])
        seen_px[geometry.reference, indices] = pixels[indices]
        return seen_px, aligned

    def _consolidated(
        self,
        keypoints: Keypoints,
        rows: NDArray[np.int64],
        seen_px: FloatArray,
        inverse_mm: FloatArray,
        aligned: AlignedPatches,
    ) -> Features:
        """Build features from the keypoints that enough views see at the positions predicted by one slope."""
        mean = np.trace(aligned.precision, axis1=1, axis2=2) / 2.0
        precision, variance = aligned.precision / mean[:, None, None], aligned.variance / mean
        agreeing = agreeing_views(self.geometry, seen_px, inverse_mm, precision, self.max_distance_px)
        fit = fit_slope(self.geometry, seen_px, agreeing, inverse_mm, precision)
        reference = self.geometry.reference
        near, far = max(self.inverse_range_mm), min(self.inverse_range_mm)
        keep = agreeing[reference] & (agreeing.sum(axis=0) - 1 >= self.min_views)
        keep &= (fit.inverse_mm > far) & (fit.inverse_mm <= near)
        widest_baseline = np.hypot(*self.geometry.across_mm.T).max() * self.views.focal_px
        keep[keep] = _one_per_place(
            keypoints.pixels[rows[keep]],
            agreeing[:, keep].sum(axis=0),
            widest_baseline * fit.inverse_mm[keep],
            2.0 * self.max_distance_px,
        )
        # Restore the order of keypoints, whichever slope was chosen.
        keep = np.flatnonzero(keep)[np.argsort(rows[keep], kind="stable")]
        arguments = (self.geometry, seen_px[:, keep], agreeing[:, keep], inverse_mm[keep], precision[keep])
        fit, two_slopes = fit_slope(*arguments), fit_two_slopes(*arguments)
        covariance = aligned.shape_covariance[keep] / self.views.focal_px**2
        return self._features(
            keypoints, rows[keep], seen_px[:, keep], agreeing[:, keep], fit, two_slopes, variance[keep], covariance
        )

    def _features(
        self,
        keypoints: Keypoints,
        rows: NDArray[np.int64],
        seen_px: FloatArray,
        agreeing: NDArray[np.bool_],
        fit: SlopeFit,
        two_slopes: TwoSlopes,
        variance_px2: FloatArray,
        covariance: FloatArray,
    ) -> Features:
        views, grid = self.views, (self.views.rows, self.views.cols)
        axis: Axis = "s" if views.cols > 1 else "t"
        px_mm = views.focal_px * views.step_mm(axis)
        scale = keypoints.scale_px[rows]
        scale_squared = scale**2
        noise, two_slope_noise = (
            np.maximum(
                moderated_variance(each.squares_px2 / scale_squared, each.freedom, PRIOR_DEGREES_OF_FREEDOM)
                * scale_squared,
                variance_px2,
            )
            for each in (fit, two_slopes)
        )
        sigma_w = np.sqrt(noise / fit.information + covariance[:, 0, 0])
        distance = 1.0 / fit.inverse_mm
        points = np.concatenate([fit.directions, np.ones((len(rows), 1))], axis=1) * distance[:, None]
        seen = np.where(agreeing[..., None], seen_px, np.nan).transpose(1, 0, 2)
        difference_covariance = two_slope_noise[:, None, None] * two_slopes.apart_covariance + covariance[:, 1:, 1:]
        two_slope_sigma = np.sqrt(
            np.einsum("ni,nij,nj->n", two_slopes.apart_mm, np.linalg.inv(difference_covariance), two_slopes.apart_mm)
        )
        axis_slopes = np.stack([two_slopes.matrices_mm[:, 0, 0], two_slopes.matrices_mm[:, 1, 1]], axis=1)
        return Features(
            detector=self.name,
            pixels=views.focal_px * fit.directions + views.centre_px,
            scale_px=scale,
            disparity_px=px_mm * (fit.inverse_mm - 1.0 / views.reference_distance_mm),
            disparity_sigma_px=px_mm * sigma_w,
            points_in_rig_mm=points @ views.view_from_rig + views.reference_view_in_rig_mm,
            depth_mm=distance + views.reference_view_depth_mm,
            depth_sigma_mm=sigma_w * distance**2,
            residual_px=np.sqrt(np.square(fit.distances_px).sum(axis=0, where=agreeing) / agreeing.sum(axis=0)),
            seen=agreeing.T.reshape(-1, *grid),
            seen_px=seen.reshape(-1, *grid, 2),
            apart_disparity_px=px_mm * (axis_slopes - 1.0 / views.reference_distance_mm),
            two_slope_sigma=two_slope_sigma,
            refracted=np.nan_to_num(two_slope_sigma) > self.two_slope_sigma,
            descriptors=keypoints.descriptors[rows],
            layout_identity=views.layout_identity,
        )


def _end_views(views: Views, reference: int) -> list[int]:
    """Views at the ends of the reference view's row and column: the widest baselines along s and t alone.

    If the views form no grid: the farthest to the left, to the right, up and down.
    """
    if not views.is_grid:
        positions = views.positions_mm[..., :2].reshape(-1, 2)
        farthest = [*positions.argmin(axis=0).tolist(), *positions.argmax(axis=0).tolist()]
        return [view for view in dict.fromkeys(farthest) if view != reference]
    t, s = divmod(reference, views.cols)
    row = [t * views.cols + end for end in (0, views.cols - 1)]
    column = [end * views.cols + s for end in (0, views.rows - 1)]
    return [view for view in dict.fromkeys([*row, *column]) if view != reference]


def shown_by_views(inner: NDArray[np.uint8], pixels: FloatArray) -> NDArray[np.bool_]:
    """Mask of the pixels (views, n, 2) whose surroundings the masks (views, v, u) contain; False at NaN."""
    _, height, width = inner.shape
    near = np.rint(np.where(np.isfinite(pixels), pixels, -1.0))
    u, v = np.moveaxis(np.clip(near, -1, [width, height]).astype(np.int64), -1, 0)
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    view = np.arange(len(inner))[:, None]
    return inside & (inner[view, np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)] > 0)


def _one_per_place(
    pixels: FloatArray, views: NDArray[np.int64], shift_px: FloatArray, max_difference_px: float
) -> NDArray[np.bool_]:
    """Mask (n,) of at most one keypoint per pixel (n, 2): two slopes or SIFT orientations may have been tried there.

    The keypoint that most views see is kept, unless the shifts (n,) by the slopes differ by more than
    `max_difference_px`.
    """
    chosen = np.zeros(len(pixels), dtype=bool)
    if len(pixels) == 0:
        return chosen
    _, position = np.unique(pixels, axis=0, return_inverse=True)
    order = np.lexsort((np.arange(len(pixels)), -views, position.ravel()))
    starts = np.flatnonzero(np.diff(position.ravel()[order], prepend=-1))
    spread = np.maximum.reduceat(shift_px[order], starts) - np.minimum.reduceat(shift_px[order], starts)
    chosen[order[starts[spread <= max_difference_px]]] = True
    return chosen
