"""A card, or a post, before a wall: depths, and pictures from any place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.optics.light_field.render.view_depths import ViewDepths
from tests.optics.light_field.depth.surfaces import Surface, met

WALL = Surface(560.0, slope=(0.2, -0.3), seed=1)


CARD = Surface(400.0, bounds=(-16.0, -22.0, 8.0, 14.0), seed=2, mean=0.65)


SCENE = [WALL, CARD]


POST = Surface(400.0, bounds=(-6.0, -60.0, 4.0, 60.0), seed=2, mean=0.65)


def behind_mm(views: Views) -> float:
    return views.reference_view_depth_mm


def true_depths(views: Views, surfaces: list[Surface]) -> ViewDepths:
    grid = views.pixel_grid()
    distance = np.array([[met(views, (t, s), grid, surfaces)[1] for s in range(views.cols)] for t in range(views.rows)])
    return ViewDepths.of_depths(views, distance + behind_mm(views))


def seen_at(views: Views, place: FloatArray, surfaces: list[Surface]) -> FloatArray:
    """Return the picture of a pinhole at a place, without noise."""
    positions = np.stack([views.positions_mm[1, 1], place])[None]
    pair = replace(views, positions_mm=positions)
    shifts = np.stack(np.meshgrid([-0.25, 0.25], [-0.25, 0.25]), axis=-1).reshape(-1, 2)
    return np.asarray(np.mean([met(pair, (0, 1), views.pixel_grid() + shift, surfaces)[0] for shift in shifts], axis=0))


def inside(shape: tuple[int, ...], margin: int = 8) -> NDArray[np.bool_]:
    where = np.zeros(shape, dtype=bool)
    where[margin:-margin, margin:-margin] = True
    return where
