"""Light fields of one plane at a known depth, and the shift per view that makes pictures of it agree."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

STEP_MM, FOCAL_PX, DISTANCE_MM = 10.0, 400.0, 455.0
"""Disparity of `plane`, whose reference plane lies 455 mm from the views."""
EDGE_PX = 16


def plane(rows: int, cols: int, disparity_px: float, *, uneven: bool = False, **changes: Any) -> LightField:
    """Return a textured plane, perpendicular to the views' axis, with a disparity per step of 10 mm."""
    views = grid_views(rows, cols, step_mm=STEP_MM, uneven=uneven, **changes)
    if uneven:
        flat = views.positions_mm * [1.0, 1.0, 0.0]
        views = grid_views(rows, cols, step_mm=STEP_MM, uneven=uneven, positions_mm=flat, **changes)
    inverse = 1.0 / views.reference_distance_mm + disparity_px / (views.focal_px * STEP_MM)
    return photograph(views, [Surface(1.0 / inverse, grain_mm=1.5)], noise=0.002)[0]


def with_gaps(light_field: LightField) -> LightField:
    """Return the light field without samples in corners that differ from view to view."""
    weights = light_field.weights.copy()
    for t, s in np.ndindex(weights.shape[:2]):
        weights[t, s, : 5 + t, : 7 + 2 * s] = 0.0
    samples: Any = light_field.samples * (weights > 0)[..., None].astype(light_field.samples.dtype)
    return LightField.of(light_field, samples, weights)


def shift_that_agrees(
    pictures: Any, offset: Callable[[float, int, int], tuple[float, float]], candidates: FloatArray
) -> float:
    """Return the number k for which pictures (t, s, v, u, c), read at (u, v) + offset(k, t, s), differ least."""
    rows, cols, height, width = pictures.shape[:4]
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    inside = (slice(EDGE_PX, -EDGE_PX), slice(EDGE_PX, -EDGE_PX))
    unlike = []
    for candidate in candidates:
        moved = []
        for t, s in np.ndindex(rows, cols):
            across, down = offset(float(candidate), t, s)
            picture = np.ascontiguousarray(pictures[t, s], np.float32)
            moved.append(cv2.remap(picture, u + np.float32(across), v + np.float32(down), cv2.INTER_LINEAR)[inside])
        unlike.append(np.var(moved, axis=0).mean())
    best = int(np.argmin(unlike))
    assert 0 < best < len(candidates) - 1
    # The minimum of the parabola through three points.
    before, here, after = unlike[best - 1 : best + 2]
    return float(
        candidates[best] + (candidates[1] - candidates[0]) * 0.5 * (before - after) / (before - 2 * here + after)
    )


CANDIDATES = np.linspace(-3, 3, 61)
