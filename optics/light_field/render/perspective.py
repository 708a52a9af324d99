"""Rendering by depth: all-in-focus pictures, from the reference view or from any position between the views.

The depths of all views give the nearest surface at each pixel; its colour comes from the views that see it, weighted by
their distance (depth-based rendering; Buehler et al., Unstructured Lumigraph, SIGGRAPH
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
    AGREEMENT_PX,
    ViewDepths,
    inverse_distance_from,
    pixels_in_view,
    px_per_inverse_mm,
    sample_nearest,
)

UNKNOWN, CONTRADICTING = 0.01, 0.0001
"""Weights of views with unknown or contradicting depth: they matter only where no other view contributes."""
MIN_WEIGHT = 1e-20
"""Weight below that of any view with a sample: rounding errors."""
VIEW_SIGMA = 0.03
"""Standard deviation of a point's brightness between views, relative to white: mirrors, glints, noise."""
WINDOW_PX = 3
MIN_DISTANCE = 0.1
"""Distance, in spacings of views, below which a view counts as if it were at the position itself."""
MAX_PIXELS = 200_000_000
"""Maximum number of pixels of all views, at up to 16 bytes each."""


def all_in_focus(light_field: LightField, depths: ViewDepths) -> RenderedPicture:
    """Denoise the reference view: each pixel averages the views that agree at its measured depth."""
    return _render(light_field, depths, np.zeros(3), np.ones((light_field.rows, light_field.cols)))


def render_view(light_field: LightField, depths: ViewDepths, position_mm: FloatArray) -> RenderedPicture:
    """Render the view of a pinhole at a position (3,) in the view frame, mm.

    A pixel shows the same point of the reference plane as in all views.

    Raises InputError for a position outside the bounding box of the views.
    """
    position = np.asarray(position_mm, dtype=np.float64)
    box = light_field.positions_mm.reshape(-1, 3)
    box_min, box_max = box.min(axis=0), box.max(axis=0)
    excess_mm = np.maximum(box_min - position, position - box_max)[:2].max()
    if not excess_mm <= 1e-6:
        raise InputError(
            f"position ({position[0]:g}, {position[1]:g}) mm lies outside the views, expected "
            f"({box_min[0]:.1f} to {box_max[0]:.1f}, {box_min[1]:.1f} to {box_max[1]:.1f})"
        )
    distance_squared = np.square(light_field.positions_mm - position).sum(axis=-1)
    spacing = np.square(box_max - box_min)[:2].sum() / max(1, (light_field.rows * light_field.cols))
    return _render(light_field, depths, position, 1.0 / np.square(distance_squared / spacing + MIN_DISTANCE**2))


def orbit(views: Views, frames: int) -> Iterator[FloatArray]:
    """Yield positions (3,) on the largest ellipse about the centre of the views' box that stays inside the grid."""
    positions = views.positions_mm
    left, col_weights = positions[:, 0, 0].max(), positions[:, -1, 0].min()
    top, bottom = positions[0, :, 1].max(), positions[-1, :, 1].min()
    centre = np.array([(left + col_weights) / 2.0, (top + bottom) / 2.0, 0.0])
    radius = np.array([(col_weights - left) / 2.0, (bottom - top) / 2.0])
    for angle in 2.0 * np.pi * np.arange(frames) / frames:
        yield centre + np.array([radius[0] * np.cos(angle), radius[1] * np.sin(angle), 0.0])


def _render(
    light_field: LightField, depths: ViewDepths, position: FloatArray, view_weights: NDArray[np.floating]
) -> RenderedPicture:
    measured_maps = np.where(depths.measured & (light_field.weights > 0), depths.inverse_distance, np.float32(np.nan))
    inverse_distance = inverse_distance_from(light_field, measured_maps, position)
    tolerance = np.float32(AGREEMENT_PX / px_per_inverse_mm(light_field))
    height, width, channels = *inverse_distance.shape, light_field.samples.shape[-1]
    total, weights = np.zeros((height, width, channels + 1), np.float32), np.zeros((height, width), np.float32)
    at_position = [tuple(view) for view in np.argwhere((light_field.positions_mm == position).all(axis=-1))]
    guide = _blur(premultiplied(light_field, at_position[0])) if at_position else None
    for index in np.ndindex(light_field.rows, light_field.cols):
        u, v = pixels_in_view(light_field, position, index, inverse_distance)
        sampled: Any = cv2.remap(premultiplied(light_field, index), u, v, cv2.INTER_LINEAR)
        estimate = sample_nearest(measured_maps[index], u, v)
        trust = np.where(
            np.abs(estimate - inverse_distance) <= tolerance, 1.0, np.where(np.isnan(estimate), UNKNOWN, CONTRADICTING)
        )
        if index in at_position:
            trust[...] = 1.0  # At its own position, a view shows exactly the visible points, for any depth.
        elif guide is not None:
            trust *= _similarity(_blur(sampled), guide)
        sampled *= trust[..., None].astype(np.float32)
        weights += sampled[..., -1]
        total += sampled * np.float32(view_weights[index] / view_weights.max())
    weights[total[..., -1] < MIN_WEIGHT] = 0.0
    reciprocal = np.divide(1.0, total[..., -1:], out=np.zeros_like(total[..., -1:]), where=weights[..., None] > 0)
    return RenderedPicture(total[..., :-1] * reciprocal, weights)


def _blur(sampled: Float32) -> Float32:
    return np.asarray(cv2.blur(sampled, (WINDOW_PX, WINDOW_PX)), dtype=np.float32)


def _similarity(sampled: Float32, guide: Float32) -> Float32:
    """Return the likelihood (v, u) that two blurred weighted pictures (v, u, c + 1) agree; 1 if one has no sample."""
    weight, guide_weight = sampled[..., -1:], guide[..., -1:]
    shared = (weight[..., 0] > 0.5) & (guide_weight[..., 0] > 0.5)
    difference = sampled[..., :-1] / np.maximum(weight, 0.5) - guide[..., :-1] / np.maximum(guide_weight, 0.5)
    likelihood = np.maximum(np.exp(-np.square(difference).mean(axis=-1) / (2.0 * VIEW_SIGMA**2)), CONTRADICTING)
    return np.where(shared, likelihood, np.float32(1.0)).astype(np.float32)


def insert_views(light_field: LightField, depths: ViewDepths, count: int) -> LightField:
    """Insert `count` views between adjacent ones, along rows and columns; the original views are unchanged.

    Each is rendered from the views around it, at their interpolated position. Its weights are zero where these show
    nothing.

    Raises InputError if the views do not form a grid, or for more than `MAX_PIXELS` in total.
    """
    light_field.require_grid("interpolation between the views")
    step = count + 1
    shape = (light_field.rows - 1) * step + 1, (light_field.cols - 1) * step + 1
    if shape[0] * shape[1] * light_field.height_px * light_field.width_px > MAX_PIXELS:
        raise InputError(
            f"{count} views between adjacent ones give {shape[1]}x{shape[0]} views of "
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
        (rows, row_weights), (cols, col_weights) = _around(row, step), _around(col, step)
        position = np.einsum("t,s,tsk->k", row_weights, col_weights, light_field.positions_mm[rows, cols])
        neighbours = part_of(light_field, rows, cols)
        picture = render_view(
            neighbours, ViewDepths(depths.inverse_distance[rows, cols], depths.measured[rows, cols]), position
        )
        positions[row, col] = position
        sampled: Any = picture.image * picture.valid[..., None]
        is_bytes = light_field.samples.dtype == np.uint8
        samples[row, col] = np.rint(np.clip(sampled, 0.0, 1.0) * np.float32(255.0)) if is_bytes else sampled
        weights[row, col] = picture.valid
    geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
    return LightField(**(geometry | {"positions_mm": positions}), samples=samples, weights=weights)


def _around(index: int, step: int) -> tuple[slice, FloatArray]:
    """Return the one or two original views around an index of the finer grid, and their weights."""
    first, offset = divmod(index, step)
    count = 1 + (offset > 0)
    return slice(first, first + count), np.array([1.0 - offset / step, offset / step])[:count]


def part_of(light_field: LightField, rows: slice, cols: slice) -> LightField:
    """Select some of the views, in the same frame, with or without the reference view."""
    geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
    geometry["positions_mm"] = light_field.positions_mm[rows, cols]
    return LightField(**geometry, samples=light_field.samples[rows, cols], weights=light_field.weights[rows, cols])
