"""Pictures with everything sharp: from the reference view, or from any place between the views.

Where each pixel's thing is comes from all views' depths, the nearest hiding the rest; its colour from the views that
see it there, by how near they stand (depth-based rendering; Buehler et al., Unstructured Lumigraph, SIGGRAPH 2001).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray, InputError
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

UNKNOWN, OTHER = 0.01, 0.0001
"""Weights of views whose depth is not known there, or contradicts: they count only where no other view does."""
LEAST = 1e-20
"""Below the weight of any view that has a sample: rounding errors."""
ALIKE = 0.03
"""Standard deviation of the differences between views of the same point, of full brightness: mirrors, glints, noise."""
ALIKE_PX = 3
STAND_IN = 0.1
"""A view this part of the views' distance away counts as one at the place itself."""


def all_in_focus(light_field: LightField, depths: ViewDepths) -> RenderedPicture:
    """The reference view with less noise: each pixel is the mean of the views that agree at its measured depth."""
    return _rendered(light_field, depths, np.zeros(3), np.ones((light_field.rows, light_field.cols)))


def seen_from(light_field: LightField, depths: ViewDepths, place_mm: FloatArray) -> RenderedPicture:
    """The picture of a pinhole at a place (3,) in the view frame, mm right, down and ahead of the reference view.

    Its pixels look at the same points of the reference plane as those of the views: what lies there stays in place.

    Raises InputError for a place outside the box of the views, where there is nothing to see.
    """
    place = np.asarray(place_mm, dtype=np.float64)
    box = light_field.positions_mm.reshape(-1, 3)
    low, high = box.min(axis=0), box.max(axis=0)
    beyond = np.maximum(low - place, place - high)[:2].max()
    if not beyond <= 1e-6:
        raise InputError(
            f"place ({place[0]:g}, {place[1]:g}) mm lies outside the views, expected "
            f"({low[0]:.1f} to {high[0]:.1f}, {low[1]:.1f} to {high[1]:.1f})"
        )
    away = np.square(light_field.positions_mm - place).sum(axis=-1)
    spacing = np.square(high - low)[:2].sum() / max(1, (light_field.rows * light_field.cols))
    return _rendered(light_field, depths, place, 1.0 / np.square(away / spacing + STAND_IN**2))


def orbit(views: Views, frames: int) -> Iterator[FloatArray]:
    """Places (3,) on the largest ellipse about the middle of the views' box that stays within the grid's edges."""
    outer = views.positions_mm
    left, right = outer[:, 0, 0].max(), outer[:, -1, 0].min()
    top, bottom = outer[0, :, 1].max(), outer[-1, :, 1].min()
    middle = np.array([(left + right) / 2.0, (top + bottom) / 2.0, 0.0])
    radius = np.array([(right - left) / 2.0, (bottom - top) / 2.0])
    for angle in 2.0 * np.pi * np.arange(frames) / frames:
        yield middle + np.array([radius[0] * np.cos(angle), radius[1] * np.sin(angle), 0.0])


def _rendered(
    light_field: LightField, depths: ViewDepths, place: FloatArray, counts: NDArray[np.floating]
) -> RenderedPicture:
    known = np.where(depths.sure & (light_field.weights > 0), depths.nearness, np.float32(np.nan))
    nearness = nearness_from(light_field, known, place)
    apart = np.float32(AGREE_PX / px_per_nearness(light_field))
    height, width, channels = *nearness.shape, light_field.samples.shape[-1]
    total, weights = np.zeros((height, width, channels + 1), np.float32), np.zeros((height, width), np.float32)
    own = [tuple(each) for each in np.argwhere((light_field.positions_mm == place).all(axis=-1))]
    guide = _softened(premultiplied(light_field, own[0])) if own else None
    for index in np.ndindex(light_field.rows, light_field.cols):
        u, v = sources(light_field, place, index, nearness)
        shown: Any = cv2.remap(premultiplied(light_field, index), u, v, cv2.INTER_LINEAR)
        theirs = at(known[index], u, v)
        trust = np.where(np.abs(theirs - nearness) <= apart, 1.0, np.where(np.isnan(theirs), UNKNOWN, OTHER))
        if index in own:
            trust[...] = 1.0  # From a view's own place, it shows what is to be seen, however deep that is.
        elif guide is not None:
            trust *= _alike(_softened(shown), guide)
        shown *= trust[..., None].astype(np.float32)
        weights += shown[..., -1]
        total += shown * np.float32(counts[index] / counts.max())
    weights[total[..., -1] < LEAST] = 0.0
    part = np.divide(1.0, total[..., -1:], out=np.zeros_like(total[..., -1:]), where=weights[..., None] > 0)
    return RenderedPicture(total[..., :-1] * part, weights)


def _softened(shown: Float32) -> Float32:
    return np.asarray(cv2.blur(shown, (ALIKE_PX, ALIKE_PX)), dtype=np.float32)


def _alike(shown: Float32, guide: Float32) -> Float32:
    """Likelihood (v, u) that two softened pictures (v, u, c + 1), weighted, show the same; 1 where one has nothing."""
    weight, guiding = shown[..., -1:], guide[..., -1:]
    both = (weight[..., 0] > 0.5) & (guiding[..., 0] > 0.5)
    apart = shown[..., :-1] / np.maximum(weight, 0.5) - guide[..., :-1] / np.maximum(guiding, 0.5)
    likely = np.maximum(np.exp(-np.square(apart).mean(axis=-1) / (2.0 * ALIKE**2)), OTHER)
    return np.where(both, likely, np.float32(1.0)).astype(np.float32)
