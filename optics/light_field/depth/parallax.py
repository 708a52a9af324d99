"""Positions in the other views of the points that the reference view sees, as a function of inverse distance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import Views

Float32 = NDArray[np.float32]
MAX_PLANES = 2048


@dataclass(frozen=True)
class Parallax:
    """Position of a reference pixel (u, v) in the view at (x, y, z), as a function of the inverse distance q = 1 / Z.

    By the pinholes of `Views`, with e = 1 / (1 - z q) and g = 1 - z / Z0:
    u' = g e (u - cx) - f g x q e + cx + f x / Z0, and likewise for v with y.
    """

    focal_px: float
    centre_px: tuple[float, float]
    position_mm: tuple[float, float, float]
    reference_distance_mm: float

    def affine(self, inverse_distance: float) -> FloatArray:
        """Return the matrix (2, 3) from reference pixels to this view's pixels, for a plane normal to the view axis."""
        x, y, z = self.position_mm
        scale = (1.0 - z / self.reference_distance_mm) / (1.0 - z * inverse_distance)
        shift = self.focal_px * (1.0 / self.reference_distance_mm - scale * inverse_distance)
        (cx, cy) = self.centre_px
        return np.array([[scale, 0.0, (1.0 - scale) * cx + shift * x], [0.0, scale, (1.0 - scale) * cy + shift * y]])

    def pixels(self, columns: Float32, rows: Float32, inverse_distance: Float32) -> tuple[Float32, Float32]:
        """Return the pixels (u', v') in this view, each (v, u), of reference pixels at inverse distances (v, u)."""
        x, y, z = (np.float32(length) for length in self.position_mm)
        (cx, cy), focal = self.centre_px, np.float32(self.focal_px)
        front = np.float32(1.0 - self.position_mm[2] / self.reference_distance_mm)
        scale = front / (np.float32(1.0) - z * inverse_distance)
        shift = focal * (np.float32(1.0 / self.reference_distance_mm) - scale * inverse_distance)
        u = scale * (columns - np.float32(cx)) + (shift * x + np.float32(cx))
        v = scale * (rows - np.float32(cy)) + (shift * y + np.float32(cy))
        return u, v

    def derivatives(self, columns: Float32, rows: Float32, inverse_distance: Float32) -> tuple[Float32, Float32]:
        """Return the derivatives (v, u) of `pixels` with respect to inverse distance, px mm.

        They are g e^2 (z (u - cx) - f x), and likewise for v with y.
        """
        x, y, z = (np.float32(length) for length in self.position_mm)
        (cx, cy), focal = self.centre_px, np.float32(self.focal_px)
        front = np.float32(1.0 - self.position_mm[2] / self.reference_distance_mm)
        rate = front / np.square(np.float32(1.0) - z * inverse_distance)
        return rate * (z * (columns - np.float32(cx)) - focal * x), rate * (z * (rows - np.float32(cy)) - focal * y)


def reference_index(views: Views) -> tuple[int, int]:
    """Row and column of the reference view: the one at the origin of the view frame."""
    t, s = np.unravel_index(int(np.linalg.norm(views.positions_mm, axis=-1).argmin()), (views.rows, views.cols))
    return int(t), int(s)


def other_views(views: Views) -> list[tuple[int, int]]:
    """Row and column of every view but the reference view."""
    reference = reference_index(views)
    return [index for index in np.ndindex(views.rows, views.cols) if index != reference]


def parallax(views: Views, index: tuple[int, int]) -> Parallax:
    """Return the parallax of the reference view's pixels in view `index` = (t, s)."""
    x, y, z = views.positions_mm[index].tolist()
    cx, cy = views.centre_px.tolist()
    return Parallax(views.focal_px, (cx, cy), (x, y, z), views.reference_distance_mm)


def halved(views: Views) -> Views:
    """Return the views with blocks of two by two pixels merged; an odd last column or row is dropped."""
    return replace(
        views,
        focal_px=views.focal_px / 2.0,
        centre_px=(views.centre_px - 0.5) / 2.0,
        width_px=views.width_px // 2,
        height_px=views.height_px // 2,
    )


def plane_inverse_distances(views: Views, near_mm: float, far_mm: float, step_px: float) -> FloatArray:
    """Return inverse distances (n,), in 1/mm, of planes from depth `far_mm` to `near_mm`, far first.

    They are evenly spaced, hence also in disparity, by at most `step_px` at the longest baseline. Raises InputError if
    more than `MAX_PLANES` are needed.
    """
    view_depth_mm = views.reference_view_depth_mm
    low, high = 1.0 / (far_mm - view_depth_mm), 1.0 / (near_mm - view_depth_mm)
    radius_mm = np.abs(views.positions_mm[..., :2]).max()
    count = int(np.ceil(min(views.focal_px * radius_mm * (high - low) / step_px, 1e9))) + 1
    if count > MAX_PLANES:
        raise InputError(
            f"depths {near_mm:g} to {far_mm:g} mm need {count} planes at {step_px:g} px of disparity per plane, "
            f"expected at most {MAX_PLANES}"
        )
    return np.linspace(low, high, max(count, 3))
