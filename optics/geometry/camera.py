"""The base camera: pinhole with Brown-Conrady distortion in OpenCV's convention (pixel (0, 0) is a pixel centre)."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from mirrorcam.optics.base.bounds import (
    APERTURE_MM,
    DEPTH_MM,
    FOCAL_PX,
    LARGEST_DISTORTION,
    LARGEST_PICTURE_PX,
    OFFSET_MM,
    PLACE_PX,
    Bounds,
)
from mirrorcam.optics.base.names import Name
from mirrorcam.optics.base.values import FloatArray, Shaped, Value
from mirrorcam.optics.geometry.pupil import FOCUS_MM, Pupil

INTRINSIC_NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")

SENSOR_PX = Bounds(1, 65_535)

Corner = tuple[Annotated[float, OFFSET_MM.each], Annotated[float, OFFSET_MM.each], Annotated[float, OFFSET_MM.each]]


class Camera(Value):
    """Pinhole camera at the origin of its frame, looking along +z, x to image right, y to image down.

    The lens model is OpenCV's (Brown-Conrady): with x, y the coordinates (x/z, y/z) of a ray, called normalized, and
    r^2 = x^2 + y^2, a pixel is u = fx (x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)) + cx, v alike.

    Attributes
    ----------
    name : str
        Name for people.
    width_px, height_px : int
        Size of the sensor.
    fx_px, fy_px, cx_px, cy_px : float
        Focal lengths and principal point; pixel (0, 0) is the centre of the top-left pixel.
    distortion : ndarray
        (k1, k2, p1, p2, k3), in the order of OpenCV.
    aperture_mm : float
        Diameter of the entrance pupil, 0 of a pinhole.
    focus_mm : float
        Distance in focus, along the axis from the pupil.
    body_mm : tuple, optional
        Box around the body: its least and its greatest corner, (x, y, z) each, with the pupil at the origin.
    """

    name: Name = "camera"
    width_px: int = SENSOR_PX.field()
    height_px: int = SENSOR_PX.field()
    fx_px: float = FOCAL_PX.field()
    fy_px: float = FOCAL_PX.field()
    cx_px: float = PLACE_PX.field()
    cy_px: float = PLACE_PX.field()
    distortion: Annotated[FloatArray, Shaped((5,), largest=LARGEST_DISTORTION)] = Field(
        default_factory=lambda: np.zeros(5), validate_default=True
    )
    aperture_mm: float = Field(default=0.0, ge=APERTURE_MM.least, le=APERTURE_MM.most, exclude_if=lambda mm: mm == 0.0)
    focus_mm: float = Field(default=FOCUS_MM, ge=DEPTH_MM.least, le=DEPTH_MM.most, exclude_if=lambda mm: mm == FOCUS_MM)

    body_mm: tuple[Corner, Corner] | None = Field(default=None, exclude_if=lambda box: box is None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.body_mm is not None and not all(low < high for low, high in zip(*self.body_mm, strict=True)):
            raise ValueError(f"body_mm {self.body_mm}, expected the box's least corner, then its greatest")
        if self.width_px * self.height_px > LARGEST_PICTURE_PX:
            most = LARGEST_PICTURE_PX // 1_000_000
            raise ValueError(f"{self.width_px}x{self.height_px} px, expected {most} megapixels or fewer")
        return self

    @classmethod
    def c920(cls) -> Self:
        """Logitech C920 at 1920x1080: 70.42 deg x 43.3 deg field of view, so 1360.38 px of focal length.

        Its lens is f/2 of 3.67 mm, in focus at half a metre. Its body is that of `cad/cameras/c920.toml`.
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
        """Pupil of its lens."""
        return Pupil(self.aperture_mm, self.focus_mm)

    def with_pupil(self, pupil: Pupil) -> Self:
        """The same camera with the diameter and the focus of another pupil; how that walks is not the camera's."""
        return self.replaced(aperture_mm=pupil.aperture_mm, focus_mm=pupil.focus_mm)

    @cached_property
    def matrix(self) -> FloatArray:
        """The 3x3 intrinsic matrix."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    @cached_property
    def intrinsics(self) -> FloatArray:
        """The parameters (9,) named by `INTRINSIC_NAMES`."""
        return np.array([self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion])

    def with_intrinsics(self, intrinsics: FloatArray) -> Self:
        """The same sensor with other parameters (9,), in the order of `INTRINSIC_NAMES`."""
        fx, fy, cx, cy, *distortion = (float(v) for v in intrinsics)
        return self.replaced(fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, distortion=distortion)

    @cached_property
    def valid_radius(self) -> float:
        """Normalized radius up to which the radial distortion grows monotonically (infinite where it never folds)."""
        k1, k2, _, _, k3 = self.distortion
        # Solved for 1 / r^2, whose polynomial has the leading coefficient 1 however small the distortion is.
        roots = np.roots([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])
        turning = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 1e-12)].real  # r > 1e6 counts as never
        return float(1.0 / np.sqrt(turning.max())) if turning.size else float("inf")

    def pixels_from_normalized(self, normalized: FloatArray) -> FloatArray:
        """Distort and scale normalized coordinates (..., 2) to pixels; NaN beyond `valid_radius`."""
        x, y = normalized[..., 0], normalized[..., 1]
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        pixels = np.stack([self.fx_px * xd + self.cx_px, self.fy_px * yd + self.cy_px], axis=-1)
        if np.isfinite(self.valid_radius):
            pixels = np.where((r2 <= self.valid_radius**2)[..., None], pixels, np.nan)
        return pixels

    def project(self, points_in_rig: FloatArray) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) in mm; NaN for points behind the camera or past the lens model."""
        points = np.asarray(points_in_rig, dtype=np.float64)
        depth = points[..., 2:]
        normalized = np.divide(points[..., :2], depth, out=np.full(points[..., :2].shape, np.nan), where=depth > 0)
        return self.pixels_from_normalized(normalized)

    def project_with_jacobians(self, points_in_rig: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pixels (n, 2), d pixels / d points (n, 2, 3) and d pixels / d intrinsics (n, 2, 9) of points (n, 3) in mm."""
        x, y, z = np.asarray(points_in_rig, dtype=np.float64).T
        x, y = x / z, y / z
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        r4, r6 = r2 * r2, r2 * r2 * r2
        radial = 1.0 + k1 * r2 + k2 * r4 + k3 * r6
        d_radial = k1 + 2.0 * k2 * r2 + 3.0 * k3 * r4
        xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y

        # Stored component first: each assignment below then runs through memory once.
        d_points = np.empty((2, 3, x.size)).transpose(2, 0, 1)
        cross = 2.0 * x * y * d_radial + 2.0 * p1 * x + 2.0 * p2 * y
        xx = radial + 2.0 * x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + 2.0 * y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x
        d_points[:, 0, 0], d_points[:, 0, 1] = self.fx_px * xx / z, self.fx_px * cross / z
        d_points[:, 1, 0], d_points[:, 1, 1] = self.fy_px * cross / z, self.fy_px * yy / z
        d_points[:, :, 2] = -(d_points[:, :, 0] * x[:, None] + d_points[:, :, 1] * y[:, None])

        d_intrinsics = np.zeros((2, 9, x.size)).transpose(2, 0, 1)
        d_intrinsics[:, 0, 0], d_intrinsics[:, 1, 1] = xd, yd
        d_intrinsics[:, 0, 2] = d_intrinsics[:, 1, 3] = 1.0
        for row, focal, coordinate in ((0, self.fx_px, x), (1, self.fy_px, y)):
            for column, power in ((4, r2), (5, r4), (8, r6)):
                d_intrinsics[:, row, column] = focal * coordinate * power
        d_intrinsics[:, 0, 6], d_intrinsics[:, 0, 7] = self.fx_px * 2.0 * x * y, self.fx_px * (r2 + 2.0 * x * x)
        d_intrinsics[:, 1, 6], d_intrinsics[:, 1, 7] = self.fy_px * (r2 + 2.0 * y * y), self.fy_px * 2.0 * x * y
        pixels = np.stack([self.fx_px * xd + self.cx_px, self.fy_px * yd + self.cy_px], axis=-1)
        return pixels, d_points, d_intrinsics

    def normalized_from_pixels(self, pixels: FloatArray) -> FloatArray:
        """Undistort pixels (..., 2) to normalized coordinates by Newton's method; NaN where it does not converge."""
        pixels = np.asarray(pixels, dtype=np.float64)
        shape = pixels.shape
        target = pixels.reshape(-1, 2)
        focal = np.array([self.fx_px, self.fy_px])
        normalized = (target - np.array([self.cx_px, self.cy_px])) / focal
        if not self.distortion.any():
            return normalized.reshape(shape)
        if np.isfinite(self.valid_radius):
            radius = np.linalg.norm(normalized, axis=1, keepdims=True)
            normalized *= np.minimum(1.0, 0.95 * self.valid_radius / np.maximum(radius, 1e-12))
        for _ in range(20):
            points = np.column_stack([normalized, np.ones(len(normalized))])
            found, d_points, _ = self.project_with_jacobians(points)
            error = target - found
            if np.nanmax(np.abs(error), initial=0.0) < 1e-11 * max(self.width_px, self.height_px):
                break
            normalized += np.linalg.solve(d_points[:, :, :2], error[:, :, None])[:, :, 0]
        error = np.abs(target - self.pixels_from_normalized(normalized))
        converged = (error < 1e-6).all(axis=1)
        normalized[~converged] = np.nan
        return normalized.reshape(shape)

    def unproject(self, pixels: FloatArray) -> FloatArray:
        """Viewing rays (..., 3) with z = 1, in rig, of pixels (..., 2)."""
        normalized = self.normalized_from_pixels(pixels)
        return np.concatenate([normalized, np.ones((*normalized.shape[:-1], 1))], axis=-1)
