"""The thin-prism lens: the rational one with four numbers of a thin prism, in the order of OpenCV."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.lenses.lens import Linearized
from mirrorcam.optics.geometry.lenses.rational import Rational


class ThinPrism(Rational):
    """Lens with the coefficients (k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4).

    To the rational lens it adds s1 r^2 + s2 r^4 along x and s3 r^2 + s4 r^4 along y, as of sensors that are tilted a
    little (J. Weng, P. Cohen and M. Herniou, "Camera calibration with distortion models", 1992).
    """

    NAMES: ClassVar[tuple[str, ...]] = (*Rational.NAMES, "s1", "s2", "s3", "s4")

    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        s1, s2, s3, s4 = self.coefficients[8:]
        xd, yd = super().distorted(x, y)
        r2 = x * x + y * y
        return xd + r2 * (s1 + r2 * s2), yd + r2 * (s3 + r2 * s4)

    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        s1, s2, s3, s4 = self.coefficients[8:]
        at = super().linearized(x, y, focal, out)
        r2 = x * x + y * y
        r4 = r2 * r2
        out[:, 0, 8], out[:, 0, 9] = focal[0] * r2, focal[0] * r4
        out[:, 1, 10], out[:, 1, 11] = focal[1] * r2, focal[1] * r4
        by_x, by_y = 2.0 * s1 + 4.0 * s2 * r2, 2.0 * s3 + 4.0 * s4 * r2
        return Linearized(
            at.x + s1 * r2 + s2 * r4,
            at.y + s3 * r2 + s4 * r4,
            at.xx + by_x * x,
            at.xy + by_x * y,
            at.yx + by_y * x,
            at.yy + by_y * y,
        )

    def flipped(self, axis: int) -> Self:
        lens = super().flipped(axis)
        signs = np.ones(12)
        signs[[8, 9] if axis == 0 else [10, 11]] = -1.0
        return replace(lens, coefficients=lens.coefficients * signs)
