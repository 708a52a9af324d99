"""The base camera: a pinhole with a lens, in OpenCV's convention (pixel (0, 0) is a pixel centre)."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, ValidationInfo, field_validator, model_validator

from mirrorcam.core.bounds import (
    APERTURE_MM,
    DEFOCUS_GROWTH_MM2,
    DEPTH_MM,
    FOCAL_PX,
    LARGEST_DISTORTION,
    LARGEST_PICTURE_PX,
    OFFSET_MM,
    PRINCIPAL_POINT_PX,
    PUPIL_WALK_MM,
    SENSOR_PX,
)
from mirrorcam.core.names import Name
from mirrorcam.core.values import Converted, FloatArray, Shaped, Value
from mirrorcam.optics.geometry.lateral_colour import LateralColour
from mirrorcam.optics.geometry.lenses.families import LensName, lens_of
from mirrorcam.optics.geometry.lenses.lens import Lens
from mirrorcam.optics.geometry.lenses.spline import LensGrid
from mirrorcam.optics.geometry.pupil import FOCUS_MM, Pupil
from mirrorcam.optics.geometry.pupil_walk import seen_along

PINHOLE_NAMES = ("fx_px", "fy_px", "cx_px", "cy_px")
DEPTH_NAMES = ("pupil_walk_mm", "defocus_growth_mm2")
"""Optional intrinsics whose effect depends on the depth of a point, and vanishes in focus."""
PLAIN_LENS: LensName = "brown_conrady"

_Coordinate = Annotated[float, OFFSET_MM.limits]
Corner = tuple[_Coordinate, _Coordinate, _Coordinate]


class Camera(Value):
    """Pinhole camera at the origin of its frame, looking along +z, x to image right, y to image down.

    A ray has the normalized coordinates x/z and y/z. The lens maps them to distorted coordinates (xd, yd), and the
    pixel is (fx xd + cx, fy yd + cy).

    Attributes
    ----------
    name : str
        Name for display.
    width_px, height_px : int
        Size of the sensor.
    fx_px, fy_px, cx_px, cy_px : float
        Focal lengths and principal point; pixel (0, 0) is the centre of the top-left pixel.
    lens_model : str
        Family of the lens (`lenses.families`).
    lens_grid : LensGrid, optional
        Control points of a spline lens.
    distortion : ndarray
        Coefficients of the lens, in OpenCV's order: (k1, k2, p1, p2, k3) for a Brown-Conrady lens.
    aperture_mm : float
        Diameter of the entrance pupil; 0 for a pinhole.
    focus_mm : float
        Distance in focus, along the axis from the pupil.
    pupil_walk_mm : float, optional
        Displacement of the pupil towards the scene for rays with x^2 + y^2 = 1, proportional to x^2 + y^2. The lens
        model then holds at the distance in focus. None: the pupil is fixed, and this is not one of the intrinsics.
    defocus_growth_mm2 : float, optional
        Relative growth of the picture about the axis at the depth z, over (1/z - 1/focus_mm)^2: grey is dominated by
        its sharpest colour in focus, by its brightest out of focus. None: no growth, and not one of the intrinsics.
    lateral_colour : LateralColour, optional
        Displacements of red and blue; the lens is that of grey pictures. None: not known, or none.
    body_mm : tuple, optional
        Bounding box of the body: minimum and maximum corner, (x, y, z) each, with the pupil at the origin.
    lens_mm : tuple, optional
        Likewise the bounding box of a lens that stands out of the body.
    """

    name: Name = "camera"
    width_px: int = SENSOR_PX.field()
    height_px: int = SENSOR_PX.field()
    fx_px: float = FOCAL_PX.field()
    fy_px: float = FOCAL_PX.field()
    cx_px: float = PRINCIPAL_POINT_PX.field()
    cy_px: float = PRINCIPAL_POINT_PX.field()
    lens_model: LensName = Field(default=PLAIN_LENS, exclude_if=lambda name: name == PLAIN_LENS)
    lens_grid: LensGrid | None = Field(default=None, exclude_if=lambda grid: grid is None)
    distortion: Converted[Annotated[FloatArray, Shaped((None,), largest=LARGEST_DISTORTION)], ArrayLike] = Field(
        default_factory=lambda: np.zeros(5), validate_default=True
    )
    aperture_mm: float = Field(default=0.0, ge=APERTURE_MM.min, le=APERTURE_MM.max, exclude_if=lambda mm: mm == 0.0)
    focus_mm: float = Field(default=FOCUS_MM, ge=DEPTH_MM.min, le=DEPTH_MM.max, exclude_if=lambda mm: mm == FOCUS_MM)
    pupil_walk_mm: float | None = Field(
        default=None, ge=PUPIL_WALK_MM.min, le=PUPIL_WALK_MM.max, exclude_if=lambda mm: mm is None
    )
    defocus_growth_mm2: float | None = Field(
        default=None, ge=DEFOCUS_GROWTH_MM2.min, le=DEFOCUS_GROWTH_MM2.max, exclude_if=lambda mm2: mm2 is None
    )
    lateral_colour: LateralColour | None = Field(default=None, exclude_if=lambda colour: colour is None)
    body_mm: tuple[Corner, Corner] | None = Field(default=None, exclude_if=lambda box: box is None)
    lens_mm: tuple[Corner, Corner] | None = Field(default=None, exclude_if=lambda box: box is None)

    @field_validator("distortion")
    @classmethod
    def _check_distortion(cls, distortion: FloatArray, info: ValidationInfo) -> FloatArray:
        if info.data.keys() >= {"lens_model", "lens_grid"}:  # else refused already
            lens_of(info.data["lens_model"], distortion, info.data["lens_grid"])
        return distortion

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name, box in (("body_mm", self.body_mm), ("lens_mm", self.lens_mm)):
            if box is not None and not all(low < high for low, high in zip(*box, strict=True)):
                raise ValueError(f"{name} {box}, expected the box's minimum corner, then its maximum corner")
        if self.width_px * self.height_px > LARGEST_PICTURE_PX:
            megapixels = LARGEST_PICTURE_PX // 1_000_000
            raise ValueError(f"{self.width_px}x{self.height_px} px, expected {megapixels} megapixels or fewer")
        return self

    @classmethod
    def c920(cls) -> Self:
        """Logitech C920 at 1920x1080: a field of view of 70.42 deg x 43.3 deg, so a focal length of 1360.38 px.

        Its 3.67 mm f/2 lens is in focus at half a metre. Its body is described in `cameras/c920.toml`.
        """
        return cls(
            name="Logitech C920",
            width_px=1920,
            height_px=1080,
            fx_px=1360.38,
            fy_px=1360.38,
            cx_px=959.5,
            cy_px=539.5,
            aperture_mm=1.8,
            focus_mm=500.0,
            body_mm=((-47.0, -14.5, -20.0), (47.0, 14.5, 4.0)),
        )

    @property
    def pupil(self) -> Pupil:
        """Entrance pupil of the lens."""
        return Pupil(self.aperture_mm, self.focus_mm, self.pupil_walk_mm or 0.0)

    def with_pupil(self, pupil: Pupil) -> Self:
        """The same camera with the diameter and the focus of another pupil; the walk stays."""
        return self.replaced(aperture_mm=pupil.aperture_mm, focus_mm=pupil.focus_mm)

    def binned(self, factor: float) -> Self:
        """The same camera with its number of pixels along each axis scaled by `factor`.

        Integer coordinates are pixel centres, so the image corner stays at (-0.5, -0.5).
        """
        return self.replaced(
            name=f"{self.name[:80]}, scaled by {factor:g}",
            width_px=round(self.width_px * factor),
            height_px=round(self.height_px * factor),
            fx_px=self.fx_px * factor,
            fy_px=self.fy_px * factor,
            cx_px=(self.cx_px + 0.5) * factor - 0.5,
            cy_px=(self.cy_px + 0.5) * factor - 0.5,
        )

    @cached_property
    def matrix(self) -> FloatArray:
        """The 3x3 intrinsic matrix."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    @cached_property
    def lens(self) -> Lens:
        """The lens as `lens_model` and `distortion` describe it."""
        return lens_of(self.lens_model, self.distortion, self.lens_grid)

    @property
    def _depth_terms(self) -> dict[str, float]:
        """The optional intrinsics that depend on depth."""
        terms = {name: getattr(self, name) for name in DEPTH_NAMES}
        return {name: value for name, value in terms.items() if value is not None}

    @property
    def intrinsic_names(self) -> tuple[str, ...]:
        """Names (k,) of `intrinsics`."""
        return (*PINHOLE_NAMES, *self.lens.names, *self._depth_terms)

    @cached_property
    def intrinsics(self) -> FloatArray:
        """The parameters (k,) named by `intrinsic_names`."""
        pinhole = (self.fx_px, self.fy_px, self.cx_px, self.cy_px)
        return np.array([*pinhole, *self.distortion, *self._depth_terms.values()])

    @property
    def prior_sigmas(self) -> FloatArray:
        """Standard deviations (k,) of priors around zero on `intrinsics`; infinite without a prior."""
        without = [np.inf] * len(self._depth_terms)
        return np.array([*[np.inf] * len(PINHOLE_NAMES), *self.lens.prior_sigmas, *without])

    def with_intrinsics(self, intrinsics: FloatArray) -> Self:
        """The same sensor and lens family with other parameters (k,), in the order of `intrinsic_names`."""
        fx, fy, cx, cy, *rest = (float(v) for v in intrinsics)
        count = len(self.distortion)
        terms = dict(zip(self._depth_terms, rest[count:], strict=True))
        return self.replaced(fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, distortion=rest[:count], **terms)

    @property
    def in_focus(self) -> Self:
        """The same camera for points in focus, without the intrinsics that depend on depth."""
        return self.replaced(**dict.fromkeys(self._depth_terms))

    @property
    def is_undistorted(self) -> bool:
        """Whether the lens images straight lines as straight lines, without distortion."""
        return self.lens.is_identity

    @cached_property
    def valid_radius(self) -> float:
        """Normalized radius up to which the lens is defined; infinite if the distortion is monotonic."""
        return self.lens.valid_radius

    def pixels_from_normalized(self, normalized: FloatArray) -> FloatArray:
        """Distort and scale normalized coordinates (..., 2) to pixels; NaN beyond `valid_radius`."""
        x, y = normalized[..., 0], normalized[..., 1]
        xd, yd = self.lens.distorted(x, y)
        pixels = np.stack([self.fx_px * xd + self.cx_px, self.fy_px * yd + self.cy_px], axis=-1)
        if np.isfinite(self.valid_radius):
            pixels = np.where((x * x + y * y <= self.valid_radius**2)[..., None], pixels, np.nan)
        return pixels

    def colour_pixels(self, pixels: FloatArray) -> FloatArray:
        """Pixels (3, ..., 2) at which red, green and blue show what grey pictures show at pixels (..., 2)."""
        if self.lateral_colour is None:
            return np.stack([pixels] * 3)
        offset = pixels - np.array([self.cx_px, self.cy_px])
        normalized = offset / np.array([self.fx_px, self.fy_px])
        shift = self.lateral_colour.against_grey(np.square(normalized).sum(axis=-1))
        return np.asarray(pixels + shift[..., None] * offset)

    def chief_rays(self, points_in_rig: FloatArray) -> FloatArray:
        """Normalized coordinates (..., 2) at which points (..., 3) in mm are seen; NaN for points behind the camera."""
        points = np.asarray(points_in_rig, dtype=np.float64)
        depth = points[..., 2:]
        if self.pupil_walk_mm is not None:
            seen = seen_along(points.reshape(-1, 3).T, self.pupil_walk_mm, self.focus_mm)
            normalized = seen.normalized.T.reshape(*points.shape[:-1], 2)
        else:
            nan = np.full(points[..., :2].shape, np.nan)
            normalized = np.divide(points[..., :2], depth, out=nan, where=depth > 0)
        if self.defocus_growth_mm2:
            with np.errstate(divide="ignore"):
                normalized = normalized * (1.0 + self.defocus_growth_mm2 * (1.0 / depth - 1.0 / self.focus_mm) ** 2)
        return normalized

    def project(self, points_in_rig: FloatArray) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) in mm; NaN for points behind the camera or beyond the lens model."""
        return self.pixels_from_normalized(self.chief_rays(points_in_rig))

    def project_with_jacobians(self, points_in_rig: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pixels (n, 2), d pixels / d points (n, 2, 3) and d pixels / d intrinsics (n, 2, k) of points (n, 3) in mm."""
        x, y, z = np.asarray(points_in_rig, dtype=np.float64).T
        by_point, by_term = None, {}
        if self.pupil_walk_mm is None:
            x, y = x / z, y / z
        else:
            walked = seen_along(np.stack([x, y, z]), self.pupil_walk_mm, self.focus_mm)
            x, y = walked.normalized
            by_point, by_term["pupil_walk_mm"] = walked.by_point, walked.by_walk
        if self.defocus_growth_mm2 is not None:
            defocus = 1.0 / z - 1.0 / self.focus_mm
            factor = 1.0 + self.defocus_growth_mm2 * defocus**2
            if by_point is None:
                zero = np.zeros_like(z)
                by_point = np.array([[1.0 / z, zero, -x / z], [zero, 1.0 / z, -y / z]])
            by_point = factor * by_point
            by_point[:, 2] -= 2.0 * self.defocus_growth_mm2 * defocus / z**2 * np.stack([x, y])
            by_term = {name: factor * by for name, by in by_term.items()}
            by_term["defocus_growth_mm2"] = defocus**2 * np.stack([x, y])
            x, y = factor * x, factor * y
        # Component-first storage: each assignment below then runs through memory once.
        d_intrinsics = np.zeros((2, len(self.intrinsics), x.size)).transpose(2, 0, 1)
        lens_columns = slice(4, 4 + len(self.distortion))
        lens = self.lens.linearized(x, y, (self.fx_px, self.fy_px), d_intrinsics[:, :, lens_columns])
        d_points = np.empty((2, 3, x.size)).transpose(2, 0, 1)
        d_points[:, 0, 0], d_points[:, 0, 1] = self.fx_px * lens.xx, self.fx_px * lens.xy
        d_points[:, 1, 0], d_points[:, 1, 1] = self.fy_px * lens.yx, self.fy_px * lens.yy
        if by_point is None:
            d_points[:, :, :2] /= z[:, None, None]
            d_points[:, :, 2] = -(d_points[:, :, 0] * x[:, None] + d_points[:, :, 1] * y[:, None])
        else:
            for column, by in enumerate(by_term.values(), start=lens_columns.stop):
                d_intrinsics[:, :, column] = np.einsum("nij,jn->ni", d_points[:, :, :2], by)
            d_points[:] = np.einsum("nij,jkn->nik", d_points[:, :, :2], by_point)
        d_intrinsics[:, 0, 0], d_intrinsics[:, 1, 1] = lens.x, lens.y
        d_intrinsics[:, 0, 2] = d_intrinsics[:, 1, 3] = 1.0
        pixels = np.stack([self.fx_px * lens.x + self.cx_px, self.fy_px * lens.y + self.cy_px], axis=-1)
        return pixels, d_points, d_intrinsics

    def normalized_from_pixels(self, pixels: FloatArray) -> FloatArray:
        """Undistort pixels (..., 2) to normalized coordinates in focus by Newton's method; NaN where it fails."""
        if self._depth_terms:
            return self.in_focus.normalized_from_pixels(pixels)
        pixels = np.asarray(pixels, dtype=np.float64)
        shape = pixels.shape
        target = pixels.reshape(-1, 2)
        focal = np.array([self.fx_px, self.fy_px])
        normalized = (target - np.array([self.cx_px, self.cy_px])) / focal
        if self.is_undistorted:
            return normalized.reshape(shape)
        normalized = np.column_stack(self.lens.undistorted_estimate(*normalized.T))
        for _ in range(20):
            points = np.column_stack([normalized, np.ones(len(normalized))])
            projected, d_points, _ = self.project_with_jacobians(points)
            error = target - projected
            if np.nanmax(np.abs(error), initial=0.0) < 1e-11 * max(self.width_px, self.height_px):
                break
            normalized += _newton_step(d_points[:, :, :2], error)
        error = np.abs(target - self.pixels_from_normalized(normalized))
        converged = (error < 1e-6).all(axis=1)
        normalized[~converged] = np.nan
        return normalized.reshape(shape)

    def unproject(self, pixels: FloatArray) -> FloatArray:
        """Viewing rays (..., 3) with z = 1, in the rig frame, of pixels (..., 2)."""
        normalized = self.normalized_from_pixels(pixels)
        return np.concatenate([normalized, np.ones((*normalized.shape[:-1], 1))], axis=-1)


def _newton_step(jacobian: FloatArray, error: FloatArray) -> FloatArray:
    """Newton steps (n, 2) for errors (n, 2) with Jacobians (n, 2, 2); NaN where a Jacobian is singular."""
    try:
        return np.asarray(np.linalg.solve(jacobian, error[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        with np.errstate(invalid="ignore"):  # some are not finite
            singular = np.linalg.det(jacobian) == 0.0
        regular = np.where(singular[:, None, None], np.eye(2), jacobian)
        steps = np.linalg.solve(regular, error[:, :, None])[:, :, 0]
        return np.where(singular[:, None], np.nan, steps)
