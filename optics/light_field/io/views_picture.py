"""A picture of all views beside each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.light_field import LightField

SEPARATOR_PX = 3
SEPARATOR_RGB = (255, 255, 255)
INVALID_RGB = (64, 64, 64)


def tiles(light_field: LightField) -> NDArray[np.uint8]:
    """The views as a grid (h, w, 3) in RGB, row t below row t - 1; dark grey where a view has no sample."""
    samples = light_field.samples
    if samples.dtype == np.float32:
        samples = np.rint(np.clip(samples.astype(np.float32), 0.0, 1.0) * 255.0).astype(np.uint8)
    views = np.where(light_field.valid[..., None], samples, np.array(INVALID_RGB, dtype=np.uint8))
    rows, cols, height, width = light_field.weights.shape
    down, across = height + SEPARATOR_PX, width + SEPARATOR_PX
    size = (rows * down - SEPARATOR_PX, cols * across - SEPARATOR_PX, 3)
    picture = np.full(size, SEPARATOR_RGB, dtype=np.uint8)
    for t, s in np.ndindex(rows, cols):
        picture[t * down : t * down + height, s * across : s * across + width] = views[t, s]
    return picture
