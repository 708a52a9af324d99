"""Cameras of a rig as described by a calibration file: lenses, including sphere models, and poses.

A sphere model maps a ray (x, y, z) of length d to normalized coordinates, which a lens then distorts:

    unified (Mei and Rives, 2007)              (x, y) / (z + xi d)
    extended unified (Khomutenko, 2016)        (x, y) / (alpha sqrt(beta (x^2 + y^2) + z^2) + (1 - alpha) z)
    double sphere (Usenko, 2018)               (x, y) / (alpha sqrt(x^2 + y^2 + w^2) + (1 - alpha) w),  w = xi d + z

Usenko states for each model which rays have a unique image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.geometry.camera import PINHOLE_NAMES, Camera
from mirrorcam.optics.geometry.layout import Layout, Uncertainty
from mirrorcam.optics.geometry.mirror import Mirror

UNSIZED_PX = 65_535
"""Maximum picture size, assumed for a camera whose file does not state one."""
MAX_SCALE_ERROR = 1e-4
"""Maximum deviation of a rotation matrix's singular values from 1; files have six digits or more."""
PictureFlip = Literal["flipped", "left-right", "top-bottom", "as-is"]
"""Flip from frames to the calibrator's pictures: to upright ("flipped"), as named, or none ("as-is")."""
SphereName = Literal["unified", "extended_unified", "double_sphere"]
NAMES: dict[SphereName, tuple[str, ...]] = {
    "unified": ("xi",),
    "extended_unified": ("alpha", "beta"),
    "double_sphere": ("xi", "alpha"),
}


class Projection(Protocol):
    """The interface of `Camera`, the sphere models, and a mirror with its camera."""

    def project(self, points_in_camera: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points (n, 3) in the frame of the camera; NaN for invisible points."""


@runtime_checkable
class ParametricProjection(Projection, Protocol):
    """A lens with parameters, which may have a covariance."""

    @property
    def intrinsic_names(self) -> tuple[str, ...]:
        """Names (k,) of the parameters."""

    @property
    def intrinsics(self) -> FloatArray:
        """Their values (k,)."""

    def with_intrinsics(self, intrinsics: FloatArray) -> ParametricProjection:
        """The lens with other parameter values (k,)."""


@dataclass(frozen=True, eq=False)
class RigCamera:
    """One camera of a file.

    Attributes
    ----------
    name
        Name in the file.
    lens
        Projection to pixels; pixel (0, 0) is the centre of the top-left pixel.
    camera_from_rig
        Orthogonal transform (4, 4) in the unit of the rig; None if the file has no poses. Its determinant is negative
        if the calibrator describes mirrored pictures this way.
    size_px
        Width and height of its pictures; None if the file does not state them.
    """

    name: str
    lens: Projection
    camera_from_rig: FloatArray | None
    size_px: tuple[int, int] | None


@dataclass(frozen=True, eq=False)
class CameraRig:
    """The cameras of a calibration.

    Attributes
    ----------
    format
        Format of the file.
    cameras
        Cameras in the order of the file.
    unit_mm
        Length of the unit of poses in mm; None if poses have no scale.
    pictures
        Flip of the pictures relative to frames, if the file states it.
    uncertainty
        Covariance of the parameters, if the file has one; `stated_covariance` explains their names.
    layout
        The layout whose mirrors are the cameras, for MirrorCam's own format.
    notes
        Assumptions to report to the user, a line each.
    """

    format: str
    cameras: tuple[RigCamera, ...]
    unit_mm: float | None
    pictures: PictureFlip | None = None
    uncertainty: Uncertainty | None = None
    layout: Layout | None = None
    notes: tuple[str, ...] = ()

    @property
    def posed(self) -> bool:
        """Whether all cameras have a pose."""
        return all(camera.camera_from_rig is not None for camera in self.cameras)


def orthogonal(matrix: object, where: str) -> FloatArray:
    """Make a rotation or reflection (3, 3) from a file exactly orthogonal; raises InputError for other matrices."""
    rotation = np.asarray(matrix, dtype=np.float64)
    if rotation.shape != (3, 3) or not np.isfinite(rotation).all():
        raise InputError(f"{where}: expected a rotation of 3 x 3 numbers")
    u, scales, vt = np.linalg.svd(rotation)
    if np.abs(scales - 1.0).max() > MAX_SCALE_ERROR:
        raise InputError(f"{where}: not a rotation, it scales by {scales.max():.6g} and {scales.min():.6g}")
    return np.asarray(u @ vt)


@dataclass(frozen=True, eq=False)
class MirrorProjection:
    """A mirror and its camera as a lens, in the reflection of the rig frame at the apparent mirror.

    Points in that frame are the apparent mirror's images of points in the rig frame, so the camera's pose is the
    reflection.
    Projection is exact, also for second-surface and bent mirrors.
    """

    camera: Camera
    mirror: Mirror

    def project(self, points_in_camera: FloatArray) -> FloatArray:
        """Pixels (n, 2) of images (n, 3), mm."""
        return self.camera.project(self.mirror.image_of(self.mirror.apparent.reflect(points_in_camera)))


def camera_of(
    where: str,
    intrinsics: object,
    lens_model: str,
    distortion: object,
    size_px: tuple[int, int] | None,
) -> Camera:
    """A pinhole camera with a lens from the numbers in a file; raises InputError for invalid ones."""
    width, height = (UNSIZED_PX, 1) if size_px is None else size_px
    fields = dict(zip(PINHOLE_NAMES, numbers_of(intrinsics, where, 4), strict=True))
    try:
        return Camera.model_validate(
            {
                "width_px": width,
                "height_px": height,
                **fields,
                "lens_model": lens_model,
                "distortion": numbers_of(distortion, where),
            }
        )
    except InvalidValue as error:
        raise InputError(f"{where}: {error}") from None


def numbers_of(value: object, where: str, count: int | None = None) -> list[float]:
    """Finite numbers of a list in a file; also accepts text such as 1e-05, which YAML 1.1 does not read as a number."""
    expected = "numbers" if count is None else f"{count} numbers"
    if not isinstance(value, list | tuple | np.ndarray):
        raise InputError(f"{where}: {str(value)[:40]!r}, expected {expected}")
    numbers = [number_of(item, where) for item in value]
    if count is not None and len(numbers) != count:
        raise InputError(f"{where}: {len(numbers)} numbers, expected {count}")
    return numbers


def number_of(value: object, where: str) -> float:
    """A finite number from a file; raises InputError for anything else."""
    try:
        if isinstance(value, bool) or not isinstance(value, str | int | float | np.number):
            raise ValueError
        number = float(value)
    except (ValueError, OverflowError):
        raise InputError(f"{where}: {str(value)[:40]!r}, expected a number") from None
    if not np.isfinite(number):
        raise InputError(f"{where}: {number}, expected a finite number")
    return number


def size_of(value: object, where: str) -> tuple[int, int]:
    """Width and height of a picture, px, from a file; raises InputError for anything else."""
    width, height = numbers_of(value, where, 2)
    if not (width.is_integer() and height.is_integer() and 1 <= width <= UNSIZED_PX and 1 <= height <= UNSIZED_PX):
        raise InputError(f"{where}: {width:g} x {height:g}, expected the size of a picture in px")
    return int(width), int(height)


@dataclass(frozen=True, eq=False)
class SphereLens:
    """A sphere model followed by a lens; `sphere` (1 or 2,) holds the parameters in `NAMES`."""

    model: SphereName
    sphere: FloatArray
    camera: Camera

    def project(self, points_in_camera: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points (n, 3); NaN for points without an image in the model."""
        x, y, z = points_in_camera.T
        r2 = x * x + y * y
        d = np.sqrt(r2 + z * z)
        if self.model == "unified":
            (xi,) = self.sphere
            denominator, min_z = z + xi * d, -_max_sine(xi) * d
        elif self.model == "extended_unified":
            alpha, beta = self.sphere
            rho = np.sqrt(beta * r2 + z * z)
            denominator, min_z = alpha * rho + (1.0 - alpha) * z, -_max_sine(_as_xi(alpha)) * rho
        else:
            xi, alpha = self.sphere
            w, sine = xi * d + z, _max_sine(_as_xi(alpha))
            denominator = alpha * np.sqrt(r2 + w * w) + (1.0 - alpha) * w
            min_z = -(sine + xi) / np.sqrt(2.0 * sine * xi + xi * xi + 1.0) * d
        denominator = np.where((z > min_z) & (denominator > 0.0), denominator, np.nan)
        return self.camera.pixels_from_normalized(np.stack([x / denominator, y / denominator], axis=-1))

    @property
    def intrinsic_names(self) -> tuple[str, ...]:
        """Names (k,) of `intrinsics`."""
        return (*NAMES[self.model], *self.camera.intrinsic_names)

    @property
    def intrinsics(self) -> FloatArray:
        """Parameters (k,) of the sphere, then of the camera."""
        return np.concatenate([self.sphere, self.camera.intrinsics])

    def with_intrinsics(self, intrinsics: FloatArray) -> SphereLens:
        """The same model with other parameters (k,)."""
        count = len(self.sphere)
        return replace(self, sphere=intrinsics[:count], camera=self.camera.with_intrinsics(intrinsics[count:]))


def _as_xi(alpha: float) -> float:
    """The xi of the unified model with the same sphere; infinite for the orthographic model."""
    return alpha / (1.0 - alpha) if alpha < 1.0 else np.inf


def _max_sine(xi: float) -> float:
    """Sine of the largest angle behind the camera at which rays still have a unique image."""
    return xi if xi <= 1.0 else 1.0 / xi
