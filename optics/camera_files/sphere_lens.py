"""Lenses that look from a sphere: the unified, the extended unified and the double sphere camera.

Each takes a ray (x, y, z) of length d to normalized coordinates, which a lens then distorts:

    unified (Mei and Rives, 2007)              (x, y) / (z + xi d)
    extended unified (Khomutenko, 2016)        (x, y) / (alpha sqrt(beta (x^2 + y^2) + z^2) + (1 - alpha) z)
    double sphere (Usenko, 2018)               (x, y) / (alpha sqrt(x^2 + y^2 + w^2) + (1 - alpha) w),  w = xi d + z

Usenko gives for each the rays that have a picture of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera

SphereName = Literal["unified", "extended_unified", "double_sphere"]
NAMES: dict[SphereName, tuple[str, ...]] = {
    "unified": ("xi",),
    "extended_unified": ("alpha", "beta"),
    "double_sphere": ("xi", "alpha"),
}


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
