"""Deflection of a bent sandwich beam (two skins and a truss of webs) under a weight at its end, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mirrorcam.core.values import FloatArray

POISSON = 0.35
"""Poisson's ratio of PLA; the shear modulus is E / (2 (1 + POISSON))."""


@dataclass(frozen=True)
class Section:
    """Two skins, `depth_mm` from outside to outside, `width_mm` wide (along x), and webs at `web_deg` to them."""

    depth_mm: float
    width_mm: float
    skin_mm: float
    web_mm: float
    web_deg: float
    plastic_mpa: float

    @property
    def plastic_mm2(self) -> float:
        """Volume of plastic per length: both skins, and the webs, which are 1 / cos of their angle longer."""
        return float(self.width_mm * (2.0 * self.skin_mm + self.web_mm / np.cos(np.deg2rad(self.web_deg))))

    @property
    def bending_nmm2(self) -> float:
        """E I about x, of both skins about the middle (parallel axes)."""
        inside = self.depth_mm - 2.0 * self.skin_mm
        return self.plastic_mpa * self.width_mm * (self.depth_mm**3 - inside**3) / 12.0

    @property
    def sideways_nmm2(self) -> float:
        """E I about the skins' normal: both stand on edge."""
        return self.plastic_mpa * 2.0 * self.skin_mm * self.width_mm**3 / 12.0

    @property
    def shear_n(self) -> float:
        """Shear force per angle: E A sin^2 a cos a of webs of area A at an angle a (Timoshenko's laced columns)."""
        angle = np.deg2rad(self.web_deg)
        return float(self.plastic_mpa * self.web_mm * self.width_mm * np.sin(angle) ** 2 * np.cos(angle))

    @property
    def torsion_nmm2(self) -> float:
        """G J of two skins whose edges are open, h apart, on a core that shears.

        With the skins' warping +-w(x), equilibrium of a skin is w'' = k^2 (w + h x phi' / 2), k^2 = 2 S / (G t h b h)
        where S is `shear_n`; free edges give G J = 2 G t h^2 b (1 - tanh(k b / 2) / (k b / 2)).
        """
        modulus = self.plastic_mpa / (2.0 * (1.0 + POISSON))
        apart = self.depth_mm - self.skin_mm
        core = self.shear_n / (self.width_mm * apart)
        k_half = np.sqrt(2.0 * core / (modulus * self.skin_mm * apart)) * self.width_mm / 2.0
        return float(2.0 * modulus * self.skin_mm * apart**2 * self.width_mm * (1.0 - np.tanh(k_half) / k_half))


def bends_per_newton(path: FloatArray, load: FloatArray, section: Section) -> tuple[FloatArray, FloatArray]:
    """Turn in rad and shift in mm, both (3, 3), of a load at a point (3,) in rig, per N of its weight.

    Column j is for a force along axis j. The beam follows a path (n, 2; y and z), clamped at its first point, and holds
    the load rigidly at its last. Castigliano's theorem: the moment (load - p) x F is linear along each straight piece,
    so that Simpson's rule is exact for what it is squared in. Shear of the truss moves the load and turns nothing.
    """
    turn, shift = np.zeros((3, 3)), np.zeros((3, 3))
    for start, end in pairwise(path):
        length = float(np.linalg.norm(end - start))
        tangent = np.array([0.0, *(end - start) / length])
        across = np.array([1.0, 0.0, 0.0])
        normal = np.cross(across, tangent)
        pliant = (
            np.outer(across, across) / section.bending_nmm2
            + np.outer(normal, normal) / section.sideways_nmm2
            + np.outer(tangent, tangent) / section.torsion_nmm2
        )
        for at, weight in ((start, 1.0 / 6.0), ((start + end) / 2.0, 4.0 / 6.0), (end, 1.0 / 6.0)):
            moments = np.cross(load - np.array([0.0, *at]), np.eye(3)).T
            turn += length * weight * pliant @ moments
            shift += length * weight * moments.T @ pliant @ moments
        shift += length * np.outer(normal, normal) / section.shear_n
    return turn, shift
