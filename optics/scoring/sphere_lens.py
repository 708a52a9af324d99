"""Lenses that look from a sphere: the unified, the extended unified and the double sphere camera.

Each takes a ray (x, y, z) of length d to normalized coordinates, which a lens then distorts:

    unified (Mei and Rives, 2007)              (x, y) / (z + xi d)
    extended unified (Khomutenko, 2016)        (x, y) / (alpha sqrt(beta (x^2 + y^2) + z^2) + (1 - alpha) z)
    double sphere (Usenko, 2018)               (x, y) / (alpha sqrt(x^2 + y^2 + w^2) + (1 - alpha) w),  w = xi d + z
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mirrorcam.optics.base.values import FloatArray
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
            below, shown = z + xi * d, z > -(xi if xi <= 1.0 else 1.0 / xi) * d
        elif self.model == "extended_unified":
            alpha, beta = self.sphere
            below = alpha * np.sqrt(beta * r2 + z * z) + (1.0 - alpha) * z
            shown = below > 0.0
        else:
            xi, alpha = self.sphere
            w = xi * d + z
            below = alpha * np.sqrt(r2 + w * w) + (1.0 - alpha) * w
            shown = below > 0.0
        below = np.where(shown & (below > 0.0), below, np.nan)
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
