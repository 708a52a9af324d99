"""Depth maps of all views, for rendering other views and deciding occlusion.

Holes in maps of inverse distance that were warped from one view to another are filled from the background.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.depth import estimate_depth
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.light_field import LightField, Views

Float32 = NDArray[np.float32]
AGREEMENT_PX = 1.0
"""Maximum difference in disparity, at the longest baseline, of depths that agree."""
EDGE_PX = 2
"""Distance from a removed object within which samples may still contain it: they blend two pixels of the frame."""


@dataclass(frozen=True, eq=False)
class ViewDepths:
    """Maps of inverse distance of all views of a light field.

    Attributes
    ----------
    inverse_distance
        Inverse distance (t, s, v, u), float32: 1 / Z in 1/mm, Z from the reference view along view z; NaN if unknown.
    measured
        Mask (t, s, v, u) of pixels whose inverse distance was measured, not filled in.
    """

    inverse_distance: Float32
    measured: NDArray[np.bool_]

    def depth_mm(self, views: Views) -> Float32:
        """Return the depth (t, s, v, u) in mm from the pupil; NaN if unknown."""
        reference_view_depth_mm = np.float32(views.reference_view_depth_mm)
        with np.errstate(divide="ignore"):
            return np.asarray(np.float32(1.0) / self.inverse_distance + reference_view_depth_mm)

    @classmethod
    def of_depths(cls, views: Views, depth_mm: NDArray[np.floating]) -> ViewDepths:
        """Build from depths (t, s, v, u) in mm from the pupil, possibly infinite; all but NaN (unknown) are measured.

        Raises InputError for depths of a different shape, or behind the reference view.
        """
        expected = views.rows, views.cols, views.height_px, views.width_px
        if depth_mm.shape != expected:
            raise InputError(f"depths have shape {depth_mm.shape}, expected the views' shape {expected}")
        reference_view_depth_mm = views.reference_view_depth_mm
        distance = np.asarray(depth_mm, dtype=np.float64) - reference_view_depth_mm
        if (distance <= 0).any():
            raise InputError(
                f"a depth is {np.nanmin(depth_mm):.4g} mm, expected all beyond {reference_view_depth_mm:.4g} mm"
            )
        return cls((1.0 / distance).astype(np.float32), ~np.isnan(depth_mm))

    @classmethod
    def of_reference(cls, views: Views, depth_mm: NDArray[np.floating]) -> ViewDepths:
        """Build all views' depths from those of the reference view (v, u), in mm from the pupil, NaN if unknown.

        Other views also see points that are occluded in the reference view: these get the depth of the farther
        neighbour and are marked as not measured.

        Raises InputError for depths of a different shape, behind the reference view, or entirely unknown.
        """
        reference, shape = reference_index(views), (views.rows, views.cols, views.height_px, views.width_px)
        if depth_mm.shape != shape[2:]:
            raise InputError(f"depth has shape {depth_mm.shape}, expected {shape[2:]} of the views")
        depths_mm = np.full(shape, np.nan)
        depths_mm[reference] = depth_mm
        measured = cls.of_depths(views, depths_mm).inverse_distance
        inverse_distance = np.stack(
            [inverse_distance_from(views, measured, position) for position in views.positions_mm.reshape(-1, 3)]
        )
        inverse_distance = inverse_distance.reshape(shape)
        inverse_distance[reference] = np.where(
            np.isnan(measured[reference]), inverse_distance[reference], measured[reference]
        )
        return cls(inverse_distance, _visible_in_reference(views, reference, inverse_distance, measured[reference]))

    @classmethod
    def estimate(
        cls, light_field: LightField, *, near_mm: float | None = None, far_mm: float | None = None
    ) -> ViewDepths:
        """Measure depth in the reference view with `DepthEstimator`, and transfer it to the others by `of_reference`.

        Raises InputError if `DepthEstimator` cannot measure depth.
        """
        return cls.of_reference(light_field, estimate_depth(light_field, near_mm=near_mm, far_mm=far_mm).depth_mm)


def remove_nearer(light_field: LightField, depths: ViewDepths, depth_mm: float) -> LightField:
    """Remove everything nearer than a depth from the pupil: its weights, and those within EDGE_PX, become zero.

    The refocused or rendered result shows what lies behind, where any view sees it (cf. Vaish et al., CVPR 2006).
    """
    reference_view_depth_mm = light_field.reference_view_depth_mm
    if not depth_mm > reference_view_depth_mm:
        raise InputError(
            f"nothing lies in front of {depth_mm:g} mm, expected a depth beyond {reference_view_depth_mm:.0f} mm"
        )
    is_nearer = (depths.inverse_distance > 1.0 / (depth_mm - reference_view_depth_mm)).astype(np.uint8)
    kernel = np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)
    weights, samples = light_field.weights.copy(), light_field.samples.copy()
    for index in np.ndindex(light_field.rows, light_field.cols):
        removed = np.asarray(cv2.dilate(is_nearer[index], kernel)) > 0
        weights[index][removed] = 0.0
        samples[index][removed] = 0
    return LightField.of(light_field, samples, weights)


def px_per_inverse_mm(views: Views) -> float:
    """Return the disparity at the longest baseline, px, per 1/mm of inverse distance."""
    return float(views.focal_px * np.abs(views.positions_mm[..., :2]).max())


def project_pixels(
    views: Views, source: tuple[int, int], position_mm: NDArray[np.floating], inverse_distance: Float32
) -> tuple[Float32, Float32]:
    """Project a view's pixels, given their inverse distance, into a pinhole at a position in the view frame.

    Parameters
    ----------
    views
        Geometry of the light field.
    source
        Row t and column s of the view.
    position_mm
        Position (3,) of the pinhole in the view frame.
    inverse_distance
        Inverse distance (v, u) of the view's pixels, 1 / Z in 1/mm.

    Returns
    -------
    u, v
        Pixel coordinates (v, u) in the pinhole's image, on the views' pixel grid; unchanged on the reference plane.
    """
    return _pixels_between(views, views.positions_mm[source], position_mm, inverse_distance)


def pixels_in_view(
    views: Views, position_mm: NDArray[np.floating], target: tuple[int, int], inverse_distance: Float32
) -> tuple[Float32, Float32]:
    """Return the pixels of a view that show the points seen by a pinhole at a position, from their 1 / Z (v, u)."""
    return _pixels_between(views, position_mm, views.positions_mm[target], inverse_distance)


def _pixels_between(
    views: Views, start_mm: NDArray[np.floating], end_mm: NDArray[np.floating], inverse_distance: Float32
) -> tuple[Float32, Float32]:
    """Return the pixels in the pinhole at `end_mm` of the points that the pinhole at `start_mm` shows in each pixel.

    In both, a pixel stands for a point (a, b, Z0) of the reference plane. The point on its line of sight from `start`
    is start + (a - x, b - y, Z0 - z) k with k = (Z - z) / (Z0 - z); seen from `end`, it covers the point
    (a', b') = end + (point - end) (Z0 - z') / (Z - z') of that plane. All terms are divided by Z and Z0, which may be
    infinite.
    """
    inverse_reference = 1.0 / views.reference_distance_mm
    scale_start = (1.0 - start_mm[2] * inverse_distance) / (1.0 - start_mm[2] * inverse_reference)
    scale_end = (1.0 - end_mm[2] * inverse_reference) / (1.0 - end_mm[2] * inverse_distance)
    pixels = np.arange(views.width_px), np.arange(views.height_px)[:, None]
    result = []
    for axis in (0, 1):
        direction = (pixels[axis] - views.centre_px[axis]) / views.focal_px
        point = (start_mm[axis] - end_mm[axis]) * inverse_distance + (
            direction - start_mm[axis] * inverse_reference
        ) * scale_start
        pixel = views.focal_px * (end_mm[axis] * inverse_reference + point * scale_end) + views.centre_px[axis]
        result.append(pixel.astype(np.float32))
    return result[0], result[1]


def inverse_distance_from(views: Views, maps: Float32, position_mm: NDArray[np.floating]) -> Float32:
    """Return 1 / Z (v, u) of the nearest surface that a pinhole at a position sees.

    Holes are filled from farther surfaces; beyond the borders of the views, the adjacent surface continues.

    `maps` (t, s, v, u) holds the views' values, NaN if unknown. Raises InputError if all are unknown.
    """
    height, width = views.height_px, views.width_px
    nearest = np.full(height * width, -1.0, np.float32)
    for index in np.ndindex(views.rows, views.cols):
        if not np.isfinite(maps[index]).any():
            continue
        u, v = project_pixels(views, index, position_mm, maps[index])
        inside = np.isfinite(u) & (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
        cells = np.rint(v[inside]).astype(np.intp) * width + np.rint(u[inside]).astype(np.intp)
        np.maximum.at(nearest, cells, maps[index][inside])
    surface = nearest.reshape(height, width)
    if not (surface >= 0).any():
        raise InputError("no depth is known in any view, expected at least one known pixel")
    complete = fill_holes(
        np.where(surface < 0, np.float32(np.nan), surface), 2.0 * AGREEMENT_PX / px_per_inverse_mm(views)
    )
    return np.asarray(cv2.medianBlur(complete.astype(np.float32), 3), dtype=np.float32)


def _visible_in_reference(
    views: Views, reference: tuple[int, int], inverse_distance: Float32, reference_map: Float32
) -> NDArray[np.bool_]:
    """Return the mask (t, s, v, u) of the pixels whose points the reference view shows at the same depth (v, u)."""
    tolerance = np.float32(AGREEMENT_PX / px_per_inverse_mm(views))
    visible = np.zeros(inverse_distance.shape, dtype=bool)
    for index in np.ndindex(views.rows, views.cols):
        u, v = project_pixels(views, index, views.positions_mm[reference], inverse_distance[index])
        visible[index] = np.abs(sample_nearest(reference_map, u, v) - inverse_distance[index]) <= tolerance
    return visible


def sample_nearest(values: Float32, u: Float32, v: Float32) -> Float32:
    """Return the values at the nearest pixels; NaN outside and where a value is NaN."""
    valid = np.isfinite(u) & np.isfinite(v)
    # OpenCV's border value would blend NaN into adjacent pixels.
    columns, rows = np.where(valid, np.rint(u), -1.0), np.where(valid, np.rint(v), -1.0)
    inside = (columns >= 0) & (rows >= 0) & (columns < values.shape[1]) & (rows < values.shape[0])
    picked = values[np.where(inside, rows, 0).astype(np.intp), np.where(inside, columns, 0).astype(np.intp)]
    return np.where(inside, picked, np.float32(np.nan))


def fill_holes(inverse_distance: Float32, tolerance: float) -> Float32:
    """Fill the holes (NaN) of a map (v, u) of 1 / Z with the background.

    Holes are disocclusions behind nearer objects. Of the nearest known values to the left, right, top and bottom, those
    within `tolerance` of the farthest are averaged, weighted by inverse pixel distance. Between a known value and a
    border of the picture, the nearest value is extrapolated. Single-pixel cracks of forward warping get the farther of
    the two adjacent values. Raises ValueError if no value is known.
    """
    if np.isnan(inverse_distance).all():
        raise ValueError("all pixels are holes, expected at least one known pixel")
    inverse_distance = _fill_cracks(inverse_distance)
    while (holes := np.isnan(inverse_distance)).any():
        ends = [_adjacent(inverse_distance, axis, forward=forward) for axis in (0, 1) for forward in (True, False)]
        values = np.stack([value[holes] for value, _ in ends])
        distances = np.stack([distance[holes] for _, distance in ends])
        valid = ~np.isnan(values)
        lines = valid.reshape(2, 2, -1)
        # A missing end means the picture's border.
        bounded = (lines[:, 0] == lines[:, 1]).all(axis=0)
        farthest = np.where(valid, values, np.inf).min(axis=0)
        nearest = np.where(valid, distances, np.inf).min(axis=0)
        chosen = valid & np.where(bounded, values <= farthest + tolerance, distances <= nearest)
        weights = np.where(chosen, 1.0 / distances, 0.0)
        total = weights.sum(axis=0)
        mean = np.divide((np.where(valid, values, 0.0) * weights).sum(axis=0), total, where=total > 0, out=total.copy())
        inverse_distance = inverse_distance.copy()
        inverse_distance[holes] = np.where(total > 0, mean, np.nan)
    return inverse_distance


def _fill_cracks(inverse_distance: Float32) -> Float32:
    """Fill single pixels between two known ones with the farther value."""
    for axis in (0, 1):
        length = inverse_distance.shape[axis]
        if length < 3:
            continue
        before, middle, after = (np.take(inverse_distance, np.arange(k, length - 2 + k), axis=axis) for k in (0, 1, 2))
        inverse_distance = inverse_distance.copy()
        inner = (slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))
        inverse_distance[inner] = np.where(np.isnan(middle), np.minimum(before, after), middle)
    return inverse_distance


def _adjacent(inverse_distance: Float32, axis: int, *, forward: bool) -> tuple[Float32, Float32]:
    """Return the last known value before each pixel along an axis, or the first after it, and its distance in px."""
    lines = np.moveaxis(inverse_distance, axis, 1)
    lines = lines if forward else lines[:, ::-1]
    columns = np.arange(lines.shape[1])
    last = np.maximum.accumulate(np.where(np.isnan(lines), -1, columns), axis=1)
    value = np.take_along_axis(lines, np.maximum(last, 0), axis=1)
    value = np.where(last >= 0, value, np.float32(np.nan))
    distance = (columns - last).astype(np.float32)
    if not forward:
        value, distance = value[:, ::-1], distance[:, ::-1]
    return np.moveaxis(value, 1, axis), np.moveaxis(distance, 1, axis)
