"""Light in a plane-parallel slab that is coated behind: where it bends, and the plain mirror that it looks like.

Tangents are those of angles to the slab's normal, outside unless said otherwise. Snell's law: sin = n sin'.
"""

from __future__ import annotations

import numpy as np

from optics.values import FloatArray

NEWTON_STEPS = 50


def inner_tangent(tangent: FloatArray, refractive_index: float) -> FloatArray:
    """Tangent inside the slab of rays (...) that meet it with `tangent` outside."""
    squared = np.square(tangent)
    return tangent / np.sqrt(refractive_index**2 * (1.0 + squared) - squared)


def outer_tangent(across_mm: float, air_mm: float, glass_mm: float, refractive_index: float) -> float:
    """Tangent outside of the ray that goes `across_mm` while it passes `air_mm` > 0 and then `glass_mm` of a slab.

    Newton's method on air tan + glass tan' = across: the left side is concave and grows, so that steps from below the
    root never overshoot it.
    """
    tangent = across_mm / (air_mm + glass_mm)
    for _ in range(NEWTON_STEPS):
        inner = float(inner_tangent(np.array(tangent), refractive_index))
        # d tan' / d tan = n^2 (tan' / tan)^3, which is 1 / n at normal incidence.
        bend = inner / tangent if tangent > 0 else 1.0 / refractive_index
        step = (across_mm - air_mm * tangent - glass_mm * inner) / (air_mm + glass_mm * refractive_index**2 * bend**3)
        tangent += step
        if abs(step) <= 1e-15 * (1.0 + tangent):
            break
    return tangent


def rise_mm(tangent: FloatArray, thickness_mm: float, refractive_index: float) -> FloatArray:
    """How far above its coating the slab looks like a plain mirror to rays (...): t (1 - tan' / tan).

    The incoming and the outgoing ray, made longer, meet there, right above the point of the coating that they meet.
    """
    tangent = np.asarray(tangent, dtype=np.float64)
    straight = np.full_like(tangent, 1.0 / refractive_index)
    ratio = np.divide(inner_tangent(tangent, refractive_index), tangent, out=straight, where=tangent > 1e-12)
    return thickness_mm * (1.0 - ratio)


def surface_reflectance(tangent: FloatArray, refractive_index: float) -> FloatArray:
    """Part (...) of unpolarised light that the slab's bare front reflects (Fresnel)."""
    tangent = np.asarray(tangent, dtype=np.float64)
    cosine = 1.0 / np.sqrt(1.0 + tangent**2)
    inner_cosine = np.sqrt(1.0 - (1.0 - cosine**2) / refractive_index**2)
    across = (cosine - refractive_index * inner_cosine) / (cosine + refractive_index * inner_cosine)
    parallel = (inner_cosine - refractive_index * cosine) / (inner_cosine + refractive_index * cosine)
    return 0.5 * (across**2 + parallel**2)
