"""A picture of all views beside each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.light_field import LightField

SEPARATOR_PX = 3
SEPARATOR_RGB = (255, 255, 255)
INVALID_RGB = (64, 64, 64)
RATIOS = (1.0, 0.7, 1.4, 0.5, 2.0)
"""Factors between distances across and down; of those, the one is taken that leaves the smallest picture."""
FARTHEST = 1e6


def tiles(light_field: LightField) -> NDArray[np.uint8]:
    """The views beside each other (h, w, 3) in RGB, as they lie in space; dark grey where a view has no sample.

    A grid has row t below row t - 1.
    """
    samples = light_field.samples
    if samples.dtype == np.float32:
        samples = np.rint(np.clip(samples.astype(np.float32), 0.0, 1.0) * 255.0).astype(np.uint8)
    views = np.where(light_field.valid[..., None], samples, np.array(INVALID_RGB, dtype=np.uint8))
    height, width = light_field.height_px, light_field.width_px
    places = _places(light_field, np.array([width, height]) + SEPARATOR_PX)
    across, down = places.reshape(-1, 2).max(axis=0)
    picture = np.full((down + height, across + width, 3), SEPARATOR_RGB, dtype=np.uint8)
    for t, s in np.ndindex(light_field.rows, light_field.cols):
        left, top = places[t, s]
        picture[top : top + height, left : left + width] = views[t, s]
    return picture


def _places(light_field: LightField, tile_px: NDArray[np.int64]) -> NDArray[np.int64]:
    """Left and top (t, s, 2) of each view in a picture of tiles of a size (across, down), which do not overlap."""
    if light_field.is_grid:
        t, s = np.indices((light_field.rows, light_field.cols))
        return np.stack([s, t], axis=-1) * tile_px
    at = light_field.positions_mm[..., :2].reshape(-1, 2) / tile_px
    apart = np.abs(at[:, None] - at)[~np.eye(len(at), dtype=bool)]
    scales = []
    for ratio in RATIOS:
        # Two tiles lie apart along the axis along which their views do more.
        beside = apart[:, 0] * ratio >= apart[:, 1]
        scales.append(1.0 / np.array([apart[beside, 0].min(initial=FARTHEST), apart[~beside, 1].min(initial=FARTHEST)]))
    scale = min(scales, key=lambda scale: float(np.prod(scale * np.ptp(at, axis=0) + 1.0)))
    return np.ceil((at - at.min(axis=0)) * scale * tile_px).astype(np.int64)[None]
