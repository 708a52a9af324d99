"""Cameras of a rig as a calibration file states them: lenses, those that look from a sphere too, and poses.

A sphere lens takes a ray (x, y, z) of length d to normalized coordinates, which a lens then distorts:

    unified (Mei and Rives, 2007)              (x, y) / (z + xi d)
    extended unified (Khomutenko, 2016)        (x, y) / (alpha sqrt(beta (x^2 + y^2) + z^2) + (1 - alpha) z)
    double sphere (Usenko, 2018)               (x, y) / (alpha sqrt(x^2 + y^2 + w^2) + (1 - alpha) w),  w = xi d + z

Usenko gives for each the rays that have an image of their own.
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
"""Size of the picture that stands for one of a size that a file does not state."""
ORTHOGONAL = 1e-4
"""Largest error of a rotation matrix in a file; files have six digits or more."""
PictureFlip = Literal["flipped", "left-right", "top-bottom", "as-is"]
"""How the pictures that a calibrator was given came from frames: flipped upright, as named, or not flipped."""
SphereName = Literal["unified", "extended_unified", "double_sphere"]
NAMES: dict[SphereName, tuple[str, ...]] = {
    "unified": ("xi",),
    "extended_unified": ("alpha", "beta"),
    "double_sphere": ("xi", "alpha"),
}


class Projection(Protocol):
    """A lens: what `Camera`, the sphere models, and a mirror with its camera have in common."""

    def project(self, points_in_camera: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points (n, 3) in the frame of the camera; NaN where it does not show them."""


@runtime_checkable
class ParametricProjection(Projection, Protocol):
    """A lens with parameters that a covariance can be of."""

    @property
    def intrinsic_names(self) -> tuple[str, ...]:
        """Names (k,) of the parameters."""

    @property
    def intrinsics(self) -> FloatArray:
        """Their values (k,)."""

    def with_intrinsics(self, intrinsics: FloatArray) -> ParametricProjection:
        """The lens with other values (k,)."""


@dataclass(frozen=True, eq=False)
class RigCamera:
    """One camera of a file.

    Attributes
    ----------
    name
        As the file names it.
    lens
        Its projection, in pixels whose (0, 0) is the centre of the top-left one.
    camera_from_rig
        Orthogonal transform (4, 4) in the unit of the rig; None where the file has no poses. Its determinant is
        negative where a calibrator describes mirrored pictures so.
    size_px
        Width and height of its pictures; None where the file does not state them.
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
        The format that they were read from.
    cameras
        In the order of the file.
    unit_mm
        Length of the unit of poses in mm; None where poses have no scale.
    pictures
        How pictures came from frames, where the file itself says so.
    uncertainty
        Covariance of its parameters, where there is one; `stated_covariance` explains their names.
    layout
        The layout that the cameras are the mirrors of, of our own format.
    notes
        Lines for the user: what was assumed.
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
    """A rotation or reflection (3, 3) of a file, made exactly orthogonal; raises InputError where it is none."""
    turn = np.asarray(matrix, dtype=np.float64)
    if turn.shape != (3, 3) or not np.isfinite(turn).all():
        raise InputError(f"{where}: expected a rotation of 3 x 3 numbers")
    left, sizes, right = np.linalg.svd(turn)
    if np.abs(sizes - 1.0).max() > ORTHOGONAL:
        raise InputError(f"{where}: is no rotation: it stretches by {sizes.max():.6g} and {sizes.min():.6g}")
    return np.asarray(left @ right)


@dataclass(frozen=True, eq=False)
class MirrorProjection:
    """What a mirror and its camera show, as a lens in the frame that the apparent mirror reflects the rig to.

    Points in that frame are the apparent mirror's images of points in rig, so that the camera's pose is the
    reflection; of a plate or a bent mirror, projection is exact.
    """

    camera: Camera
    mirror: Mirror

    def project(self, points_in_camera: FloatArray) -> FloatArray:
        """Pixels (n, 2) of the frame of images (n, 3), mm."""
        return self.camera.project(self.mirror.image_of(self.mirror.apparent.reflect(points_in_camera)))


def camera_of(
    where: str,
    intrinsics: object,
    lens_model: str,
    distortion: object,
    size_px: tuple[int, int] | None,
) -> Camera:
    """A pinhole with a lens from the numbers of a file; raises InputError in one line where they are none."""
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
    """Finite numbers of a list in a file; a text such as 1e-05, which YAML 1.1 takes for one, is a number too."""
    expected = "numbers" if count is None else f"{count} numbers"
    if not isinstance(value, list | tuple | np.ndarray):
        raise InputError(f"{where}: {str(value)[:40]!r}, expected {expected}")
    found = [number_of(each, where) for each in value]
    if count is not None and len(found) != count:
        raise InputError(f"{where}: {len(found)} numbers, expected {count}")
    return found


def number_of(value: object, where: str) -> float:
    """A finite number of a file; raises InputError for anything else."""
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
    """Width and height in px."""
    width, height = numbers_of(value, where, 2)
    if not (width.is_integer() and height.is_integer() and 1 <= width <= UNSIZED_PX and 1 <= height <= UNSIZED_PX):
        raise InputError(f"{where}: {width:g} x {height:g}, expected the size of a picture in px")
    return int(width), int(height)


@dataclass(frozen=True, eq=False)
class SphereLens:
    """A camera whose rays go through a sphere before its lens; `sphere` (1 or 2,) has the numbers of `NAMES`."""

    model: SphereName
    sphere: FloatArray
    camera: Camera

    def project(self, points_in_camera: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points (n, 3); NaN where the model does not show them."""
        x, y, z = points_in_camera.T
        r2 = x * x + y * y
        d = np.sqrt(r2 + z * z)
        if self.model == "unified":
            (xi,) = self.sphere
            below, lowest = z + xi * d, -_inverted(xi) * d
        elif self.model == "extended_unified":
            alpha, beta = self.sphere
            rho = np.sqrt(beta * r2 + z * z)
            below, lowest = alpha * rho + (1.0 - alpha) * z, -_inverted(_as_xi(alpha)) * rho
        else:
            xi, alpha = self.sphere
            w, tilt = xi * d + z, _inverted(_as_xi(alpha))
            below = alpha * np.sqrt(r2 + w * w) + (1.0 - alpha) * w
            lowest = -(tilt + xi) / np.sqrt(2.0 * tilt * xi + xi * xi + 1.0) * d
        below = np.where((z > lowest) & (below > 0.0), below, np.nan)
        return self.camera.pixels_from_normalized(np.stack([x / below, y / below], axis=-1))

    @property
    def intrinsic_names(self) -> tuple[str, ...]:
        """Names (k,) of `intrinsics`."""
        return (*NAMES[self.model], *self.camera.intrinsic_names)

    @property
    def intrinsics(self) -> FloatArray:
        """The numbers of the sphere, then those of the camera (k,)."""
        return np.concatenate([self.sphere, self.camera.intrinsics])

    def with_intrinsics(self, intrinsics: FloatArray) -> SphereLens:
        """The same model with other numbers (k,)."""
        count = len(self.sphere)
        return replace(self, sphere=intrinsics[:count], camera=self.camera.with_intrinsics(intrinsics[count:]))


def _as_xi(alpha: float) -> float:
    """The xi of the unified model that has the same sphere; infinite of an orthographic one."""
    return alpha / (1.0 - alpha) if alpha < 1.0 else np.inf


def _inverted(xi: float) -> float:
    """Sine of the largest angle behind the camera at which a ray still has a picture of its own."""
    return xi if xi <= 1.0 else 1.0 / xi
