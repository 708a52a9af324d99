"""Polynomial distortion models, coefficients in OpenCV's order: Brown-Conrady, rational and thin-prism."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.lenses.lens import Lens, Linearized

DENOMINATOR_SIGMA = 0.3


class BrownConrady(Lens):
    """Lens with the coefficients (k1, k2, p1, p2, k3).

    With r^2 = x^2 + y^2, distorted x is x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and likewise y.
    """

    NAMES: ClassVar[tuple[str, ...]] = ("k1", "k2", "p1", "p2", "k3")

    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        k1, k2, p1, p2, k3 = self.coefficients
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return _distorted(x, y, r2, radial, (p1, p2))

    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        k1, k2, p1, p2, k3 = self.coefficients
        r2 = x * x + y * y
        r4, r6 = r2 * r2, r2 * r2 * r2
        radial = 1.0 + k1 * r2 + k2 * r4 + k3 * r6
        d_radial = k1 + 2.0 * k2 * r2 + 3.0 * k3 * r4
        for row, focal_px, coordinate in ((0, focal[0], x), (1, focal[1], y)):
            for column, power in ((0, r2), (1, r4), (4, r6)):
                out[:, row, column] = focal_px * coordinate * power
        _write_tangential_derivatives(x, y, r2, focal, out)
        return _linearized(x, y, r2, radial, d_radial, (p1, p2))

    @property
    def valid_radius(self) -> float:
        """Radius at which the radial part stops increasing; the tangential part is small in comparison."""
        k1, k2, _, _, k3 = self.coefficients
        roots = np.roots([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])
        extrema = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 1e-12)].real  # r > 1e6 counts as never
        return float(1.0 / np.sqrt(extrema.max())) if extrema.size else float("inf")

    def flipped(self, axis: int) -> Self:
        return replace(self, coefficients=self.coefficients * FLIPS[axis])


FLIPS = np.array([[1.0, 1.0, 1.0, -1.0, 1.0], [1.0, 1.0, -1.0, 1.0, 1.0]])
"""Signs of k1, k2, p1, p2, k3 for pictures flipped left-right and top-bottom."""


def _distorted(
    x: FloatArray, y: FloatArray, r2: FloatArray, radial: FloatArray, tangential: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Distorted x and y from a radial factor and the tangential coefficients (p1, p2)."""
    p1, p2 = tangential
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return xd, yd


def _linearized(
    x: FloatArray,
    y: FloatArray,
    r2: FloatArray,
    radial: FloatArray,
    d_radial: FloatArray,
    tangential: tuple[float, float],
) -> Linearized:
    """Distorted x and y, and their derivatives with respect to x and y; `d_radial` is d factor / d r^2."""
    p1, p2 = tangential
    xd, yd = _distorted(x, y, r2, radial, tangential)
    cross = 2.0 * x * y * d_radial + 2.0 * p1 * x + 2.0 * p2 * y
    xx = radial + 2.0 * x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x
    yy = radial + 2.0 * y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x
    return Linearized(xd, yd, xx, cross, cross, yy)


def _write_tangential_derivatives(
    x: FloatArray, y: FloatArray, r2: FloatArray, focal: tuple[float, float], out: FloatArray
) -> None:
    """Write the derivatives with respect to p1 and p2 to columns 2 and 3 of `out` (n, 2, k)."""
    out[:, 0, 2], out[:, 0, 3] = focal[0] * 2.0 * x * y, focal[0] * (r2 + 2.0 * x * x)
    out[:, 1, 2], out[:, 1, 3] = focal[1] * (r2 + 2.0 * y * y), focal[1] * 2.0 * x * y


class Rational(Lens):
    """Lens with the coefficients (k1, k2, p1, p2, k3, k4, k5, k6).

    A Brown-Conrady lens whose radial factor is divided by 1 + k4 r^2 + k5 r^4 + k6 r^6.
    """

    NAMES: ClassVar[tuple[str, ...]] = (*BrownConrady.NAMES, "k4", "k5", "k6")

    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        k1, k2, p1, p2, k3, k4, k5, k6 = self.coefficients[:8]
        r2 = x * x + y * y
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return _distorted(x, y, r2, radial, (p1, p2))

    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        k1, k2, p1, p2, k3, k4, k5, k6 = self.coefficients[:8]
        r2 = x * x + y * y
        r4 = r2 * r2
        powers = (r2, r4, r4 * r2)
        inverse = 1.0 / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) * inverse
        d_radial = (k1 + 2.0 * k2 * r2 + 3.0 * k3 * r4 - radial * (k4 + 2.0 * k5 * r2 + 3.0 * k6 * r4)) * inverse
        for row, scaled in ((0, focal[0] * x * inverse), (1, focal[1] * y * inverse)):
            for numerator, denominator, power in zip((0, 1, 4), (5, 6, 7), powers, strict=True):
                out[:, row, numerator] = scaled * power
                out[:, row, denominator] = -scaled * power * radial
        _write_tangential_derivatives(x, y, r2, focal, out)
        return _linearized(x, y, r2, radial, d_radial, (p1, p2))

    @property
    def valid_radius(self) -> float:
        """Radius at which the radial part stops increasing or has a pole."""
        k1, k2, _, _, k3, k4, k5, k6 = self.coefficients[:8]
        a, b = np.array([k3, k2, k1, 1.0]), np.array([k6, k5, k4, 1.0])  # numerator A, denominator B; in s = r^2
        # d (r A / B) / dr = (A B + 2 s (A' B - A B')) / B^2
        wronskian: FloatArray = np.polysub(np.polymul(np.polyder(a), b), np.polymul(a, np.polyder(b)))
        d_distorted = np.polyadd(np.polymul(a, b), np.polymul([2.0, 0.0], wronskian))
        return float(np.sqrt(min(_first_root(d_distorted), _first_root(b))))

    @property
    def prior_sigmas(self) -> FloatArray:
        """Finite only for k4, k5 and k6: without a prior, many quotients describe a nearly polynomial lens."""
        sigmas = np.full(len(self.coefficients), np.inf)
        sigmas[5:8] = DENOMINATOR_SIGMA
        return sigmas

    def flipped(self, axis: int) -> Self:
        signs = np.ones(len(self.coefficients))
        signs[:5] = FLIPS[axis]
        return replace(self, coefficients=self.coefficients * signs)


def _first_root(polynomial: FloatArray) -> float:
    """Smallest positive root s of a polynomial whose constant term, the last, is 1; infinite if there is none.

    Solves for 1 / s, whose polynomial has the leading coefficient 1, however small the others are.
    """
    roots = np.roots(polynomial[::-1])
    inverse_roots = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 1e-12)].real  # r > 1e6 counts as never
    return float(1.0 / inverse_roots.max()) if inverse_roots.size else float("inf")


class ThinPrism(Rational):
    """Lens with the coefficients (k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4).

    It adds s1 r^2 + s2 r^4 along x and s3 r^2 + s4 r^4 along y to the rational lens, as a slightly tilted sensor does
    (J. Weng, P. Cohen and M. Herniou, "Camera calibration with distortion models", 1992).
    """

    NAMES: ClassVar[tuple[str, ...]] = (*Rational.NAMES, "s1", "s2", "s3", "s4")

    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        s1, s2, s3, s4 = self.coefficients[8:]
        xd, yd = super().distorted(x, y)
        r2 = x * x + y * y
        return xd + r2 * (s1 + r2 * s2), yd + r2 * (s3 + r2 * s4)

    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        s1, s2, s3, s4 = self.coefficients[8:]
        base = super().linearized(x, y, focal, out)
        r2 = x * x + y * y
        r4 = r2 * r2
        out[:, 0, 8], out[:, 0, 9] = focal[0] * r2, focal[0] * r4
        out[:, 1, 10], out[:, 1, 11] = focal[1] * r2, focal[1] * r4
        d_x, d_y = 2.0 * s1 + 4.0 * s2 * r2, 2.0 * s3 + 4.0 * s4 * r2
        return Linearized(
            base.x + s1 * r2 + s2 * r4,
            base.y + s3 * r2 + s4 * r4,
            base.xx + d_x * x,
            base.xy + d_x * y,
            base.yx + d_y * x,
            base.yy + d_y * y,
        )

    def flipped(self, axis: int) -> Self:
        lens = super().flipped(axis)
        signs = np.ones(12)
        signs[[8, 9] if axis == 0 else [10, 11]] = -1.0
        return replace(lens, coefficients=lens.coefficients * signs)
