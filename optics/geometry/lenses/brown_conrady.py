"""The Brown-Conrady lens: three radial and two tangential numbers, in the order of OpenCV."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.lenses.lens import Lens, Linearized


class BrownConrady(Lens):
    """Lens with the coefficients (k1, k2, p1, p2, k3).

    With r^2 = x^2 + y^2, distorted x is x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), y alike.
    """

    NAMES: ClassVar[tuple[str, ...]] = ("k1", "k2", "p1", "p2", "k3")

    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        k1, k2, p1, p2, k3 = self.coefficients
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        return xd, yd

    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        k1, k2, p1, p2, k3 = self.coefficients
        r2 = x * x + y * y
        r4, r6 = r2 * r2, r2 * r2 * r2
        radial = 1.0 + k1 * r2 + k2 * r4 + k3 * r6
        d_radial = k1 + 2.0 * k2 * r2 + 3.0 * k3 * r4
        xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        cross = 2.0 * x * y * d_radial + 2.0 * p1 * x + 2.0 * p2 * y
        xx = radial + 2.0 * x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + 2.0 * y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x
        for row, along, coordinate in ((0, focal[0], x), (1, focal[1], y)):
            for column, power in ((0, r2), (1, r4), (4, r6)):
                out[:, row, column] = along * coordinate * power
        tangential_by_coefficients(x, y, r2, focal, out)
        return Linearized(xd, yd, xx, cross, cross, yy)

    @property
    def valid_radius(self) -> float:
        """Where the radial part turns back; the tangential one is small beside it."""
        k1, k2, _, _, k3 = self.coefficients
        roots = np.roots([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])
        turning = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 1e-12)].real  # r > 1e6 counts as never
        return float(1.0 / np.sqrt(turning.max())) if turning.size else float("inf")

    def flipped(self, axis: int) -> Self:
        return replace(self, coefficients=self.coefficients * FLIPS[axis])


FLIPS = np.array([[1.0, 1.0, 1.0, -1.0, 1.0], [1.0, 1.0, -1.0, 1.0, 1.0]])
"""Signs of k1, k2, p1, p2, k3 in a picture flipped left-right, and top-bottom."""


def tangential_by_coefficients(
    x: FloatArray, y: FloatArray, r2: FloatArray, focal: tuple[float, float], out: FloatArray
) -> None:
    """Write the derivatives by p1 and p2 to the columns 2 and 3 of `out` (n, 2, k)."""
    out[:, 0, 2], out[:, 0, 3] = focal[0] * 2.0 * x * y, focal[0] * (r2 + 2.0 * x * x)
    out[:, 1, 2], out[:, 1, 3] = focal[1] * (r2 + 2.0 * y * y), focal[1] * 2.0 * x * y
