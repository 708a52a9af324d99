"""Chief rays of a lens whose pupil walks along the axis with the field angle.

The chief ray with the normalized coordinates n = (x, y) leaves the pupil at (0, 0, w q), q = x^2 + y^2, and passes
through the point (f x, f y, f) in focus, f mm along the axis: the lens model holds there. A point P at depth z
therefore has n = (P_x, P_y) / s, where s(q, z) = f (z - w q) / (f - w q) and q solves q s^2 = P_x^2 + P_y^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.core.values import FloatArray

STEPS = 8
"""Limit of Newton's method; three reach rounding for any real lens."""


@dataclass(frozen=True)
class SeenAlong:
    """Normalized coordinates (2, n) of points, and their derivatives by the points (2, 3, n) and by the walk (2, n)."""

    normalized: FloatArray
    by_point: FloatArray
    by_walk: FloatArray


def seen_along(points_mm: FloatArray, walk_mm: float, focus_mm: float) -> SeenAlong:
    """Normalized coordinates of the chief rays through points.

    Parameters
    ----------
    points_mm
        Points (3, n) in the camera's frame; NaN results for those that are not in front of the pupil.
    walk_mm
        Displacement w of the pupil towards the scene per unit of x^2 + y^2.
    focus_mm
        Distance in focus along the axis.
    """
    across, z = points_mm[:2], points_mm[2]
    squared = np.square(across).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        q = squared / np.where(z > 0.0, z, np.nan) ** 2
        for _ in range(STEPS):
            s, by_q, _, _ = _scale(q, z, walk_mm, focus_mm)
            step = (q * s * s - squared) / (s * (s + 2.0 * q * by_q))
            q = q - step
            if np.nanmax(np.abs(step), initial=0.0) < 1e-16:
                break
        s, by_q, by_z, by_walk = _scale(q, z, walk_mm, focus_mm)
        normalized = across / np.where(s > 0.0, s, np.nan)
        # q s^2 = |P|^2 gives dq; n = P / s gives dn = dP / s - n ds / s.
        slope = s * (s + 2.0 * q * by_q)
        ds = np.stack([*(2.0 * by_q * across / slope), by_z * (1.0 - 2.0 * q * s * by_q / slope)])
        by_point = -normalized[:, None] * ds / s
        by_point[0, 0] += 1.0 / s
        by_point[1, 1] += 1.0 / s
        return SeenAlong(normalized, by_point, -normalized * by_walk * (1.0 - 2.0 * q * s * by_q / slope) / s)


def _scale(
    q: FloatArray, z: FloatArray, walk_mm: float, focus_mm: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The scale s (n,) with its derivatives by q, by z and by the walk."""
    rest = focus_mm - walk_mm * q
    s = focus_mm * (z - walk_mm * q) / rest
    along = focus_mm * (z - focus_mm) / rest**2
    return s, along * walk_mm, focus_mm / rest, along * q
