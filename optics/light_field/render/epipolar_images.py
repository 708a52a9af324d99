"""Epipolar-plane images: one line of all views, stacked; its slopes give depth (Bolles et al., IJCV 1987)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.light_field import Axis, LightField, Views
from mirrorcam.optics.light_field.render.refocusing import Float32, FocalPlane, homography, premultiplied


@dataclass(frozen=True, eq=False)
class Epi:
    """An epipolar-plane image of a row of views (along s), or of a column (along t).

    Attributes
    ----------
    samples
        Samples (n, length, c), float32, 0 to 1: one line of each of n views; along s left to right, t top to bottom.
    weights
        Weights (n, length), float32, 0 without a sample.
    positions_mm
        True positions (n,) of the views along the axis, possibly uneven.
    axis
        Axis of the views; lines run along u for s, along v for t.
    line
        Row (for s) or column (for t) of the reference view.
    plane_depth_mm
        Depth of the plane that stays fixed from view to view.
    """

    samples: Float32
    weights: Float32
    positions_mm: FloatArray
    axis: Axis
    line: int
    plane_depth_mm: float

    def slope_px_per_mm(self, views: Views, depth_mm: float) -> float:
        """Return the slope of the EPI at a depth: px that a point moves along the line per mm of view position."""
        return float(views.slope_from_depth(depth_mm) - views.slope_from_depth(self.plane_depth_mm))


def epi(light_field: LightField, axis: Axis, line: int, *, depth_mm: float | None = None) -> Epi:
    """Extract the epipolar-plane image of the reference view's row (`axis` s) or column (t) of views.

    Parameters
    ----------
    light_field
        Two or more views along the axis.
    axis
        s: views in a row; t: views in a column.
    line
        Row (s) or column (t) of the reference view's picture.
    depth_mm
        Depth of the points that trace vertical lines in the image; by default the reference depth. If the views are not
        exactly in a row, points at other depths are slightly off the line.

    Returns
    -------
    Epi
        Samples (n, length, c) and weights (n, length) of the n views, and their positions in mm.

    Raises
    ------
    InputError
        For a line outside the picture, fewer than two views along the axis, views that do not form a grid, or a
        depth that is not in front of all views.
    """
    light_field.require_grid("an epipolar-plane image")
    lines, count = (
        (light_field.height_px, light_field.cols) if axis == "s" else (light_field.width_px, light_field.rows)
    )
    if not 0 <= line < lines:
        raise InputError(f"line is {line} along {axis}, expected 0 to {lines - 1}")
    if count < 2:
        raise InputError(f"only one view along {axis}, expected two or more for an epipolar-plane image")
    depth_mm = light_field.reference_depth_mm if depth_mm is None else float(depth_mm)
    plane = FocalPlane.at_depth(light_field, depth_mm)
    t, s = reference_index(light_field)
    indices = [(t, column) for column in range(count)] if axis == "s" else [(row, s) for row in range(count)]
    reference_from_line = np.eye(3)
    if axis == "s":
        reference_from_line[1, 2] = line
        size = light_field.width_px, 1
    else:
        reference_from_line[0, 2] = line
        size = 1, light_field.height_px
    parts = []
    for index in indices:
        matrix = homography(light_field, index, plane) @ reference_from_line
        part = cv2.warpPerspective(
            premultiplied(light_field, index), matrix, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        parts.append(np.asarray(part, dtype=np.float32).reshape(max(size), -1))
    stacked = np.stack(parts)
    weights = stacked[..., -1]
    samples = np.divide(
        stacked[..., :-1], weights[..., None], out=np.zeros_like(stacked[..., :-1]), where=weights[..., None] > 0
    )
    positions = [light_field.positions_mm[index][0 if axis == "s" else 1] for index in indices]
    return Epi(samples, weights, np.array(positions), axis, line, depth_mm)
