"""Depth maps of all views, for rendering other views and deciding occlusion.

Holes in maps of nearness that were warped from one view to another are filled from the background.
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
AGREE_PX = 1.0
"""Depths agree if the farthest view shows them at positions at most this far apart."""
EDGE_PX = 2
"""Distance around a removed object at which samples may still contain it: they blend two pixels of the frame."""


@dataclass(frozen=True, eq=False)
class ViewDepths:
    """Nearness maps of all views of a light field.

    Attributes
    ----------
    nearness
        Nearness (t, s, v, u), float32: 1 / Z in 1/mm, Z from the reference view along view z; NaN if unknown.
    sure
        Mask (t, s, v, u) of pixels whose nearness was measured, not filled in.
    """

    nearness: Float32
    sure: NDArray[np.bool_]

    def depth_mm(self, views: Views) -> Float32:
        """Depth (t, s, v, u) in mm from the pupil; NaN if unknown."""
        pupil_mm = np.float32(views.reference_view_depth_mm)
        with np.errstate(divide="ignore"):
            return np.asarray(np.float32(1.0) / self.nearness + pupil_mm)

    @classmethod
    def of_depths(cls, views: Views, depth_mm: NDArray[np.floating]) -> ViewDepths:
        """Build from depths (t, s, v, u) in mm from the pupil, possibly infinite; NaN if unknown, measured otherwise.

        Raises InputError for depths of another shape, or behind the reference view.
        """
        expected = views.rows, views.cols, views.height_px, views.width_px
        if depth_mm.shape != expected:
            raise InputError(f"depths have shape {depth_mm.shape}, expected {expected} of the views")
        pupil_mm = views.reference_view_depth_mm
        distance = np.asarray(depth_mm, dtype=np.float64) - pupil_mm
        if (distance <= 0).any():
            raise InputError(f"a depth of {np.nanmin(depth_mm):.4g} mm, expected all beyond {pupil_mm:.4g} mm")
        return cls((1.0 / distance).astype(np.float32), ~np.isnan(depth_mm))

    @classmethod
    def of_reference(cls, views: Views, depth_mm: NDArray[np.floating]) -> ViewDepths:
        """Build all views' depths from the reference view's (v, u), in mm from the pupil, NaN if unknown.

        Points that it does not see appear in other views behind their occluders: their depth is taken from the farther
        neighbour and marked as not measured.

        Raises InputError for depths of another shape, behind the reference view, or entirely unknown.
        """
        reference, shape = reference_index(views), (views.rows, views.cols, views.height_px, views.width_px)
        if depth_mm.shape != shape[2:]:
            raise InputError(f"depth has shape {depth_mm.shape}, expected {shape[2:]} of the views")
        depths_mm = np.full(shape, np.nan)
        depths_mm[reference] = depth_mm
        known = cls.of_depths(views, depths_mm).nearness
        nearness = np.stack([nearness_from(views, known, place) for place in views.positions_mm.reshape(-1, 3)])
        nearness = nearness.reshape(shape)
        nearness[reference] = np.where(np.isnan(known[reference]), nearness[reference], known[reference])
        return cls(nearness, _seen_by(views, reference, nearness, known[reference]))

    @classmethod
    def measured(
        cls, light_field: LightField, *, near_mm: float | None = None, far_mm: float | None = None
    ) -> ViewDepths:
        """Measure depth in the reference view with `DepthEstimator`, and transfer it to the others by `of_reference`.

        Raises InputError if `DepthEstimator` cannot measure depth.
        """
        return cls.of_reference(light_field, estimate_depth(light_field, near_mm=near_mm, far_mm=far_mm).depth_mm)


def without_nearer(light_field: LightField, depths: ViewDepths, depth_mm: float) -> LightField:
    """Remove everything nearer than a depth from the pupil: its weights, and those just around, become zero.

    The refocused or rendered result shows what lies behind, where any view sees it (Vaish et al., CVPR 2006, by depth).
    """
    pupil_mm = light_field.reference_view_depth_mm
    if not depth_mm > pupil_mm:
        raise InputError(f"nothing lies nearer than {depth_mm:g} mm, expected a depth beyond {pupil_mm:.0f} mm")
    nearer = (depths.nearness > 1.0 / (depth_mm - pupil_mm)).astype(np.uint8)
    kernel = np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)
    weights, samples = light_field.weights.copy(), light_field.samples.copy()
    for index in np.ndindex(light_field.rows, light_field.cols):
        removed = np.asarray(cv2.dilate(nearer[index], kernel)) > 0
        weights[index][removed] = 0.0
        samples[index][removed] = 0
    return LightField.of(light_field, samples, weights)


def px_per_nearness(views: Views) -> float:
    """Shift in px between the reference view and the farthest one, per 1/mm of inverse distance."""
    return float(views.focal_px * np.abs(views.positions_mm[..., :2]).max())


def projected(
    views: Views, source: tuple[int, int], place_mm: NDArray[np.floating], nearness: Float32
) -> tuple[Float32, Float32]:
    """Project a view's pixels by their nearness into a pinhole at a position in the view frame, on the views' plane.

    Parameters
    ----------
    views
        Geometry of the light field.
    source
        Row t and column s of the view.
    place_mm
        Position (3,) of the pinhole in the view frame.
    nearness
        Nearness (v, u) of the view's pixels, 1 / Z in 1/mm.

    Returns
    -------
    across, down
        Pixels u, v (v, u) on the grid of the views; points on the reference plane keep theirs.
    """
    return _pixels_between(views, views.positions_mm[source], place_mm, nearness)


def sources(
    views: Views, place_mm: NDArray[np.floating], target: tuple[int, int], nearness: Float32
) -> tuple[Float32, Float32]:
    """Pixels of a view that show the points seen by a pinhole at a position (3,), by their 1 / Z (v, u)."""
    return _pixels_between(views, place_mm, views.positions_mm[target], nearness)


def _pixels_between(
    views: Views, start_mm: NDArray[np.floating], end_mm: NDArray[np.floating], nearness: Float32
) -> tuple[Float32, Float32]:
    """Pixels of the pinhole at `end_mm` that show the points of the pixels of the pinhole at `start_mm`.

    In both, a pixel stands for a point (a, b, Z0) of the reference plane. The point on its line of sight from `start`
    is start + (a - x, b - y, Z0 - z) k with k = (Z - z) / (Z0 - z); seen from `end`, it covers the point
    (a', b') = end + (point - end) (Z0 - z') / (Z - z') of that plane. All terms are divided by Z and Z0, which may be
    infinite.
    """
    plane = 1.0 / views.reference_distance_mm
    first = (1.0 - start_mm[2] * nearness) / (1.0 - start_mm[2] * plane)
    second = (1.0 - end_mm[2] * plane) / (1.0 - end_mm[2] * nearness)
    pixels = np.arange(views.width_px), np.arange(views.height_px)[:, None]
    result = []
    for axis in (0, 1):
        across = (pixels[axis] - views.centre_px[axis]) / views.focal_px
        point = (start_mm[axis] - end_mm[axis]) * nearness + (across - start_mm[axis] * plane) * first
        pixel = views.focal_px * (end_mm[axis] * plane + point * second) + views.centre_px[axis]
        result.append(pixel.astype(np.float32))
    return result[0], result[1]


def nearness_from(views: Views, known: Float32, place_mm: NDArray[np.floating]) -> Float32:
    """1 / Z (v, u) of the nearest surface that a pinhole at a position sees.

    Holes are filled from farther surfaces; beyond the borders of the views, the adjacent surface continues.

    `known` (t, s, v, u) holds the views' values, NaN if unknown. Raises InputError if all are.
    """
    height, width = views.height_px, views.width_px
    nearest = np.full(height * width, -1.0, np.float32)
    for index in np.ndindex(views.rows, views.cols):
        if not np.isfinite(known[index]).any():
            continue
        u, v = projected(views, index, place_mm, known[index])
        inside = np.isfinite(u) & (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
        cells = np.rint(v[inside]).astype(np.intp) * width + np.rint(u[inside]).astype(np.intp)
        np.maximum.at(nearest, cells, known[index][inside])
    found = nearest.reshape(height, width)
    if not (found >= 0).any():
        raise InputError("no depth is known in any view, expected some to render with")
    complete = filled(np.where(found < 0, np.float32(np.nan), found), 2.0 * AGREE_PX / px_per_nearness(views))
    return np.asarray(cv2.medianBlur(complete.astype(np.float32), 3), dtype=np.float32)


def _seen_by(views: Views, reference: tuple[int, int], nearness: Float32, known: Float32) -> NDArray[np.bool_]:
    """Mask (t, s, v, u) of the pixels whose points the reference view shows at the same depth (v, u)."""
    tolerance = np.float32(AGREE_PX / px_per_nearness(views))
    visible = np.zeros(nearness.shape, dtype=bool)
    for index in np.ndindex(views.rows, views.cols):
        u, v = projected(views, index, views.positions_mm[reference], nearness[index])
        visible[index] = np.abs(at(known, u, v) - nearness[index]) <= tolerance
    return visible


def at(values: Float32, u: Float32, v: Float32) -> Float32:
    """Values (v, u) at the nearest pixels; NaN outside and where a value is NaN."""
    known = np.isfinite(u) & np.isfinite(v)
    # Not by OpenCV's border value: it would blend NaN into adjacent pixels.
    columns, rows = np.where(known, np.rint(u), -1.0), np.where(known, np.rint(v), -1.0)
    inside = (columns >= 0) & (rows >= 0) & (columns < values.shape[1]) & (rows < values.shape[0])
    picked = values[np.where(inside, rows, 0).astype(np.intp), np.where(inside, columns, 0).astype(np.intp)]
    return np.where(inside, picked, np.float32(np.nan))


def filled(nearness: Float32, tolerance: float) -> Float32:
    """Fill the holes (NaN) of a map (v, u) of 1 / Z with the background.

    A hole opens where a nearer object has moved off its background. Of the nearest values to the left, right, top and
    bottom, the farthest surface counts, with any within `tolerance` of it, weighted by closeness. Towards a border of
    the picture, where one end is missing, the nearest value continues. Cracks between pixels that have moved apart get
    the value of the farther one. Raises ValueError for a map of holes only.
    """
    if np.isnan(nearness).all():
        raise ValueError("a map of holes, expected some pixel to fill them from")
    nearness = _without_cracks(nearness)
    while (holes := np.isnan(nearness)).any():
        found = [_adjacent(nearness, axis, forward=forward) for axis in (0, 1) for forward in (True, False)]
        values = np.stack([value[holes] for value, _ in found])
        distances = np.stack([distance[holes] for _, distance in found])
        known = ~np.isnan(values)
        lines = known.reshape(2, 2, -1)
        # A missing end means the picture's border.
        closed = (lines[:, 0] == lines[:, 1]).all(axis=0)
        farthest = np.where(known, values, np.inf).min(axis=0)
        nearest = np.where(known, distances, np.inf).min(axis=0)
        chosen = known & np.where(closed, values <= farthest + tolerance, distances <= nearest)
        counts = np.where(chosen, 1.0 / distances, 0.0)
        total = counts.sum(axis=0)
        mean = np.divide((np.where(known, values, 0.0) * counts).sum(axis=0), total, where=total > 0, out=total.copy())
        nearness = nearness.copy()
        nearness[holes] = np.where(total > 0, mean, np.nan)
    return nearness


def _without_cracks(nearness: Float32) -> Float32:
    """Fill single pixels between two known ones with the farther value."""
    for axis in (0, 1):
        length = nearness.shape[axis]
        if length < 3:
            continue
        before, centre, after = (np.take(nearness, np.arange(k, length - 2 + k), axis=axis) for k in (0, 1, 2))
        nearness = nearness.copy()
        inner = (slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))
        nearness[inner] = np.where(np.isnan(centre), np.minimum(before, after), centre)
    return nearness


def _adjacent(nearness: Float32, axis: int, *, forward: bool) -> tuple[Float32, Float32]:
    """Last known value before each pixel along an axis, or first one after, and its distance; NaN without one."""
    lines = np.moveaxis(nearness, axis, 1)
    lines = lines if forward else lines[:, ::-1]
    columns = np.arange(lines.shape[1])
    last = np.maximum.accumulate(np.where(np.isnan(lines), -1, columns), axis=1)
    value = np.take_along_axis(lines, np.maximum(last, 0), axis=1)
    value = np.where(last >= 0, value, np.float32(np.nan))
    distance = (columns - last).astype(np.float32)
    if not forward:
        value, distance = value[:, ::-1], distance[:, ::-1]
    return np.moveaxis(value, 1, axis), np.moveaxis(distance, 1, axis)
