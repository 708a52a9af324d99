"""Depth maps of all views, for rendering other views and deciding occlusion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.depth import estimate_depth
from mirrorcam.optics.light_field.light_field import LightField, Views

Float32 = NDArray[np.float32]

AGREE_PX = 1.0
"""Depths agree where the farthest view tells them apart by no more than that."""
FEWEST_AGREEING = 2
EDGE_PX = 2
"""How far around what is left out samples may still show some of it: they blend two pixels of the frame, softened."""


@dataclass(frozen=True, eq=False)
class ViewDepths:
    """Nearness of what all views of a light field see.

    Attributes
    ----------
    nearness
        Nearness (t, s, v, u), float32: 1 / Z in 1/mm, Z from the reference view along view z; NaN where not known.
    sure
        Mask (t, s, v, u) of pixels whose nearness other views confirm.
    """

    nearness: Float32
    sure: NDArray[np.bool_]

    def depth_mm(self, views: Views) -> Float32:
        """Depth (t, s, v, u) in mm from the pupil; NaN where not known."""
        behind = np.float32(views.reference_view_depth_mm)
        with np.errstate(divide="ignore"):
            return np.asarray(np.float32(1.0) / self.nearness + behind)

    @classmethod
    def of_depths(cls, views: Views, depth_mm: NDArray[np.floating]) -> ViewDepths:
        """Depths of views from (t, s, v, u) in mm from the pupil, infinity included; NaN where unknown, sure elsewhere.

        Raises InputError for depths of another shape, or behind the reference view.
        """
        expected = views.rows, views.cols, views.height_px, views.width_px
        if depth_mm.shape != expected:
            raise InputError(f"depths have shape {depth_mm.shape}, expected {expected} of the views")
        behind = views.reference_view_depth_mm
        distance = np.asarray(depth_mm, dtype=np.float64) - behind
        if (distance <= 0).any():
            raise InputError(f"a depth of {np.nanmin(depth_mm):.4g} mm, expected all beyond {behind:.4g} mm")
        return cls((1.0 / distance).astype(np.float32), ~np.isnan(depth_mm))

    @classmethod
    def measured(
        cls, light_field: LightField, *, near_mm: float | None = None, far_mm: float | None = None
    ) -> ViewDepths:
        """Measure by `DepthEstimator` in each view separately; a depth is sure where two others confirm it.

        Raises InputError where no depth can be measured, as `DepthEstimator`.
        """
        depth = np.empty(light_field.weights.shape, np.float32)
        for index in np.ndindex(light_field.rows, light_field.cols):
            moved = referred_to(light_field, index)
            depth[index] = estimate_depth(moved, near_mm=near_mm, far_mm=far_mm).depth_mm
        every = cls.of_depths(light_field, depth)
        return cls(every.nearness, _confirmed(light_field, every.nearness))


def referred_to(light_field: LightField, index: tuple[int, int]) -> LightField:
    """The same light field with view (t, s) as its reference view; samples and pinholes stay what they are."""
    place, matrix = light_field.positions_mm[index], light_field.matrices[index]
    return replace(
        light_field,
        positions_mm=light_field.positions_mm - place,
        focal_px=float(matrix[0, 0]),
        centre_px=matrix[:2, 2],
        reference_view_in_rig_mm=light_field.reference_view_in_rig_mm + place @ light_field.view_from_rig,
    )


def without_nearer(light_field: LightField, depths: ViewDepths, depth_mm: float) -> LightField:
    """The light field less what it shows nearer than a depth from the pupil: weights there, and just around, are zero.

    Refocused or rendered, it shows what lies behind, as far as any view looks past (Vaish et al., CVPR 2006, by depth).
    """
    behind = light_field.reference_view_depth_mm
    if not depth_mm > behind:
        raise InputError(f"nothing lies nearer than {depth_mm:g} mm, expected a depth beyond {behind:.0f} mm")
    nearer = (depths.nearness > 1.0 / (depth_mm - behind)).astype(np.uint8)
    around = np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)
    weights, samples = light_field.weights.copy(), light_field.samples.copy()
    for index in np.ndindex(light_field.rows, light_field.cols):
        hiding = np.asarray(cv2.dilate(nearer[index], around)) > 0
        weights[index][hiding] = 0.0
        samples[index][hiding] = 0
    return LightField.of(light_field, samples, weights)


def px_per_nearness(views: Views) -> float:
    """Shift in px between the reference view and the farthest one per 1/mm of inverse distance."""
    return float(views.focal_px * np.abs(views.positions_mm[..., :2]).max())


def landed(
    views: Views, source: tuple[int, int], place_mm: NDArray[np.floating], nearness: Float32
) -> tuple[Float32, Float32]:
    """Pixels at which a pinhole at a place (3,) in the view frame, on the views' plane, sees what a view's pixels show.

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
        Pixels u, v (v, u) on the grid of the views: those of the reference plane stay where they are.
    """
    return _seen_from(views, views.positions_mm[source], place_mm, nearness)


def sources(
    views: Views, place_mm: NDArray[np.floating], target: tuple[int, int], nearness: Float32
) -> tuple[Float32, Float32]:
    """Pixels at which a view sees what the pixels of a pinhole at a place (3,) show, by their 1 / Z (v, u)."""
    return _seen_from(views, place_mm, views.positions_mm[target], nearness)


def _seen_from(
    views: Views, start_mm: NDArray[np.floating], end_mm: NDArray[np.floating], nearness: Float32
) -> tuple[Float32, Float32]:
    """Pixels of the pinhole at `end_mm` that show what those of the one at `start_mm` do.

    In both a pixel stands for a point (a, b, Z0) of the reference plane; that of the line through `start` is
    start + (a - x, b - y, Z0 - z) k with k = (Z - z) / (Z0 - z), and seen from `end` it lies on the plane before
    (a', b') = end + (point - end) (Z0 - z') / (Z - z'). All divided by Z and by Z0, so that infinity is a place.
    """
    plane = 1.0 / views.reference_distance_mm
    first = (1.0 - start_mm[2] * nearness) / (1.0 - start_mm[2] * plane)
    second = (1.0 - end_mm[2] * plane) / (1.0 - end_mm[2] * nearness)
    pixels = np.arange(views.width_px), np.arange(views.height_px)[:, None]
    seen = []
    for axis in (0, 1):
        across = (pixels[axis] - views.centre_px[axis]) / views.focal_px
        point = (start_mm[axis] - end_mm[axis]) * nearness + (across - start_mm[axis] * plane) * first
        pixel = views.focal_px * (end_mm[axis] * plane + point * second) + views.centre_px[axis]
        seen.append(pixel.astype(np.float32))
    return seen[0], seen[1]


def _confirmed(views: Views, nearness: Float32) -> NDArray[np.bool_]:
    """Mask (t, s, v, u) of the pixels where enough other views found the same depth."""
    apart = np.float32(AGREE_PX / px_per_nearness(views))
    indices = list(np.ndindex(views.rows, views.cols))
    least = min(FEWEST_AGREEING, len(indices) - 1)
    confirmed = np.zeros(nearness.shape, dtype=bool)
    for index in indices:
        agreeing = np.zeros(nearness.shape[2:], np.int64)
        for other in indices:
            if other != index:
                u, v = landed(views, index, views.positions_mm[other], nearness[index])
                theirs = at(nearness[other], u, v)
                agreeing += np.abs(theirs - nearness[index]) <= apart
        confirmed[index] = agreeing >= least
    return confirmed


def at(values: Float32, u: Float32, v: Float32) -> Float32:
    """The values (v, u) of the nearest pixels; NaN outside, and where a pixel is NaN."""
    known = np.isfinite(u) & np.isfinite(v)
    # Not as a border's value: OpenCV would blend NaN into what lies beside it.
    columns, rows = np.where(known, np.rint(u), -1.0), np.where(known, np.rint(v), -1.0)
    inside = (columns >= 0) & (rows >= 0) & (columns < values.shape[1]) & (rows < values.shape[0])
    picked = values[np.where(inside, rows, 0).astype(np.intp), np.where(inside, columns, 0).astype(np.intp)]
    return np.where(inside, picked, np.float32(np.nan))
