"""Refraction in the plane-parallel plate of a flat second-surface mirror, and images of points in it, with derivatives.

Angles are measured from the plate's normal; `tan` is the tangent in air, tan' the tangent in glass. Snell's law:
sin = n sin'.

Unfolded at the reflecting surface, light from the pupil to a point crosses a height A of air and 2 t of glass over a
lateral distance l: A tan + 2 t tan' = l, tan' = g tan. With s = tan / l this is s (A + 2 t g) = 1, which is smooth at
l = 0. Arrays are as in `mirror_arrays`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror_arrays import ImageDerivatives, MirrorArrays, dot, plane_of, plane_vjp

NEWTON_STEPS = 50


def tangent_in_glass(tangent: FloatArray, refractive_index: FloatArray | float) -> FloatArray:
    """Tangents (...) in the plate for rays with given tangents (...) in air."""
    squared = np.square(tangent)
    return np.asarray(tangent / np.sqrt(refractive_index**2 * (1.0 + squared) - squared))


def solve_tangent_in_air(
    lateral_mm: FloatArray | float,
    air_mm: FloatArray | float,
    glass_mm: FloatArray | float,
    refractive_index: FloatArray | float,
) -> FloatArray:
    """Tangents (...) in air of rays with the lateral offset `lateral_mm` after `air_mm` > 0 and `glass_mm` of a plate.

    Newton's method for air tan + glass tan' = lateral. The left side is concave and increasing, so steps from below the
    root never overshoot.
    """
    lateral, air = np.broadcast_arrays(np.asarray(lateral_mm, dtype=np.float64), air_mm)
    tangent = lateral / (air + glass_mm)
    # d tan' / d tan = n^2 (tan' / tan)^3, which is 1 / n at normal incidence.
    at_normal = np.full_like(tangent, 1.0 / refractive_index)
    for _ in range(NEWTON_STEPS):
        in_glass = tangent_in_glass(tangent, refractive_index)
        ratio = np.divide(in_glass, tangent, out=at_normal.copy(), where=tangent > 0)
        step = (lateral - air * tangent - glass_mm * in_glass) / (air + glass_mm * refractive_index**2 * ratio**3)
        tangent = tangent + step
        if (np.abs(step) <= 1e-15 * (1.0 + tangent)).all():
            break
    return np.asarray(tangent)


def rise_mm(tangent: FloatArray, thickness_mm: float, refractive_index: float) -> FloatArray:
    """Height (...) of the equivalent first-surface mirror above the reflecting surface: t (1 - tan' / tan).

    The extended incoming and outgoing rays meet there, directly above the point of reflection.
    """
    tangent = np.asarray(tangent, dtype=np.float64)
    at_normal = np.full_like(tangent, 1.0 / refractive_index)
    ratio = np.divide(tangent_in_glass(tangent, refractive_index), tangent, out=at_normal, where=tangent > 1e-12)
    return thickness_mm * (1.0 - ratio)


def surface_reflectance(tangent: FloatArray, refractive_index: float) -> FloatArray:
    """Fraction (...) of unpolarised light that the plate's uncoated front reflects (Fresnel's equations)."""
    tangent = np.asarray(tangent, dtype=np.float64)
    cosine = 1.0 / np.sqrt(1.0 + tangent**2)
    inner_cosine = np.sqrt(1.0 - (1.0 - cosine**2) / refractive_index**2)
    perpendicular = (cosine - refractive_index * inner_cosine) / (cosine + refractive_index * inner_cosine)
    parallel = (inner_cosine - refractive_index * cosine) / (inner_cosine + refractive_index * cosine)
    return 0.5 * (perpendicular**2 + parallel**2)


@dataclass(frozen=True)
class PlaneDerivatives:
    """Derivatives of k functions with respect to point and normal (k, 3, n), distance and thickness (k, n)."""

    point: FloatArray
    normal: FloatArray
    distance: FloatArray
    thickness: FloatArray


@dataclass(frozen=True)
class _Partials:
    """Partial derivatives (k, n) of functions with respect to the variables of a light path."""

    s: FloatArray
    air: FloatArray | float = 0.0
    squared: FloatArray | float = 0.0
    distance: FloatArray | float = 0.0
    thickness: FloatArray | float = 0.0


@dataclass(frozen=True)
class PlatePath:
    """Light paths from the pupil to points via plane reflecting surfaces behind plates.

    Attributes
    ----------
    point_mm
        The points (3, n).
    normal
        Unit normals (3, n) of the planes, towards the pupil.
    distance_mm
        Distances (n,) of the planes from the pupil.
    thickness_mm
        Thicknesses (n,) of the plates.
    height_mm
        Heights (n,) of the points along the normal, from the pupil.
    in_plane_mm
        Components (3, n) of the points in the plane, with the square `squared_mm2` (n,) of their length l.
    air_mm
        The length A (n,).
    g
        The ratio tan' / tan (n,).
    s_per_mm
        The ratio tan / l (n,).
    alpha_per_mm
        The term 2 t s^2 dg / d(tan^2) (n,).
    divisor_mm
        The sum A + 2 t g + 2 alpha l^2 (n,), the divisor D in the derivatives of s.
    """

    point_mm: FloatArray
    normal: FloatArray
    distance_mm: FloatArray
    thickness_mm: FloatArray
    height_mm: FloatArray
    in_plane_mm: FloatArray
    air_mm: FloatArray
    g: FloatArray
    s_per_mm: FloatArray
    alpha_per_mm: FloatArray
    divisor_mm: FloatArray

    @classmethod
    def trace(cls, point_mm: FloatArray, plane: tuple[FloatArray, FloatArray], mirrors: MirrorArrays) -> PlatePath:
        """The paths to points (3, n) via planes (normal, distance) behind the plates of mirrors."""
        t, n, (normal, distance) = mirrors.thickness_mm, mirrors.refractive_index, plane
        height = dot(point_mm, normal)
        in_plane = point_mm - height * normal
        air = np.where(height + distance - t > 0.0, height + 2.0 * (distance - t), np.nan)
        squared = dot(in_plane, in_plane)
        if np.any(t > 0.0):
            tangent = solve_tangent_in_air(np.sqrt(squared), air, 2.0 * t, n)
            g = 1.0 / np.sqrt(n**2 + (n**2 - 1.0) * np.square(tangent))
            s = 1.0 / (air + 2.0 * t * g)
            # dg / d(tan^2) = -(n^2 - 1) g^3 / 2
            alpha = -t * (n**2 - 1.0) * g**3 * s**2
        else:
            g, s, alpha = np.ones_like(air), 1.0 / air, np.zeros_like(air)
        divisor = 1.0 / s + 2.0 * alpha * squared
        return cls(point_mm, normal, distance, t, height, in_plane, air, g, s, alpha, divisor)

    @property
    def plane(self) -> tuple[FloatArray, FloatArray]:
        """Normal and distance of the planes."""
        return self.normal, self.distance_mm

    def image_mm(self) -> FloatArray:
        """Images (3, n), at the height -A along the normal from the pupil."""
        return np.asarray(self.air_mm * (self.s_per_mm * self.in_plane_mm - self.normal))

    def _effective_height_mm(self) -> FloatArray:
        """Lateral distance from the pupil to the reflection, divided by the tangent in air: air plus glass times g."""
        return self.distance_mm - self.thickness_mm + self.thickness_mm * self.g

    def reflection_point_mm(self) -> FloatArray:
        """Points (3, n) where the light meets the reflecting surface."""
        return np.asarray(
            self.s_per_mm * self._effective_height_mm() * self.in_plane_mm - self.distance_mm * self.normal
        )

    def image_vjp(self, d_image: FloatArray) -> PlaneDerivatives:
        """Pull derivatives (k, 3, n) with respect to the image back to the inputs."""
        d_stretch, normal_part = dot(d_image, self.in_plane_mm), dot(d_image, self.normal)
        partials = _Partials(s=self.air_mm * d_stretch, air=self.s_per_mm * d_stretch - normal_part)
        return self._chain_rule((d_image, normal_part), (self.air_mm * self.s_per_mm, self.air_mm), partials)

    def reflection_point_vjp(self, d_point: FloatArray) -> PlaneDerivatives:
        """Pull derivatives (k, 3, n) with respect to the point of reflection back to the inputs."""
        normal_part, d_stretch = dot(d_point, self.normal), dot(d_point, self.in_plane_mm)
        height = self._effective_height_mm()
        partials = _Partials(
            s=d_stretch * (height + self.alpha_per_mm * dot(self.in_plane_mm, self.in_plane_mm)),
            squared=d_stretch * self.alpha_per_mm * self.s_per_mm / 2.0,
            distance=d_stretch * self.s_per_mm - normal_part,
            thickness=-d_stretch * self.s_per_mm * (1.0 - self.g),
        )
        return self._chain_rule((d_point, normal_part), (self.s_per_mm * height, self.distance_mm), partials)

    def _chain_rule(
        self, by_point: tuple[FloatArray, FloatArray], coefficients: tuple[FloatArray, FloatArray], partials: _Partials
    ) -> PlaneDerivatives:
        """Apply the chain rule to functions of the point stretch * in_plane - depth * normal.

        `by_point` are their derivatives (k, 3, n) with respect to it and the components of these along the normal
        (k, n), `coefficients` are (stretch, depth). From s (A + 2 t g) = 1 follows
        ds = -(s / D) (dA + 2 g dt + alpha d(l^2)) with alpha = 2 t g' s^2, g' = dg / d(tan^2) and
        D = A + 2 t g + 2 alpha l^2.
        """
        (d_point, normal_part), (stretch, depth) = by_point, coefficients
        via_s = -self.s_per_mm / self.divisor_mm * partials.s
        air = partials.air + via_s
        squared = partials.squared + self.alpha_per_mm * via_s
        height = air - stretch * normal_part - 2.0 * self.height_mm * squared
        return PlaneDerivatives(
            point=stretch * d_point + 2.0 * squared[:, None] * self.point_mm + height[:, None] * self.normal,
            normal=height[:, None] * self.point_mm - (stretch * self.height_mm + depth) * d_point,
            distance=partials.distance + 2.0 * air,
            thickness=partials.thickness - 2.0 * air + 2.0 * self.g * via_s,
        )


@dataclass(frozen=True)
class PlateImages:
    """Images (3, n) in flat mirrors behind plates."""

    image_mm: FloatArray
    _path: PlatePath

    @classmethod
    def of(cls, points_mm: FloatArray, mirrors: MirrorArrays) -> PlateImages:
        path = PlatePath.trace(points_mm, plane_of(mirrors.centre_mm), mirrors)
        return cls(path.image_mm(), path)

    def vjp(self, d_image: FloatArray) -> ImageDerivatives:
        """See `MirrorImages.vjp`; derivatives with respect to the curvature are empty (k, 0, n)."""
        d_plane = self._path.image_vjp(d_image)
        centre = plane_vjp(d_plane.normal, d_plane.distance, self._path.plane)
        empty = np.empty((len(d_image), 0, d_image.shape[-1]))
        return ImageDerivatives(d_plane.point, centre, d_plane.thickness, empty)
