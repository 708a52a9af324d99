"""Videos of light fields: pictures at the reference depth, the same in all views, with independent noise."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import grid_views

WIDTH_PX, HEIGHT_PX = 120, 90
SIGMA = 2.0


def picture(seed: int = 0, grain_px: float = 2.0, contrast: float = 20.0) -> Any:
    """A textured picture (v, u, 3), 0 to 255."""
    random = np.random.default_rng(seed)
    grains = cv2.GaussianBlur(random.normal(size=(HEIGHT_PX, WIDTH_PX, 3)), (0, 0), grain_px)
    return np.clip(120.0 + contrast * grains / grains.std(), 0.0, 255.0)


def shot(pictures: Any, random: np.random.Generator, sigma: float = SIGMA, **changes: Any) -> LightField:
    """Return an 8-bit frame of 3x3 views of a picture (v, u, c), or of one each (t, s, v, u, c), with noise."""
    colours = pictures.shape[-1]
    samples = np.broadcast_to(pictures, (3, 3, HEIGHT_PX, WIDTH_PX, colours))
    noisy = samples + sigma * random.normal(size=samples.shape)
    weights = np.ones(samples.shape[:4], np.float32)
    views = grid_views(uneven=False, **changes)
    return LightField.of(views, np.clip(np.rint(noisy), 0, 255).astype(np.uint8), weights)


def error_grey(light_field: LightField, truth: Any) -> Any:
    """Return the errors (t, s, v, u, c) of a light field's samples, from 0 to 255."""
    full = 1.0 if light_field.samples.dtype == np.uint8 else 255.0
    return light_field.samples * full - truth
