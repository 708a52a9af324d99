"""Views moved to an even grid, depth by depth: what the paper left out as "compensation for translational error"."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.light_field.light_field import LightField, Views


def moved_to_regular_grid(light_field: LightField, depth_mm: NDArray[np.floating]) -> LightField:
    """The light field as seen from `Views.on_regular_grid`, by the depth (v, u) of its reference view from the pupil.

    Every pixel of a moved view looks along its ray until it meets the surface that the depth map tells, and takes what
    the true view sees there. An error of depth shows only in proportion to how far the view was moved. Weights are zero
    where no depth is known (NaN in the map, or hidden from the reference view), and where the true view has no sample.

    Without a depth map, `Decoder(layout, regular_grid_at_mm=...)` does it for one depth, in the same lookup.

    Raises InputError for a depth map of another size, and for one that lies nearer than a view.
    """
    shape = light_field.height_px, light_field.width_px
    if depth_mm.shape != shape:
        raise InputError(f"depth map has shape {depth_mm.shape}, expected {shape} of the views")
    behind_mm = light_field.reference_view_depth_mm
    distance = np.asarray(depth_mm, dtype=np.float64) - behind_mm
    regular = light_field.on_regular_grid()
    nearest = max(float(light_field.positions_mm[..., 2].max()), 0.0)
    if (distance <= nearest).any():
        raise InputError(
            f"depth map has a depth of {np.nanmin(depth_mm):.4g} mm, expected all beyond {nearest + behind_mm:.4g} mm"
        )
    samples, weights = light_field.samples.copy(), light_field.weights.copy()
    for view in np.ndindex(light_field.rows, light_field.cols):
        if np.array_equal(regular.positions_mm[view], light_field.positions_mm[view]):
            continue
        u, v = cv2.split(_sources(light_field, regular, view, _seen_from(regular, view, distance)))
        picked = cv2.remap(light_field.samples[view], u, v, cv2.INTER_LINEAR)
        whole = cv2.remap(light_field.weights[view], u, v, cv2.INTER_LINEAR)
        weights[view] = np.where(np.asarray(whole) > 0.999, np.float32(1.0), np.float32(0.0))
        samples[view] = np.where(weights[view][..., None] > 0, np.asarray(picked).reshape(samples[view].shape), 0)
    return LightField.of(regular, samples, weights)


def _seen_from(regular: Views, view: tuple[int, int], distance: FloatArray) -> FloatArray:
    """Distance (v, u) from the reference view of what a view sees, by that of what the reference view sees; else NaN.

    Each pixel of the reference view falls on up to four of the view; the nearest that falls on one hides the others.
    """
    height, width = distance.shape
    known = np.isfinite(distance)
    pixels = (regular.pixel_grid()[known] - regular.centre_px) / regular.focal_px
    points = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) * distance[known][:, None]
    offset, matrix = points - regular.positions_mm[view], regular.matrices[view]
    landed = offset[:, :2] / offset[:, 2:] * matrix[0, 0] + matrix[:2, 2]
    corner = np.floor(landed).astype(np.int64)
    seen = np.full((height, width), np.inf)
    for step in ((0, 0), (1, 0), (0, 1), (1, 1)):
        u, v = (corner + step).T
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        np.minimum.at(seen, (v[inside], u[inside]), distance[known][inside])
    return np.where(np.isfinite(seen), seen, np.nan)


def _sources(true: Views, regular: Views, view: tuple[int, int], seen: FloatArray) -> NDArray[np.float32]:
    """Pixels (v, u, 2) of the true view that show what the moved view sees; outside of it where that is not known."""
    place, matrix = regular.positions_mm[view], regular.matrices[view]
    along = (seen - place[2])[..., None]
    across = (regular.pixel_grid() - matrix[:2, 2]) / matrix[0, 0] * along + place[:2]
    points = np.concatenate([across, seen[..., None]], axis=-1)
    offset, matrix = points - true.positions_mm[view], true.matrices[view]
    pixels = offset[..., :2] / offset[..., 2:] * matrix[0, 0] + matrix[:2, 2]
    return np.where(np.isfinite(pixels), pixels, -2.0).astype(np.float32)
