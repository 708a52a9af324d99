"""Mirrors, each given by its virtual camera centre: the mirror plane bisects the line from the pupil to that point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, ModelWrapValidatorHandler, model_validator
from shapely import LinearRing, Polygon

from mirrorcam.core.bounds import LENGTH_MM, OFFSET_MM, REFRACTIVE_INDEX
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Shaped, Value, Vector3, array_of
from mirrorcam.optics.geometry.mirror_arrays import MirrorArrays, plane_axes
from mirrorcam.optics.geometry.mirror_imaging import images
from mirrorcam.optics.geometry.plate import rise_mm, solve_tangent_in_air, tangent_in_glass
from mirrorcam.optics.geometry.transforms import rigid

ON_PLANE_TOLERANCE_MM = 1e-6
MAX_DISTANCE_TO_RADIUS = 0.1
"""Ratio of distance to radius of curvature up to which the image in a bent mirror is single and nearly flat."""


def reflect(points_in_rig: FloatArray, virtual_centre: FloatArray) -> FloatArray:
    """Reflect points (..., 3) at the plane of a virtual centre c, by x - 2 (x.c / |c|^2 - 1/2) c; broadcasts."""
    squared = np.sum(virtual_centre * virtual_centre, axis=-1, keepdims=True)
    fraction = np.sum(points_in_rig * virtual_centre, axis=-1, keepdims=True) / squared
    return points_in_rig - 2.0 * (fraction - 0.5) * virtual_centre


def intersect_plane(normalized: FloatArray, virtual_centre: FloatArray) -> FloatArray:
    """Points (..., 3) where viewing rays (normalized coordinates (..., 2)) meet the plane of a virtual centre (3,)."""
    rays = np.concatenate([normalized, np.ones((*np.shape(normalized)[:-1], 1))], axis=-1)
    return rays * (0.5 * (virtual_centre @ virtual_centre) / (rays @ virtual_centre))[..., None]


class Mirror(Value):
    """One mirror of a layout, flat or nearly so, in the rig frame (origin at the pupil of the base camera), mm.

    The plane is the *reflecting* surface: the front of a first-surface mirror, the back of a second-surface mirror.
    The camera sees a second-surface mirror through a plane-parallel plate of glass, nearly as it would see the
    first-surface mirror `apparent`. A bent mirror rises from its plane, towards the pupil, by
    (k_xx x^2 + k_yy y^2) / 2 + k_xy x y at (x, y) in its own frame; the plane is tangent to it at the outline's centre.

    Attributes
    ----------
    virtual_centre_in_rig_mm : the pupil reflected at the plane (3,).
    outline_in_rig_mm : corners (n, 3) of the reflecting surface, a convex polygon on the plane.
    surface : the face that reflects, see `is_second_surface`.
    thickness_mm : thickness of the glass.
    refractive_index : refractive index of the glass.
    curvature_per_m : (k_xx, k_yy, k_xy), 1/m.
    """

    virtual_centre_in_rig_mm: Annotated[FloatArray, Shaped((3,), largest=OFFSET_MM.max)]
    outline_in_rig_mm: Annotated[FloatArray, Shaped((None, 3), largest=OFFSET_MM.max)]
    surface: Literal["first", "second"] = "first"
    thickness_mm: float = LENGTH_MM.field(3.0)
    refractive_index: float = REFRACTIVE_INDEX.field(1.52)
    curvature_per_m: Vector3 = Field(
        default_factory=lambda: np.zeros(3), validate_default=True, exclude_if=lambda curvature: not np.any(curvature)
    )

    @model_validator(mode="wrap")
    @classmethod
    def _checked_once(cls, given: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        mirror = handler(given)
        if mirror is not given:  # a layout is given mirrors that are checked
            mirror._check()
        return mirror

    def _check(self) -> None:
        """Raise ValueError unless the outline is a convex polygon in front of the camera, on a nearly flat plane."""
        if self.distance_mm < 1e-3:
            raise ValueError(f"virtual centre {self.virtual_centre_in_rig_mm.tolist()} coincides with the pupil")
        if self.is_second_surface and self.distance_mm <= self.front_mm:
            past_mm = self.front_mm - self.distance_mm
            raise ValueError(
                f"second-surface mirror reaches {past_mm:.3g} mm past the pupil, but must lie in front of it"
            )
        curvature, limit = float(np.abs(self.curvature_per_m).max()), 1e3 * MAX_DISTANCE_TO_RADIUS / self.distance_mm
        if curvature > limit:
            raise ValueError(
                f"curvature_per_m reaches {curvature:.3g}, expected a nearly flat mirror: at most {limit:.3g}"
            )
        outline = self.outline_in_rig_mm
        if len(outline) < 3:
            raise ValueError(f"outline has {len(outline)} corners, expected at least 3")
        off_plane = np.abs(outline @ self.normal_in_rig + self.distance_mm).max()
        if off_plane > ON_PLANE_TOLERANCE_MM:
            raise ValueError(f"outline leaves the mirror plane by {off_plane:.3g} mm, expected all corners on it")
        if (outline[:, 2] <= 0).any():
            raise ValueError("outline has a corner behind the camera, expected z > 0")
        polygon = self.outline_in_plane_mm
        if not LinearRing(polygon).is_simple:
            raise ValueError("outline crosses itself, expected a convex polygon")
        edges = np.roll(polygon, -1, axis=0) - polygon
        following = np.roll(edges, -1, axis=0)
        areas = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
        scale = np.square(edges).sum(axis=1).max()
        if Polygon(polygon).area <= 1e-6 * scale:
            raise ValueError("outline has no area, expected a convex polygon")
        if not (areas > -1e-9 * scale).all() and not (areas < 1e-9 * scale).all():
            raise ValueError("outline is not convex, expected a convex polygon")

    @classmethod
    def from_plane(
        cls,
        point_in_rig_mm: ArrayLike,
        normal_in_rig: ArrayLike,
        *,
        outline_in_plane_mm: ArrayLike | None = None,
        **fields: Any,
    ) -> Self:
        """The mirror on a plane.

        Parameters
        ----------
        point_in_rig_mm
            A point (3,) of the reflecting surface, in the rig frame, mm.
        normal_in_rig
            Normal (3,) of the plane in the rig frame, of any length and sign.
        outline_in_plane_mm
            Corners (n, 2) about the point, mm, as seen from the reflecting side: x along the projection of the rig's x
            on the plane, as in `rig_from_plane`. The alternative is `outline_in_rig_mm` (n, 3), in the rig frame.
        fields
            Other fields of the mirror, such as `surface` and `thickness_mm`.

        Raises
        ------
        InputError
            If the normal is zero, the plane contains the pupil, both outlines are given, or the outline is not a convex
            polygon in front of the camera.
        """
        point, normal = array_of("point_in_rig_mm", point_in_rig_mm, 3), array_of("normal_in_rig", normal_in_rig, 3)
        if not normal.any():
            raise InputError("normal_in_rig: zero, expected a direction")
        normal = normal / np.linalg.norm(normal)
        if outline_in_plane_mm is not None:
            if "outline_in_rig_mm" in fields:
                raise InputError("outline_in_plane_mm and outline_in_rig_mm given, expected one of them")
            outward = normal if normal @ point < 0.0 else -normal
            corners = array_of("outline_in_plane_mm", outline_in_plane_mm, None, 2)
            fields["outline_in_rig_mm"] = point + corners @ np.stack(plane_axes(outward[:, None])).reshape(2, 3)
        return cls(virtual_centre_in_rig_mm=2.0 * (normal @ point) * normal, **fields)

    @classmethod
    def second_surface(
        cls,
        apparent_centre_in_rig_mm: FloatArray,
        apparent_outline_in_rig_mm: FloatArray,
        *,
        thickness_mm: float,
        refractive_index: float,
    ) -> Self:
        """The second-surface mirror whose `apparent` mirror has this virtual centre (3,) and this outline (n, 3)."""
        distance_mm = float(np.linalg.norm(apparent_centre_in_rig_mm)) / 2.0
        normal = -apparent_centre_in_rig_mm / (2.0 * distance_mm)
        offset = apparent_outline_in_rig_mm.mean(axis=0) + distance_mm * normal
        tangent = np.array(np.linalg.norm(offset) / distance_mm)
        rise = float(rise_mm(tangent, thickness_mm, refractive_index))
        return cls(
            virtual_centre_in_rig_mm=apparent_centre_in_rig_mm * (1.0 + rise / distance_mm),
            outline_in_rig_mm=apparent_outline_in_rig_mm - rise * normal,
            surface="second",
            thickness_mm=thickness_mm,
            refractive_index=refractive_index,
        )

    @cached_property
    def _central_ray(self) -> tuple[FloatArray, float]:
        """Vector (3,), mm, from the plane's point nearest to the pupil to the outline's centre; its ray's tangent."""
        offset = self.outline_in_rig_mm.mean(axis=0) + self.distance_mm * self.normal_in_rig
        lateral_mm = float(np.linalg.norm(offset))
        if not self.is_second_surface:
            return offset, lateral_mm / self.distance_mm
        air_mm = self.distance_mm - self.thickness_mm
        return offset, float(solve_tangent_in_air(lateral_mm, air_mm, self.thickness_mm, self.refractive_index))

    @cached_property
    def apparent(self) -> Mirror:
        """The first-surface mirror that reflects the chief ray through the outline's centre as this mirror does.

        A first-surface mirror is its own apparent mirror. For a second-surface mirror, plane and outline move towards
        the pupil by t (1 - tan' / tan), to where the extended incoming and outgoing chief rays meet. Rays at other
        angles of incidence deviate slightly from the apparent mirror's.
        """
        if not self.is_second_surface:
            return self
        rise = float(rise_mm(np.array(self._central_ray[1]), self.thickness_mm, self.refractive_index))
        return Mirror(
            virtual_centre_in_rig_mm=self.virtual_centre_in_rig_mm * (1.0 - rise / self.distance_mm),
            outline_in_rig_mm=self.outline_in_rig_mm + rise * self.normal_in_rig,
            thickness_mm=self.thickness_mm,
            refractive_index=self.refractive_index,
            curvature_per_m=self.curvature_per_m,
        )

    def with_surface(self, surface: Literal["first", "second"], thickness_mm: float | None = None) -> Mirror:
        """The first- or second-surface mirror with the same image along its chief ray; `thickness_mm` None keeps it."""
        if surface == "first":
            return self.apparent
        thickness = self.thickness_mm if thickness_mm is None else thickness_mm
        apparent = self.apparent
        centre, outline = apparent.virtual_centre_in_rig_mm, apparent.outline_in_rig_mm
        second = Mirror.second_surface(centre, outline, thickness_mm=thickness, refractive_index=self.refractive_index)
        return second.replaced(curvature_per_m=self.curvature_per_m)

    @cached_property
    def usable_normalized(self) -> FloatArray:
        """The part (n, 2) of the outline that shows the scene, in normalized coordinates; (0, 2) if there is none.

        A first-surface mirror shows the scene across its full outline. Light enters the front of a second-surface
        mirror t tan' before the point of reflection and leaves it t tan' beyond. Both points must lie within the
        front, which has the same outline as the back.
        """
        if not self.is_second_surface:
            return self.outline_normalized
        offset, tangent = self._central_ray
        in_glass = float(tangent_in_glass(np.array(tangent), self.refractive_index))
        lateral_mm = float(np.linalg.norm(offset))
        shift = self.thickness_mm * in_glass * offset / lateral_mm if lateral_mm > 0 else offset
        shift = shift @ self.rig_from_plane[:3, :2]
        usable = Polygon(self.outline_in_plane_mm + shift).intersection(Polygon(self.outline_in_plane_mm - shift))
        if usable.area <= 0.0:
            return np.zeros((0, 2))
        frame = self.apparent.rig_from_plane
        points = np.array(usable.exterior.coords)[:-1] @ frame[:3, :2].T + frame[:3, 3]
        return points[:, :2] / points[:, 2:]

    @property
    def is_second_surface(self) -> bool:
        """Whether the back reflects, so light passes through the glass."""
        return self.surface == "second"

    @property
    def front_mm(self) -> float:
        """Height of the front above the reflecting surface, towards the pupil: 0, or t for a second-surface mirror."""
        return self.thickness_mm if self.is_second_surface else 0.0

    @property
    def back_mm(self) -> float:
        """Height of the back above the reflecting surface, towards the pupil: -t, or 0 for a second-surface mirror."""
        return self.front_mm - self.thickness_mm

    @cached_property
    def solid(self) -> MirrorSolid:
        """The glass of the mirror, cut at right angles to its faces."""
        face = self.outline_in_rig_mm
        opposite_mm = self.front_mm if self.is_second_surface else self.back_mm
        return MirrorSolid(np.concatenate([face, face + opposite_mm * self.normal_in_rig]), self.normal_in_rig)

    @cached_property
    def distance_mm(self) -> float:
        """Distance of the plane from the pupil."""
        return float(np.linalg.norm(self.virtual_centre_in_rig_mm)) / 2.0

    @cached_property
    def normal_in_rig(self) -> FloatArray:
        """Unit normal (3,) on the reflecting side, where the pupil is: n.x = -distance on the plane."""
        return -self.virtual_centre_in_rig_mm / (2.0 * self.distance_mm)

    @cached_property
    def reflection(self) -> FloatArray:
        """The 3x3 linear part I - 2 n n^T (determinant -1), for directions."""
        return np.eye(3) - 2.0 * np.outer(self.normal_in_rig, self.normal_in_rig)

    def reflect(self, points_in_rig: FloatArray) -> FloatArray:
        """Reflect points (..., 3) in mm at the plane."""
        return reflect(points_in_rig, self.virtual_centre_in_rig_mm)

    def image_of(self, points_in_rig: FloatArray) -> FloatArray:
        """Images (..., 3) in the rig frame, mm, of points in front of the mirror; exact in direction from the pupil.

        NaN for points that are not in front of a second-surface or bent mirror; see `optics.geometry.mirror_imaging`.
        """
        if not self.is_second_surface and not self.curvature_per_m.any():
            return self.reflect(points_in_rig)
        mirrors = MirrorArrays(
            centre_mm=self.virtual_centre_in_rig_mm[:, None],
            centroid_mm=self.outline_in_rig_mm.mean(axis=0)[:, None],
            thickness_mm=np.array([self.front_mm]),
            refractive_index=np.array([self.refractive_index]),
            curvature_per_m=self.curvature_per_m[:, None],
        )
        return images(points_in_rig.reshape(-1, 3).T, mirrors).image_mm.T.reshape(points_in_rig.shape)

    def sag_mm(self, points_in_rig: FloatArray) -> FloatArray:
        """Heights (...) of the reflecting surface above its plane, towards the pupil, at points (..., 3) on it."""
        x, y = np.moveaxis((points_in_rig - self.rig_from_plane[:3, 3]) @ self.rig_from_plane[:3, :2], -1, 0)
        xx, yy, xy = self.curvature_per_m / 1e3
        return np.asarray((xx * x**2 + yy * y**2) / 2.0 + xy * x * y)

    def intersect(self, normalized: FloatArray) -> FloatArray:
        """Points (..., 3) in the rig frame, mm, where viewing rays (normalized coordinates (..., 2)) meet the plane."""
        return intersect_plane(normalized, self.virtual_centre_in_rig_mm)

    @cached_property
    def outline_normalized(self) -> FloatArray:
        """The outline (n, 2) in normalized image coordinates."""
        return self.outline_in_rig_mm[:, :2] / self.outline_in_rig_mm[:, 2:]

    @cached_property
    def rig_from_plane(self) -> FloatArray:
        """Rigid 4x4 of the mirror's own frame.

        The origin is the mean of the outline's corners. x is the projection of the rig's x on the plane (of the rig's
        z, if the mirror faces along the rig's x); z points out of the reflecting side.
        """
        axes = np.column_stack([*plane_axes(self.normal_in_rig[:, None]), self.normal_in_rig])
        return rigid(axes, self.outline_in_rig_mm.mean(axis=0))

    @cached_property
    def outline_in_plane_mm(self) -> FloatArray:
        """The outline (n, 2) in the mirror's own frame, as seen from the reflecting side."""
        matrix = self.rig_from_plane
        return (self.outline_in_rig_mm - matrix[:3, 3]) @ matrix[:3, :2]

    def moved(self, rotation: FloatArray, translation_mm: FloatArray) -> Self:
        """The mirror moved rigidly in the rig frame: rotated (3, 3) about its outline's mean, then shifted (3,), mm."""
        centre = self.outline_in_rig_mm.mean(axis=0)
        normal = rotation @ self.normal_in_rig
        # The frame's x axis follows the rig's, not the mirror, so the mirror also rotates within its frame.
        rotated = (rotation @ self.rig_from_plane[:3, :2]).T @ np.column_stack(plane_axes(normal[:, None]))
        xx, yy, xy = self.curvature_per_m
        curvature = rotated.T @ np.array([[xx, xy], [xy, yy]]) @ rotated
        return type(self).from_plane(
            centre + translation_mm,
            normal,
            outline_in_rig_mm=(self.outline_in_rig_mm - centre) @ rotation.T + centre + translation_mm,
            surface=self.surface,
            thickness_mm=self.thickness_mm,
            refractive_index=self.refractive_index,
            curvature_per_m=[curvature[0, 0], curvature[1, 1], curvature[0, 1]],
        )


@dataclass(frozen=True)
class MirrorSolid:
    """A prism over a convex outline.

    Attributes
    ----------
    corners_in_rig_mm
        Corners (2n, 3): first of the reflecting face, then of the opposite face, in the same order.
    normal_in_rig
        Unit normal (3,) of the reflecting face, towards the pupil.
    """

    corners_in_rig_mm: FloatArray
    normal_in_rig: FloatArray

    @cached_property
    def half_spaces(self) -> tuple[FloatArray, FloatArray]:
        """Outward unit normals (k, 3) and offsets (k,) of the faces: a point x is inside where n.x <= d, mm."""
        face, opposite = np.split(self.corners_in_rig_mm, 2)
        centroid = self.corners_in_rig_mm.mean(axis=0)
        sides = np.cross(np.roll(face, -1, axis=0) - face, opposite - face)
        normals = np.concatenate([[self.normal_in_rig, self.normal_in_rig], sides])
        points = np.concatenate([face[:1], opposite[:1], face])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals *= np.sign(np.sum(normals * (points - centroid), axis=1, keepdims=True))
        return normals, np.sum(normals * points, axis=1)
