"""Where the pupil sees a point by way of a mirror that may lie behind a sheet and may be bent, and what changes it.

One formula serves `Mirror.image_of` and the calibration. All arrays are component first, a column per point; quantities
of the mirrors broadcast against the points.

**Sheet.** Unfolded at the coating, light from the pupil to a point passes A of air and 2 t of the sheet while it goes
l across: A tan + 2 t tan' = l, tan' = g tan. With s = tan / l this is s (A + 2 t g) = 1, which is smooth at l = 0.

**Bend.** The surface is n.x + d = h(u, v), h = (k_xx u^2 + k_yy v^2) / 2 + k_xy u v, in the mirror's own frame, whose
origin is the foot of the outline's middle on the plane. Light is reflected as by the tangent plane where it meets the
coating, (u, v) = E(u, v): solved by the chord method, differentiated implicitly, (I - E') d(u, v) = dE. The front of a
bent sheet is everywhere as far from its coating; where light enters and leaves it counts as parallel to the coating
where light meets that. It leans there by as much one way as the other, which costs no direction, only a shift: 0.004 px
of a C920 at most for 2 mm of acrylic with 0.3 / m (0.1 mm over a mirror of 50 mm), growing with t^2 k.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.plate import outer_tangent

CHORD_STEPS = 40
MET_MM = 1e-9
"""How near to the point it was supposed to meet light must meet the coating."""


@dataclass(frozen=True)
class Surfaces:
    """The mirrors that points (3, n) are seen in.

    Virtual centres (3, n) mm of the coating, the middle of the outline (3, n) mm, thickness (n,) mm of the sheet before
    the coating (0: first surface) and its refractive index (n,), curvature (3, n) 1/m: xx, yy, xy.
    """

    centre: FloatArray
    middle: FloatArray
    thickness: FloatArray
    index: FloatArray
    curvature: FloatArray


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of a rows, by the point (a, 3, n), centre (a, 3, n), thickness (a, n) and curvature (a, 3, n)."""

    point: FloatArray
    centre: FloatArray
    thickness: FloatArray
    curvature: FloatArray


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products over the last but one axis, which has three components."""
    return np.asarray(a[..., 0, :] * b[..., 0, :] + a[..., 1, :] * b[..., 1, :] + a[..., 2, :] * b[..., 2, :])


def plane_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axes x and y (3, n) of planes with unit normals (3, n), see `Mirror.rig_from_plane`."""
    x_axis = np.array([[1.0], [0.0], [0.0]]) - normal[0] * normal
    along_x = np.sqrt(dot(x_axis, x_axis)) < 1e-6
    if along_x.any():
        x_axis = np.where(along_x, np.cross([[0.0], [1.0], [0.0]], normal, axis=0), x_axis)
    x_axis = x_axis / np.sqrt(dot(x_axis, x_axis))
    return x_axis, np.cross(normal, x_axis, axis=0)


def images(points: FloatArray, surfaces: Surfaces, *, bent: bool = False) -> Image:
    """Images of points (3, n), exact in direction; NaN for a point that is not before a sheet or a bent mirror.

    With `bent`, the derivatives by curvature are known even where there is none yet.
    """
    if bent or np.any(surfaces.curvature):
        return BentImage.of(points, surfaces)
    return SheetImage.of(points, surfaces) if np.any(surfaces.thickness) else PlainImage.of(points, surfaces)


class Image(Protocol):
    """Images (3, n) of points, and what changes them."""

    @property
    def image(self) -> FloatArray: ...

    def pulled_back(self, rows: FloatArray) -> Derivatives:
        """Derivatives of what has the derivatives (a, 3, n) by the image."""
        ...


@dataclass(frozen=True)
class PlainImage:
    """Images (3, n) in flat first-surface mirrors."""

    image: FloatArray
    _point: FloatArray
    _centre: FloatArray
    _squared: FloatArray
    _along: FloatArray

    @classmethod
    def of(cls, points: FloatArray, surfaces: Surfaces) -> PlainImage:
        centre = surfaces.centre
        squared = dot(centre, centre)
        along = dot(points, centre) / squared
        return cls(points - (2.0 * along - 1.0) * centre, points, centre, squared, along)

    def pulled_back(self, rows: FloatArray) -> Derivatives:
        """With x' = x - (2 x.c / |c|^2 - 1) c; none by thickness (zeros) or curvature (a, 0, n)."""
        to_centre = 2.0 * dot(rows, self._centre) / self._squared
        point = rows - to_centre[:, None] * self._centre
        centre = (1.0 - 2.0 * self._along) * rows - to_centre[:, None] * (
            self._point - 2.0 * self._along * self._centre
        )
        return Derivatives(point, centre, np.zeros_like(to_centre), np.empty((len(rows), 0, rows.shape[-1])))


@dataclass(frozen=True)
class SheetImage:
    """Images (3, n) in flat mirrors behind sheets."""

    image: FloatArray
    _sheet: _Sheet

    @classmethod
    def of(cls, points: FloatArray, surfaces: Surfaces) -> SheetImage:
        sheet = _Sheet.through(points, *_plane(surfaces.centre), surfaces)
        return cls(sheet.image(), sheet)

    def pulled_back(self, rows: FloatArray) -> Derivatives:
        """None by curvature (a, 0, n)."""
        pull = self._sheet.pull_image(rows)
        centre = _pull_plane(pull.normal, pull.distance, self._sheet.normal, self._sheet.distance)
        return Derivatives(pull.point, centre, pull.thickness, np.empty((len(rows), 0, rows.shape[-1])))


@dataclass(frozen=True)
class BentImage:
    """Images (3, n) in bent mirrors."""

    image: FloatArray
    _sheet: _Sheet
    _tangent: _Tangent

    @classmethod
    def of(cls, points: FloatArray, surfaces: Surfaces) -> BentImage:
        normal, distance = _plane(surfaces.centre)
        axes = plane_axes(normal)
        meets = _Sheet.through(points, normal, distance, surfaces).coating()
        u, v = (dot(axis, meets - surfaces.middle) for axis in axes)
        chord = None
        for _ in range(CHORD_STEPS):
            tangent = _Tangent.at(u, v, normal, distance, axes, surfaces)
            sheet = _Sheet.through(points, tangent.normal, tangent.distance, surfaces)
            meets = sheet.coating() - surfaces.middle
            off_u, off_v = (dot(axis, meets) - was for axis, was in zip(axes, (u, v), strict=True))
            missed = ~(np.abs(off_u) + np.abs(off_v) <= MET_MM)
            if not (missed & ~np.isnan(off_u)).any():
                break
            if chord is None:
                chord = tangent.slopes(sheet)
            du, dv = _solved(chord, off_u, off_v)
            u, v = u + du, v + dv
        return cls(np.where(missed, np.nan, sheet.image()), sheet, tangent)

    def pulled_back(self, rows: FloatArray) -> Derivatives:
        tangent, sheet = self._tangent, self._sheet
        direct, meets = sheet.pull_image(rows), sheet.pull_coating(np.stack(tangent.axes))
        by_u, by_v = tangent.pull_uv(direct.normal, direct.distance)
        of_u, of_v = _solved(np.swapaxes(tangent.slopes_of(meets), 0, 1), by_u, by_v)

        def total(of: str) -> FloatArray:
            through: FloatArray = getattr(meets, of)
            if through.ndim == 3:
                through_u, through_v = of_u[:, None] * through[0], of_v[:, None] * through[1]
            else:
                through_u, through_v = of_u * through[0], of_v * through[1]
            return np.asarray(getattr(direct, of) + through_u + through_v)

        offset = sheet.coating() - tangent.middle
        by_axes = of_u[:, None] * offset, of_v[:, None] * offset
        centre, curvature = tangent.pull(total("normal"), total("distance"), by_axes)
        return Derivatives(total("point"), centre, total("thickness"), curvature)


def _solved(matrix: FloatArray, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solution (..., n) of 2 x 2 equations (2, 2, n) with the right-hand sides a and b (..., n)."""
    (aa, ab), (ba, bb) = matrix
    determinant = aa * bb - ab * ba
    return (bb * a - ab * b) / determinant, (aa * b - ba * a) / determinant


def _plane(centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normal (3, n) and distance (n,) of the planes of virtual centres (3, n)."""
    length = np.sqrt(dot(centre, centre))
    return -centre / length, length / 2.0


def _pull_plane(
    normal_row: FloatArray, distance_row: FloatArray, normal: FloatArray, distance: FloatArray
) -> FloatArray:
    """Derivatives (a, 3, n) by the virtual centre of what has these by its normal and its distance."""
    across = normal_row - dot(normal_row, normal)[:, None] * normal
    return np.asarray(across / (-2.0 * distance) - 0.5 * distance_row[:, None] * normal)


@dataclass(frozen=True)
class _Pull:
    """Derivatives of a rows, by the point (a, 3, n), normal (a, 3, n), distance (a, n) and thickness (a, n)."""

    point: FloatArray
    normal: FloatArray
    distance: FloatArray
    thickness: FloatArray


@dataclass(frozen=True)
class _Sheet:
    """Light to points by way of plane coatings behind sheets; names as in the head of this module."""

    point: FloatArray
    normal: FloatArray
    distance: FloatArray
    thickness: FloatArray
    height: FloatArray
    across: FloatArray
    air: FloatArray
    g: FloatArray
    s: FloatArray
    alpha: FloatArray
    depth: FloatArray

    @classmethod
    def through(cls, point: FloatArray, normal: FloatArray, distance: FloatArray, surfaces: Surfaces) -> _Sheet:
        t, n = surfaces.thickness, surfaces.index
        height = dot(point, normal)
        across = point - height * normal
        air = np.where(height + distance - t > 0.0, height + 2.0 * (distance - t), np.nan)
        squared = dot(across, across)
        if np.any(t > 0.0):
            tangent = outer_tangent(np.sqrt(squared), air, 2.0 * t, n)
            g = 1.0 / np.sqrt(n**2 + (n**2 - 1.0) * np.square(tangent))
            s = 1.0 / (air + 2.0 * t * g)
            # d g / d tan^2 = -(n^2 - 1) g^3 / 2
            alpha = -t * (n**2 - 1.0) * g**3 * s**2
        else:
            g, s, alpha = np.ones_like(air), 1.0 / air, np.zeros_like(air)
        depth = 1.0 / s + 2.0 * alpha * squared
        return cls(point, normal, distance, t, height, across, air, g, s, alpha, depth)

    def image(self) -> FloatArray:
        """Images (3, n), as deep behind the coating as the light has air to pass."""
        return np.asarray(self.air * (self.s * self.across - self.normal))

    def _ahead(self) -> FloatArray:
        """How far the point of the coating lies from the pupil's foot, per tangent: air, and sheet times g."""
        return self.distance - self.thickness + self.thickness * self.g

    def coating(self) -> FloatArray:
        """Where the light meets the coating (3, n)."""
        return np.asarray(self.s * self._ahead() * self.across - self.distance * self.normal)

    def pull_image(self, rows: FloatArray) -> _Pull:
        """Derivatives of what has the derivatives (a, 3, n) by the image."""
        stretch = self.air * self.s
        by_stretch, along = dot(rows, self.across), dot(rows, self.normal)
        by_s = self.air * by_stretch
        return self._pull(rows, stretch, by_s, self.s * by_stretch - along, 0.0, along, self.air, 0.0, 0.0)

    def pull_coating(self, rows: FloatArray) -> _Pull:
        """Derivatives of what has the derivatives (a, 3, n) by the point of the coating that the light meets."""
        along, by_stretch = dot(rows, self.normal), dot(rows, self.across)
        ahead = self._ahead()
        squared = dot(self.across, self.across)
        by_s = by_stretch * (ahead + self.alpha * squared)
        by_squared = by_stretch * self.alpha * self.s / 2.0
        by_distance = by_stretch * self.s - along
        by_thickness = -by_stretch * self.s * (1.0 - self.g)
        return self._pull(rows, self.s * ahead, by_s, 0.0, by_squared, along, self.distance, by_distance, by_thickness)

    def _pull(
        self,
        rows: FloatArray,
        stretch: FloatArray,
        by_s: FloatArray,
        by_air: FloatArray | float,
        by_squared: FloatArray | float,
        along: FloatArray,
        behind: FloatArray,
        by_distance: FloatArray | float,
        by_thickness: FloatArray | float,
    ) -> _Pull:
        """Derivatives of rows . (stretch across - behind normal), given those by s, air and |across|^2, by chain rule.

        s (A + 2 t g) = 1 gives ds = -(s / D) (dA + 2 g dt + alpha d|across|^2), alpha = 2 t g' s^2,
        D = A + 2 t g + 2 alpha |across|^2.
        """
        by_step = -self.s / self.depth * by_s
        air = by_air + by_step
        squared = by_squared + self.alpha * by_step
        height = air - stretch * along - 2.0 * self.height * squared
        point = stretch * rows + 2.0 * squared[:, None] * self.point + height[:, None] * self.normal
        normal = height[:, None] * self.point - (stretch * self.height + behind) * rows
        return _Pull(point, normal, by_distance + 2.0 * air, by_thickness - 2.0 * air + 2.0 * self.g * by_step)


@dataclass(frozen=True)
class _Tangent:
    """Tangent planes of bent surfaces at (u, v): normal (3, n), distance (n,), and what they are made of."""

    normal: FloatArray
    distance: FloatArray
    axes: tuple[FloatArray, FloatArray]
    middle: FloatArray
    base_normal: FloatArray
    base_distance: FloatArray
    length: FloatArray
    uv: tuple[FloatArray, FloatArray]
    reach: tuple[FloatArray, FloatArray]
    bend: FloatArray
    slope: tuple[FloatArray, FloatArray]

    @classmethod
    def at(
        cls,
        u: FloatArray,
        v: FloatArray,
        normal: FloatArray,
        distance: FloatArray,
        axes: tuple[FloatArray, FloatArray],
        surfaces: Surfaces,
    ) -> _Tangent:
        bend = surfaces.curvature / 1e3
        xx, yy, xy = bend
        slope_u, slope_v = xx * u + xy * v, yy * v + xy * u
        height = (slope_u * u + slope_v * v) / 2.0
        leaning = normal - slope_u * axes[0] - slope_v * axes[1]
        length = np.sqrt(1.0 + slope_u**2 + slope_v**2)
        reach = u + dot(axes[0], surfaces.middle), v + dot(axes[1], surfaces.middle)
        away = (distance - height + slope_u * reach[0] + slope_v * reach[1]) / length
        return cls(
            leaning / length,
            away,
            axes,
            surfaces.middle,
            normal,
            distance,
            length,
            (u, v),
            reach,
            bend,
            (slope_u, slope_v),
        )

    def _pull_slopes(self, by_normal: FloatArray, by_distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Derivatives (a, 3, n) by the unscaled normal n - h_u e1 - h_v e2, and (a, n) by its slopes h_u and h_v."""
        scaled = by_distance / self.length
        across = by_normal - dot(by_normal, self.normal)[:, None] * self.normal
        by_leaning = across / self.length - (scaled * self.distance)[:, None] * self.normal
        by_u, by_v = (scaled * reach - dot(by_leaning, axis) for reach, axis in zip(self.reach, self.axes, strict=True))
        return by_leaning, by_u, by_v

    def pull_uv(self, by_normal: FloatArray, by_distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives (a, n) by u and by v of what has these by the tangent plane."""
        xx, yy, xy = self.bend
        _, by_u, by_v = self._pull_slopes(by_normal, by_distance)
        return by_u * xx + by_v * xy, by_u * xy + by_v * yy

    def slopes(self, sheet: _Sheet) -> FloatArray:
        """I - E' (2, 2, n): of (u, v) less where light meets the coating by the tangent plane at (u, v)."""
        return self.slopes_of(sheet.pull_coating(np.stack(self.axes)))

    def slopes_of(self, pull: _Pull) -> FloatArray:
        """The same from the derivatives of where light meets the coating along both axes."""
        by_u, by_v = self.pull_uv(pull.normal, pull.distance)
        return np.array([[1.0 - by_u[0], -by_v[0]], [-by_u[1], 1.0 - by_v[1]]])

    def pull(
        self, by_normal: FloatArray, by_distance: FloatArray, by_axes: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Derivatives by the virtual centre (a, 3, n) and by the curvature (a, 3, n), with (u, v) held.

        `by_axes` are those by the axes beyond what the tangent plane makes of them. The axes follow the normal:
        de1 = q e2 - (dn.e1) n, de2 = -q e1 - (dn.e2) n, q = -n_x (e2.dn) / sqrt(1 - n_x^2).
        """
        (u, v), (e1, e2), n = self.uv, self.axes, self.base_normal
        by_leaning, by_u, by_v = self._pull_slopes(by_normal, by_distance)
        scaled = by_distance / self.length
        by_height = -scaled
        to_bend = 1e-3 * np.stack(
            [
                by_height * u * u / 2.0 + by_u * u,
                by_height * v * v / 2.0 + by_v * v,
                by_height * u * v + by_u * v + by_v * u,
            ],
            axis=1,
        )
        by_e1, by_e2 = (
            extra + slope * (scaled[:, None] * self.middle - by_leaning)
            for extra, slope in zip(by_axes, self.slope, strict=True)
        )
        aside = np.sqrt(1.0 - n[0] ** 2)
        turn = np.divide(n[0], aside, out=np.zeros_like(aside), where=aside > 1e-6)
        by_turn = (dot(by_e1, e2) - dot(by_e2, e1)) * turn
        by_base = by_leaning - dot(by_e1, n)[:, None] * e1 - (dot(by_e2, n) + by_turn)[:, None] * e2
        return _pull_plane(by_base, scaled, n, self.base_distance), to_bend
