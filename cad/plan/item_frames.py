"""Frames of bought items, and the moves by which they leave their seats."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

ACROSS = np.array([1.0, 0.0, 0.0])
# What has left a part is this far from it: half a nut, and as much as shows.
CLEAR_MM = 12.0


def along(origin: FloatArray, z_axis: FloatArray, across: FloatArray = ACROSS) -> FloatArray:
    """A frame (4, 4) at a point (3,) with z along a direction (3,) and x as near to another (3,) as it can be."""
    x_axis = across - (z_axis @ across) * z_axis
    x_axis = x_axis / np.linalg.norm(x_axis)
    return rigid(np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis]), origin)


def beyond(corners: FloatArray, place: FloatArray, way: FloatArray) -> FloatArray:
    """The move (3,) along a unit vector (3,) by which a place (3,) leaves the hull of corners (n, 3)."""
    return float(((corners - place) @ way).max() + CLEAR_MM) * way
