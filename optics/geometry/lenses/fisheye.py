"""The fisheye lens of Kannala and Brandt, as in OpenCV's fisheye module."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.lenses.lens import Lens, Linearized

TINY = 1e-30
NEWTON_STEPS = 20
CONVERGED = 1e-6  # the Newton residual is larger if no ray below 90 degrees has the distorted radius


class Fisheye(Lens):
    """Lens with the coefficients (k1, k2, k3, k4).

    A ray at the angle a from the axis has the distorted radius a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8)
    (J. Kannala and S. Brandt, IEEE TPAMI 28, 1335, 2006). Rays have z > 0, so a is below 90 degrees.
    """

    NAMES: ClassVar[tuple[str, ...]] = ("k1", "k2", "k3", "k4")

    def _radius(self, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted radius for an angle, and its derivative."""
        k1, k2, k3, k4 = self.coefficients
        a2 = angle * angle
        radius = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
        d_radius = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)))
        return radius, d_radius

    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        r = np.sqrt(np.maximum(x * x + y * y, TINY))
        factor = self._radius(np.arctan(r))[0] / r
        return x * factor, y * factor

    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        r2 = np.maximum(x * x + y * y, TINY)
        r = np.sqrt(r2)
        angle = np.arctan(r)
        radius, d_radius = self._radius(angle)
        factor = radius / r
        d_factor = (d_radius / (1.0 + r2) - factor) / r2  # the derivative of the factor with respect to r, divided by r
        a2 = angle * angle
        power = angle / r
        for k in range(4):
            power = power * a2
            out[:, 0, k], out[:, 1, k] = focal[0] * x * power, focal[1] * y * power
        cross = x * y * d_factor
        return Linearized(x * factor, y * factor, factor + x * x * d_factor, cross, cross, factor + y * y * d_factor)

    @property
    def is_identity(self) -> bool:
        return False

    @property
    def valid_radius(self) -> float:
        k1, k2, k3, k4 = self.coefficients
        roots = np.roots([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4])
        extrema = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 4.0 / np.pi**2)].real  # in 1 / a^2
        return float(np.tan(1.0 / np.sqrt(extrema.max()))) if extrema.size else float("inf")

    def undistorted_estimate(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        target = np.hypot(x, y)
        max_angle = min(float(np.arctan(self.valid_radius)), 1.56)
        angle = np.minimum(target, 0.9 * max_angle)
        for _ in range(NEWTON_STEPS):
            radius, d_radius = self._radius(angle)
            angle = np.clip(angle - (radius - target) / np.maximum(d_radius, 1e-3), 0.0, max_angle)
        converged = np.abs(self._radius(angle)[0] - target) < CONVERGED
        factor = np.where(target > 1e-12, np.tan(angle) / np.maximum(target, 1e-12), 1.0)
        factor = np.where(converged, factor, np.nan)
        return x * factor, y * factor

    def perturbed(self, change: FloatArray) -> Self:
        """The lens with changed k1, k2 and k3; changes of p1 and p2 have no effect."""
        return replace(self, coefficients=self.coefficients + np.append(change[[0, 1, 4]], 0.0))

    def flipped(self, axis: int) -> Self:
        return self
