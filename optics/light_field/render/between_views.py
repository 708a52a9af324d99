"""Views between the views, rendered by depth, so that what is out of focus blurs without a copy of its edges per view.

Few views sample the aperture at few places: beyond a pixel of parallax from one to the next, a blur is a row of ghosts
(Chai et al., Plenoptic sampling, SIGGRAPH 2000). Views in between, interpolated by depth, close the steps.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.render.perspective import seen_from
from mirrorcam.optics.light_field.render.view_depths import ViewDepths

MOST_PIXELS = 200_000_000
"""Pixels of all views together, in 16 bytes each at most."""


def with_views_between(light_field: LightField, depths: ViewDepths, count: int) -> LightField:
    """The light field with `count` views more between neighbours, along rows and columns; its own stay as they are.

    Each is rendered from the views around it, at their mean position. Where they show nothing, weights are zero.

    Raises InputError where the views are no grid, and for more than `MOST_PIXELS` in all.
    """
    light_field.require_grid("interpolation between the views")
    step = count + 1
    shape = (light_field.rows - 1) * step + 1, (light_field.cols - 1) * step + 1
    if shape[0] * shape[1] * light_field.height_px * light_field.width_px > MOST_PIXELS:
        raise InputError(
            f"{count} views between neighbours make {shape[1]}x{shape[0]} views of "
            f"{light_field.width_px}x{light_field.height_px} px, expected {MOST_PIXELS / 1e6:.0f} million px at most"
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
        place = np.einsum("t,s,tsk->k", down, right, light_field.positions_mm[rows, cols])
        around = part_of(light_field, rows, cols)
        picture = seen_from(around, ViewDepths(depths.nearness[rows, cols], depths.sure[rows, cols]), place)
        positions[row, col] = place
        shown: Any = picture.image * picture.valid[..., None]
        whole = light_field.samples.dtype == np.uint8
        samples[row, col] = np.rint(np.clip(shown, 0.0, 1.0) * np.float32(255.0)) if whole else shown
        weights[row, col] = picture.valid
    geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
    return LightField(**(geometry | {"positions_mm": positions}), samples=samples, weights=weights)


def _around(number: int, step: int) -> tuple[slice, FloatArray]:
    """The one or two real views about a number, and how much each counts."""
    first, part = divmod(number, step)
    return slice(first, first + 1 + (part > 0)), np.array([1.0 - part / step, part / step])[: 1 + (part > 0)]


def part_of(light_field: LightField, rows: slice, cols: slice) -> LightField:
    """Some of the views, in the same frame, whether or not the reference view is among them."""
    geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
    geometry["positions_mm"] = light_field.positions_mm[rows, cols]
    return LightField(**geometry, samples=light_field.samples[rows, cols], weights=light_field.weights[rows, cols])
