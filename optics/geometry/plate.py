"""Refraction in the plane-parallel plate of a second-surface mirror, and the plain mirror that it looks like.

Tangents are those of angles to the plate's normal, in air unless stated otherwise. Snell's law: sin = n sin'.
"""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray

NEWTON_STEPS = 50


def inner_tangent(tangent: FloatArray, refractive_index: FloatArray | float) -> FloatArray:
    """Tangents (...) in the plate of rays whose tangents in air are given."""
    squared = np.square(tangent)
    return np.asarray(tangent / np.sqrt(refractive_index**2 * (1.0 + squared) - squared))


def outer_tangent(
    across_mm: FloatArray | float,
    air_mm: FloatArray | float,
    glass_mm: FloatArray | float,
    refractive_index: FloatArray | float,
) -> FloatArray:
    """Tangents (...) in air of rays that cover `across_mm` sideways in `air_mm` > 0 and then `glass_mm` of a plate.

    Newton's method on air tan + glass tan' = across: the left side is concave and increasing, so that steps from below
    the root never overshoot it.
    """
    across, air = np.broadcast_arrays(np.asarray(across_mm, dtype=np.float64), air_mm)
    tangent = across / (air + glass_mm)
    # d tan' / d tan = n^2 (tan' / tan)^3, which is 1 / n at normal incidence.
    upright = np.full_like(tangent, 1.0 / refractive_index)
    for _ in range(NEWTON_STEPS):
        inner = inner_tangent(tangent, refractive_index)
        bend = np.divide(inner, tangent, out=upright.copy(), where=tangent > 0)
        step = (across - air * tangent - glass_mm * inner) / (air + glass_mm * refractive_index**2 * bend**3)
        tangent = tangent + step
        if (np.abs(step) <= 1e-15 * (1.0 + tangent)).all():
            break
    return np.asarray(tangent)


def rise_mm(tangent: FloatArray, thickness_mm: float, refractive_index: float) -> FloatArray:
    """Height (...) over the reflecting surface at which the plate looks like a plain mirror: t (1 - tan' / tan).

    The incoming and the outgoing ray, extended, meet there, right above their point of reflection.
    """
    tangent = np.asarray(tangent, dtype=np.float64)
    straight = np.full_like(tangent, 1.0 / refractive_index)
    ratio = np.divide(inner_tangent(tangent, refractive_index), tangent, out=straight, where=tangent > 1e-12)
    return thickness_mm * (1.0 - ratio)


def surface_reflectance(tangent: FloatArray, refractive_index: float) -> FloatArray:
    """Fraction (...) of unpolarised light that the plate's uncoated front reflects (Fresnel's equations)."""
    tangent = np.asarray(tangent, dtype=np.float64)
    cosine = 1.0 / np.sqrt(1.0 + tangent**2)
    inner_cosine = np.sqrt(1.0 - (1.0 - cosine**2) / refractive_index**2)
    across = (cosine - refractive_index * inner_cosine) / (cosine + refractive_index * inner_cosine)
    parallel = (inner_cosine - refractive_index * cosine) / (inner_cosine + refractive_index * cosine)
    return 0.5 * (across**2 + parallel**2)
