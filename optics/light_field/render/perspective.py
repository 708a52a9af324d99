"""Rendering by depth: all-in-focus pictures, from the reference view or from any position between the views.

The depths of all views give the surface at each pixel, the nearest one hiding the others; its colour comes from the
views that see it, weighted by their distance (depth-based rendering; Buehler et al., Unstructured Lumigraph, SIGGRAPH
2001).

Few views sample the aperture sparsely: if the parallax between adjacent views exceeds a pixel, a blur becomes a row of
ghosts (Chai et al., Plenoptic sampling, SIGGRAPH 2000). Interpolated intermediate views prevent this.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.render.refocusing import Float32, RenderedPicture, premultiplied
from mirrorcam.optics.light_field.render.view_depths import (
    AGREE_PX,
    ViewDepths,
    at,
    nearness_from,
    px_per_nearness,
    sources,
)

UNKNOWN, CONTRADICTING = 0.01, 0.0001
"""Weights of views with unknown or contradicting depth: they count only where no other view does."""
MIN_WEIGHT = 1e-20
"""Weights below any view's with a sample: rounding errors."""
VIEW_SIGMA = 0.03
"""Standard deviation between views of the same point, relative to white: mirrors, glints, noise."""
WINDOW_PX = 3
MIN_DISTANCE = 0.1
"""Distance, in view distances, at which a view counts as if it were at the position itself."""
MAX_PIXELS = 200_000_000
"""Largest number of pixels of all views, at up to 16 bytes each."""


def all_in_focus(light_field: LightField, depths: ViewDepths) -> RenderedPicture:
    """Denoise the reference view: each pixel averages the views that agree at its measured depth."""
    return _rendered(light_field, depths, np.zeros(3), np.ones((light_field.rows, light_field.cols)))


def seen_from(light_field: LightField, depths: ViewDepths, place_mm: FloatArray) -> RenderedPicture:
    """Render the view of a pinhole at a position (3,) in the view frame, mm right, down and ahead of the reference
    view.

    Equal pixels show equal points of the reference plane, as in all views.

    Raises InputError for a position outside the bounding box of the views.
    """
    position = np.asarray(place_mm, dtype=np.float64)
    box = light_field.positions_mm.reshape(-1, 3)
    low, high = box.min(axis=0), box.max(axis=0)
    outside = np.maximum(low - position, position - high)[:2].max()
    if not outside <= 1e-6:
        raise InputError(
            f"position ({position[0]:g}, {position[1]:g}) mm lies outside the views, expected "
            f"({low[0]:.1f} to {high[0]:.1f}, {low[1]:.1f} to {high[1]:.1f})"
        )
    distance_squared = np.square(light_field.positions_mm - position).sum(axis=-1)
    spacing = np.square(high - low)[:2].sum() / max(1, (light_field.rows * light_field.cols))
    return _rendered(light_field, depths, position, 1.0 / np.square(distance_squared / spacing + MIN_DISTANCE**2))


def orbit(views: Views, frames: int) -> Iterator[FloatArray]:
    """Yield positions (3,) on the largest ellipse about the centre of the views' box that stays within the grid."""
    outer = views.positions_mm
    left, right = outer[:, 0, 0].max(), outer[:, -1, 0].min()
    top, bottom = outer[0, :, 1].max(), outer[-1, :, 1].min()
    centre = np.array([(left + right) / 2.0, (top + bottom) / 2.0, 0.0])
    radius = np.array([(right - left) / 2.0, (bottom - top) / 2.0])
    for angle in 2.0 * np.pi * np.arange(frames) / frames:
        yield centre + np.array([radius[0] * np.cos(angle), radius[1] * np.sin(angle), 0.0])


def _rendered(
    light_field: LightField, depths: ViewDepths, position: FloatArray, counts: NDArray[np.floating]
) -> RenderedPicture:
    known = np.where(depths.sure & (light_field.weights > 0), depths.nearness, np.float32(np.nan))
    nearness = nearness_from(light_field, known, position)
    tolerance = np.float32(AGREE_PX / px_per_nearness(light_field))
    height, width, channels = *nearness.shape, light_field.samples.shape[-1]
    total, weights = np.zeros((height, width, channels + 1), np.float32), np.zeros((height, width), np.float32)
    at_position = [tuple(each) for each in np.argwhere((light_field.positions_mm == position).all(axis=-1))]
    guide = _smoothed(premultiplied(light_field, at_position[0])) if at_position else None
    for index in np.ndindex(light_field.rows, light_field.cols):
        u, v = sources(light_field, position, index, nearness)
        shown: Any = cv2.remap(premultiplied(light_field, index), u, v, cv2.INTER_LINEAR)
        measured = at(known[index], u, v)
        trust = np.where(
            np.abs(measured - nearness) <= tolerance, 1.0, np.where(np.isnan(measured), UNKNOWN, CONTRADICTING)
        )
        if index in at_position:
            trust[...] = 1.0  # At its own position, a view shows exactly the visible points, for any depth.
        elif guide is not None:
            trust *= _similarity(_smoothed(shown), guide)
        shown *= trust[..., None].astype(np.float32)
        weights += shown[..., -1]
        total += shown * np.float32(counts[index] / counts.max())
    weights[total[..., -1] < MIN_WEIGHT] = 0.0
    reciprocal = np.divide(1.0, total[..., -1:], out=np.zeros_like(total[..., -1:]), where=weights[..., None] > 0)
    return RenderedPicture(total[..., :-1] * reciprocal, weights)


def _smoothed(shown: Float32) -> Float32:
    return np.asarray(cv2.blur(shown, (WINDOW_PX, WINDOW_PX)), dtype=np.float32)


def _similarity(shown: Float32, guide: Float32) -> Float32:
    """Likelihood (v, u) that two softened weighted pictures (v, u, c + 1) show the same; 1 where one has no sample."""
    weight, guiding = shown[..., -1:], guide[..., -1:]
    both = (weight[..., 0] > 0.5) & (guiding[..., 0] > 0.5)
    difference = shown[..., :-1] / np.maximum(weight, 0.5) - guide[..., :-1] / np.maximum(guiding, 0.5)
    likely = np.maximum(np.exp(-np.square(difference).mean(axis=-1) / (2.0 * VIEW_SIGMA**2)), CONTRADICTING)
    return np.where(both, likely, np.float32(1.0)).astype(np.float32)


def with_views_between(light_field: LightField, depths: ViewDepths, count: int) -> LightField:
    """Insert `count` views between adjacent ones, along rows and columns; the original views are unchanged.

    Each is rendered from the views around it, at their mean position. Its weights are zero where these show nothing.

    Raises InputError if the views form no grid, or for more than `MAX_PIXELS` in total.
    """
    light_field.require_grid("interpolation between the views")
    step = count + 1
    shape = (light_field.rows - 1) * step + 1, (light_field.cols - 1) * step + 1
    if shape[0] * shape[1] * light_field.height_px * light_field.width_px > MAX_PIXELS:
        raise InputError(
            f"{count} views between adjacent ones make {shape[1]}x{shape[0]} views of "
            f"{light_field.width_px}x{light_field.height_px} px, expected at most {MAX_PIXELS / 1e6:.0f} million px"
        )
    positions = np.empty((*shape, 3))
    samples = np.empty((*shape, *light_field.samples.shape[2:]), light_field.samples.dtype)
    weights = np.empty((*shape, *light_field.weights.shape[2:]), np.float32)
    for row, col in np.ndindex(*shape):
        t, s = row // step, col // step
        if row % step == 0 and col % step == 0:
            positions[row, col] = light_field.positions_mm[t, s]
            samples[row, col], weights[row, col] = light_field.samples[t, s], light_field.weights[t, s]
            continue
        (rows, down), (cols, right) = _around(row, step), _around(col, step)
        position = np.einsum("t,s,tsk->k", down, right, light_field.positions_mm[rows, cols])
        neighbouring = part_of(light_field, rows, cols)
        picture = seen_from(neighbouring, ViewDepths(depths.nearness[rows, cols], depths.sure[rows, cols]), position)
        positions[row, col] = position
        shown: Any = picture.image * picture.valid[..., None]
        is_bytes = light_field.samples.dtype == np.uint8
        samples[row, col] = np.rint(np.clip(shown, 0.0, 1.0) * np.float32(255.0)) if is_bytes else shown
        weights[row, col] = picture.valid
    geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
    return LightField(**(geometry | {"positions_mm": positions}), samples=samples, weights=weights)


def _around(number: int, step: int) -> tuple[slice, FloatArray]:
    """Return the one or two original views next to a number, and their weights."""
    first, offset = divmod(number, step)
    count = 1 + (offset > 0)
    return slice(first, first + count), np.array([1.0 - offset / step, offset / step])[:count]


def part_of(light_field: LightField, rows: slice, cols: slice) -> LightField:
    """Select some of the views, in the same frame, with or without the reference view."""
    geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
    geometry["positions_mm"] = light_field.positions_mm[rows, cols]
    return LightField(**geometry, samples=light_field.samples[rows, cols], weights=light_field.weights[rows, cols])
