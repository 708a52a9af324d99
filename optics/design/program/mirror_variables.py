"""A mirror as unknowns of the nonlinear program: CasADi expressions in view axes, in units of the design scale."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Self

import casadi as ca
import numpy as np

from mirrorcam.optics.design.program.terms import Expression, TermBuilder
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.lenses.families import FIXED_SIZE_FAMILIES, LensName
from mirrorcam.optics.geometry.nearest_lens import nearest_lens

GLASS_AND_PUPIL = 4
"""Number of parameters shared by all mirrors: thickness, refractive index, radius of the pupil, 1 / focus."""


@dataclass(frozen=True)
class Kind:
    """The form of a mirror's expressions."""

    sides: int
    distorted: bool
    second_surface: bool
    pinhole: bool = True
    lens_model: LensName = "brown_conrady"

    @classmethod
    def of(cls, spec: DesignSpec) -> Self:
        """The form for the mirrors of a spec."""
        camera = expressible(spec.camera)
        return cls(
            spec.sides, not camera.is_undistorted, spec.is_second_surface, camera.aperture_mm == 0.0, camera.lens_model
        )

    @property
    def intrinsics(self) -> int:
        """Number of intrinsics."""
        return 4 + len(FIXED_SIZE_FAMILIES[self.lens_model].NAMES)


@dataclass(frozen=True)
class Optics:
    """Shared by all mirrors: rotation to view axes, thickness and refractive index, radius of the pupil, 1 / focus."""

    view_from_rig: Expression
    thickness: Expression
    index: Expression
    radius: Expression
    inverse_focus: Expression

    @classmethod
    def of_term(cls, term: TermBuilder) -> Self:
        """The optics of a term, whose first unknown is the fold angle in radians; they are its first parameters."""
        fold, numbers = term.unknown(1), term.parameter(GLASS_AND_PUPIL)
        return cls(view_from_rig(fold), *(numbers[k] for k in range(GLASS_AND_PUPIL)))

    @property
    def in_rig(self) -> Self:
        """The optics for mirrors in the rig frame instead of view axes."""
        return replace(self, view_from_rig=ca.SX.eye(3))

    def in_pupil_plane(self, vector: Expression) -> Expression:
        """Length of the component of a vector (3) in the plane of the pupil."""
        x_axis, y_axis = (self.view_from_rig[:, axis] for axis in range(2))
        return ca.sqrt(ca.dot(x_axis, vector) ** 2 + ca.dot(y_axis, vector) ** 2 + 1e-12)


@dataclass(frozen=True)
class MirrorVariables:
    """Expressions of one mirror; for a second-surface mirror, of its *apparent* mirror (see `Mirror.apparent`).

    Attributes
    ----------
    centre
        Virtual centre (3).
    corners
        Corners (2) of its sub-image, in normalized coordinates.
    face
        Corners (3) of its face.
    normal
        Unit normal (3) of the face, away from the pupil.
    glass_in_front
        Extent of the solid from the face towards the pupil.
    glass_behind
        Extent of the solid from the face away from the pupil.
    entry
        Offset (3) along the face between where light meets the front and where it meets the reflecting surface.
    """

    centre: Expression
    corners: list[Expression]
    face: list[Expression]
    normal: Expression
    glass_in_front: Expression
    glass_behind: Expression
    entry: Expression

    def tilted_centre(self, tilt: Expression) -> Expression:
        """Virtual centre (3) after a tilt about the centroid, by small angles (2) about the mirror's x and y axis."""
        centroid = sum(self.face[1:], start=self.face[0]) / len(self.face)
        x_axis = ca.vertcat(1.0, 0.0, 0.0) - self.normal[0] * self.normal
        x_axis /= ca.sqrt(ca.sumsqr(x_axis))
        normal = self.normal + tilt[0] * x_axis + tilt[1] * ca.cross(self.normal, x_axis)
        return 2.0 * ca.dot(normal, centroid) / ca.sumsqr(normal) * normal

    @property
    def solid(self) -> list[Expression]:
        """All corners (3) of the solid, first of its front, then of its back."""
        return [
            point + self.normal * shift for shift in (-self.glass_in_front, self.glass_behind) for point in self.face
        ]


@lru_cache
def expressible(camera: Camera) -> Camera:
    """The camera with a closed-form lens: a spline lens is replaced by the nearest thin-prism lens.

    The sensor shrinks by the largest error, so that its pixels also lie on the camera's own sensor.
    """
    if camera.lens_model != "spline":
        return camera
    nearest, error_px = nearest_lens(camera, "thin_prism")
    margin = int(np.ceil(error_px))
    return nearest.replaced(
        width_px=nearest.width_px - 2 * margin,
        height_px=nearest.height_px - 2 * margin,
        cx_px=nearest.cx_px - margin,
        cy_px=nearest.cy_px - margin,
    )


def cross_2d(a: Expression, b: Expression) -> Expression:
    """The 2-D cross product."""
    return a[0] * b[1] - a[1] * b[0]


def reflected(point: Expression, centre: Expression) -> Expression:
    """A point (3) reflected at the plane of a virtual centre (3)."""
    return point - 2.0 * (ca.dot(point, centre) / ca.sumsqr(centre) - 0.5) * centre


def edges_of(vertices: list[Expression]) -> list[tuple[Expression, Expression]]:
    """Both ends of each edge of a polygon."""
    return list(pairwise([*vertices, vertices[0]]))


def polygon_area(vertices: list[Expression]) -> Expression:
    """Signed area of a polygon (shoelace), positive when it runs from +x to +y."""
    return 0.5 * sum(cross_2d(a, b) for a, b in edges_of(vertices))


def subdivided(vertices: list[Expression], per_edge: int) -> list[Expression]:
    """The outline of a polygon with `per_edge` points on each edge, including its first vertex."""
    return [a + (b - a) * (step / per_edge) for a, b in edges_of(vertices) for step in range(per_edge)]


def pixels(lens_model: LensName, intrinsics: Expression, normalized: Expression) -> Expression:
    """Apply a lens model with intrinsics (k); see `Camera.pixels_from_normalized`."""
    names = FIXED_SIZE_FAMILIES[lens_model].NAMES
    fx, fy, cx, cy, *distortion = (intrinsics[k] for k in range(4 + len(names)))
    x, y = normalized[0], normalized[1]
    if lens_model == "fisheye":
        r = ca.sqrt(x * x + y * y + 1e-30)
        angle = ca.atan(r)
        factor = angle / r * (1.0 + sum(k * angle ** (2 * n) for n, k in enumerate(distortion, 1)))
        xd, yd = x * factor, y * factor
    else:
        family: Any = FIXED_SIZE_FAMILIES[lens_model]  # polynomials also work on expressions
        xd, yd = family(distortion).distorted(x, y)
    return ca.vertcat(fx * xd + cx, fy * yd + cy)


def view_from_rig(fold: Expression) -> Expression:
    """The rotation (3, 3) from the rig frame to view axes for a fold angle in radians."""
    cosine, sine = ca.cos(fold), ca.sin(fold)
    return ca.blockcat([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def mirror_of(kind: Kind, optics: Optics, centre: Expression, corners: Expression) -> MirrorVariables:
    """The mirror with a virtual centre (3) and corners (2 sides).

    The apparent plane of a second-surface mirror lies t (1 - tan' / tan) in front of the reflecting surface, and light
    meets the front at an offset of t tan', both by Snell's law for the chief ray (see `optics.geometry.plate`).
    """
    thickness, index = optics.thickness, optics.index
    polygon = [corners[2 * k : 2 * k + 2] for k in range(kind.sides)]
    rays = [optics.view_from_rig @ ca.vertcat(corner, 1.0) for corner in polygon]
    squared = ca.sumsqr(centre)
    face = [ray * (0.5 * squared / ca.dot(ray, centre)) for ray in rays]
    normal = centre / ca.sqrt(squared)
    glass_in_front, glass_behind, entry = ca.SX(0.0), thickness, ca.SX.zeros(3)
    if kind.second_surface:
        chief: Expression = sum(face[1:], start=face[0])
        chief /= ca.sqrt(ca.sumsqr(chief))
        cosine = ca.dot(chief, normal)
        # n cos'; then tan' / tan = cos / (n cos') and tan' = sin / (n cos'), also at normal incidence.
        inner = ca.sqrt(index**2 - 1.0 + cosine**2)
        glass_behind = thickness * (1.0 - cosine / inner)
        glass_in_front, entry = thickness - glass_behind, thickness / inner * (chief - cosine * normal)
    return MirrorVariables(centre, polygon, face, normal, glass_in_front, glass_behind, entry)


def add_mirror(kind: Kind, optics: Optics, term: TermBuilder) -> MirrorVariables:
    """Add the unknowns of a mirror to a term: virtual centre (3) and corners (2 sides)."""
    centre = term.unknown(3)
    return mirror_of(kind, optics, centre, term.unknown(2 * kind.sides))
